//! The mistakes that are tried where scans do not form a surface.

use nalgebra::Quaternion;

use super::TIME_SCALES_S;
use crate::calibration::Mounting;
use crate::geometry::{BodyFromScanner, EulerConvention, Rotation, Vec3};

/// The project without one of the usual mistakes.
pub struct Alternative {
    /// Mountings without the mistake.
    pub poses: Vec<BodyFromScanner>,
    /// What is added to the times of the scanners, seconds.
    pub late_s: f64,
    /// Code of the verdict.
    pub code: &'static str,
    /// The mistake, in words that follow "Only 0.02 m remain".
    pub text: String,
}

/// The axes of a scanner or of the body.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Half a turn about one of the axes.
fn half_turn(axis: usize) -> Rotation {
    Rotation::from_scaled_axis(std::f64::consts::PI * Vec3::ith(axis, 1.0))
}

/// The mounting whose quaternion has the components w, x, y, z that were read as x, y, z, w.
fn of_quaternion_wxyz(read: &BodyFromScanner) -> BodyFromScanner {
    let [w, x, y, z] = read.rotation.coords.into();
    let rotation = Rotation::from_quaternion(Quaternion::new(w, x, y, z));
    BodyFromScanner::new(rotation, read.translation_m)
}

/// The usual mistakes in mountings and clocks of scanners; `nominal` are those of the project.
pub fn alternatives(mountings: &[Mounting], nominal: &[BodyFromScanner]) -> Vec<Alternative> {
    let mut all = Vec::new();
    let mut add = |poses: Vec<BodyFromScanner>, code, text: String| {
        all.push(Alternative {
            poses,
            late_s: 0.0,
            code,
            text,
        });
    };
    let inverse =
        |pose: &BodyFromScanner| BodyFromScanner::new(pose.rotation.inverse(), pose.translation_m);
    let other_convention = |convention| match convention {
        EulerConvention::Bonn => "zyx",
        EulerConvention::Zyx => "bonn",
    };
    let convention = mountings
        .first()
        .map_or("zyx", |m| other_convention(m.convention));
    add(
        nominal.iter().map(inverse).collect(),
        "scanner.convention",
        format!(
            "with the inverse rotations: write rotation_convention = \"{convention}\", or invert the quaternions."
        ),
    );
    add(
        nominal.iter().map(of_quaternion_wxyz).collect(),
        "scanner.convention",
        "with quaternions whose components are w, x, y, z: write them as x, y, z, w.".into(),
    );
    for i in 0..nominal.len() {
        let name = &mountings[i].name;
        if nominal.len() > 1 {
            let mut poses = nominal.to_vec();
            poses[i] = inverse(&poses[i]);
            let text = format!(
                "with the inverse rotation of scanner `{name}`: write rotation_convention = \"{}\" there.",
                other_convention(mountings[i].convention)
            );
            add(poses, "scanner.convention", text);
        }
        for (j, second) in mountings.iter().enumerate().skip(i + 1) {
            let mut poses = nominal.to_vec();
            poses.swap(i, j);
            let text = format!(
                "with the profiles of `{name}` and `{}` exchanged: the files, or the mountings, are those of \
                 the other scanner.",
                second.name
            );
            add(poses, "scanner.swapped", text);
        }
        for (axis, axis_name) in AXES.into_iter().enumerate() {
            let mut poses = nominal.to_vec();
            poses[i].translation_m[axis] *= -1.0;
            let text = format!(
                "with the other sign of {axis_name} in the translation of scanner `{name}`."
            );
            add(poses, "scanner.translation", text);
            let mut poses = nominal.to_vec();
            poses[i].rotation *= half_turn(axis);
            let text = format!("with scanner `{name}` turned by 180° about its {axis_name} axis.");
            add(poses, "scanner.rotation", text);
        }
    }
    for (axis, name) in AXES.into_iter().enumerate().filter(|_| nominal.len() > 1) {
        let turned = nominal.iter().map(|pose| {
            let mut pose = *pose;
            pose.rotation *= half_turn(axis);
            pose
        });
        let text = format!("with all scanners turned by 180° about their {name} axes.");
        add(turned.collect(), "scanner.rotation", text);
    }
    for (signs, what) in [
        (Vec3::new(1.0, -1.0, -1.0), "y and z"),
        (Vec3::new(1.0, 1.0, -1.0), "z"),
    ] {
        let poses = nominal.iter().map(|pose| {
            BodyFromScanner::new(pose.rotation, pose.translation_m.component_mul(&signs))
        });
        let text = format!(
            "with the other sign of {what} in all translations: are they given in FLU where the body is FRD, \
             or the other way round?"
        );
        add(poses.collect(), "scanner.translation", text);
    }
    let about_x = half_turn(0);
    let other_axes = |pose: &BodyFromScanner| {
        BodyFromScanner::new(about_x * pose.rotation, about_x * pose.translation_m)
    };
    add(
        nominal.iter().map(other_axes).collect(),
        "scanner.axes",
        "with mountings whose y and z are negated: they are given in FLU and the body is FRD, or the other \
         way round."
            .into(),
    );
    for (scale_s, scales) in TIME_SCALES_S {
        for late_s in [scale_s, -scale_s] {
            let text = format!(
                "with {late_s:+.0} s added to the times of the scanners: {scales} differ by that. Write \
                 time_offset_s = {late_s:.1} for each scanner."
            );
            all.push(Alternative {
                poses: nominal.to_vec(),
                late_s,
                code: "scanner.time_offset",
                text,
            });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_in_another_order_are_put_right() {
        let rotation = Rotation::from_euler_angles(0.4, -0.2, 1.3);
        let [x, y, z, w] = rotation.coords.into();
        let misread = Rotation::from_quaternion(Quaternion::from_vector([w, x, y, z].into()));
        let misread = BodyFromScanner::new(misread, Vec3::x());
        let right = of_quaternion_wxyz(&misread);
        assert!(right.rotation.angle_to(&rotation) < 1e-12);
        assert_eq!(right.translation_m, Vec3::x());
    }
}
