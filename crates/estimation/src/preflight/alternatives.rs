//! The mistakes that are tried where scans do not form a surface.

use nalgebra::Quaternion;
use serde::{Deserialize, Serialize};

use super::time_scales::TimeScales;
use crate::calibration::Mounting;
use crate::geometry::{BodyFromScanner, EulerConvention, Rotation, Vec3};

/// A usual mistake in mountings, clocks or heights. Scanners are named as in the project.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Mistake {
    /// All rotations are those from body to scanner.
    InverseRotations {
        /// The convention with which the inverse rotations are those that are written.
        convention: EulerConvention,
    },
    /// Quaternions are w, x, y, z.
    QuaternionsWxyz,
    /// The rotation of a scanner is that from body to scanner.
    InverseRotation {
        /// The scanner.
        scanner: String,
        /// The convention with which the inverse rotation is the one that is written.
        convention: EulerConvention,
    },
    /// The profiles of two scanners are exchanged.
    Swapped([String; 2]),
    /// A component of a scanner's translation has the other sign.
    TranslationSign {
        /// The scanner.
        scanner: String,
        /// The component.
        axis: usize,
    },
    /// A scanner is turned by 180° about one of its axes.
    HalfTurn {
        /// The scanner.
        scanner: String,
        /// The axis.
        axis: usize,
    },
    /// All scanners are turned by 180° about one of their axes.
    HalfTurns {
        /// The axis.
        axis: usize,
    },
    /// Translations are given in FLU where the body is FRD, or the other way round.
    TranslationSigns {
        /// Whether y has the other sign too, not z alone.
        with_y: bool,
    },
    /// Mountings are given in FLU where the body is FRD, or the other way round.
    OtherAxes,
    /// The times of the scanners are in another time scale.
    ScannerTimes {
        /// Their time scale and that of the trajectory.
        scales: TimeScales,
        /// What is to be added to their times, seconds.
        late_s: f64,
    },
    /// The reference lies too low.
    ReferenceHeight {
        /// By how much, metres; negative where it lies too high.
        above_m: f64,
    },
}

/// The project without one of the usual mistakes.
pub struct Alternative {
    /// Mountings without the mistake.
    pub poses: Vec<BodyFromScanner>,
    /// What is added to the times of the scanners, seconds.
    pub late_s: f64,
    /// The mistake.
    pub mistake: Mistake,
}

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
    let mut add = |poses: Vec<BodyFromScanner>, mistake: Mistake| {
        all.push(Alternative {
            poses,
            late_s: 0.0,
            mistake,
        });
    };
    let inverse =
        |pose: &BodyFromScanner| BodyFromScanner::new(pose.rotation.inverse(), pose.translation_m);
    let other_convention = |convention| match convention {
        EulerConvention::Bonn => EulerConvention::Zyx,
        EulerConvention::Zyx => EulerConvention::Bonn,
    };
    let convention = mountings.first().map_or(EulerConvention::Zyx, |mounting| {
        other_convention(mounting.convention)
    });
    add(
        nominal.iter().map(inverse).collect(),
        Mistake::InverseRotations { convention },
    );
    add(
        nominal.iter().map(of_quaternion_wxyz).collect(),
        Mistake::QuaternionsWxyz,
    );
    for i in 0..nominal.len() {
        let name = &mountings[i].name;
        if nominal.len() > 1 {
            let mut poses = nominal.to_vec();
            poses[i] = inverse(&poses[i]);
            let convention = other_convention(mountings[i].convention);
            let scanner = name.clone();
            add(
                poses,
                Mistake::InverseRotation {
                    scanner,
                    convention,
                },
            );
        }
        for (j, second) in mountings.iter().enumerate().skip(i + 1) {
            let mut poses = nominal.to_vec();
            poses.swap(i, j);
            add(poses, Mistake::Swapped([name.clone(), second.name.clone()]));
        }
        for axis in 0..3 {
            let mut poses = nominal.to_vec();
            poses[i].translation_m[axis] *= -1.0;
            let scanner = name.clone();
            add(poses, Mistake::TranslationSign { scanner, axis });
            let mut poses = nominal.to_vec();
            poses[i].rotation *= half_turn(axis);
            let scanner = name.clone();
            add(poses, Mistake::HalfTurn { scanner, axis });
        }
    }
    for axis in (0..3).filter(|_| nominal.len() > 1) {
        let turned = nominal.iter().map(|pose| {
            let mut pose = *pose;
            pose.rotation *= half_turn(axis);
            pose
        });
        add(turned.collect(), Mistake::HalfTurns { axis });
    }
    for (signs, with_y) in [
        (Vec3::new(1.0, -1.0, -1.0), true),
        (Vec3::new(1.0, 1.0, -1.0), false),
    ] {
        let poses = nominal.iter().map(|pose| {
            BodyFromScanner::new(pose.rotation, pose.translation_m.component_mul(&signs))
        });
        add(poses.collect(), Mistake::TranslationSigns { with_y });
    }
    let about_x = half_turn(0);
    let other_axes = |pose: &BodyFromScanner| {
        BodyFromScanner::new(about_x * pose.rotation, about_x * pose.translation_m)
    };
    add(nominal.iter().map(other_axes).collect(), Mistake::OtherAxes);
    for scales in TimeScales::ALL {
        for late_s in [scales.difference_s(), -scales.difference_s()] {
            all.push(Alternative {
                poses: nominal.to_vec(),
                late_s,
                mistake: Mistake::ScannerTimes { scales, late_s },
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
