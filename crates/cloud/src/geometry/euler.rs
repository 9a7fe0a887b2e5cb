//! Euler angles of a mounting in the two supported conventions.

use serde::{Deserialize, Serialize};

use super::attitude::roll_pitch_yaw;
use super::{Rotation, Vec3};

/// How three angles (α, β, γ) form R_bs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EulerConvention {
    /// R_bs = Rz(γ) Ry(β) Rx(α).
    #[default]
    Zyx,
    /// R_bs = (Rz(γ) Ry(β) Rx(α))ᵀ: the paper's Table I and the Bonn group's files.
    Bonn,
}

impl EulerConvention {
    /// Both conventions.
    pub const ALL: [Self; 2] = [Self::Zyx, Self::Bonn];

    /// The name in a project file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Zyx => "zyx",
            Self::Bonn => "bonn",
        }
    }
}

/// R_bs from the angles (α, β, γ) in degrees.
pub fn rotation_from_euler_deg(convention: EulerConvention, angles_deg: [f64; 3]) -> Rotation {
    let [alpha, beta, gamma] = angles_deg.map(f64::to_radians);
    let zyx = Rotation::from_euler_angles(alpha, beta, gamma);
    match convention {
        EulerConvention::Zyx => zyx,
        EulerConvention::Bonn => zyx.inverse(),
    }
}

/// The angles (α, β, γ) of R_bs in degrees.
pub fn euler_deg_from_rotation(convention: EulerConvention, rotation: &Rotation) -> [f64; 3] {
    let zyx = match convention {
        EulerConvention::Zyx => *rotation,
        EulerConvention::Bonn => rotation.inverse(),
    };
    roll_pitch_yaw(&zyx).map(f64::to_degrees)
}

/// d(α, β, γ)/dφ where R ← R Exp(φ): row i is the gradient of angle i (radians per radian).
/// By central differences of 1e-6 rad, accurate to about 1e-9; unbounded near gimbal lock.
pub fn euler_jacobian(convention: EulerConvention, rotation: &Rotation) -> super::Mat3 {
    let h = 1e-6;
    let mut jacobian = super::Mat3::zeros();
    for axis in 0..3 {
        let mut d = Vec3::zeros();
        d[axis] = h;
        let plus = euler_deg_from_rotation(convention, &(rotation * super::so3::exp(&d)));
        let minus = euler_deg_from_rotation(convention, &(rotation * super::so3::exp(&-d)));
        for i in 0..3 {
            let mut delta = plus[i] - minus[i];
            delta -= 360.0 * (delta / 360.0).round();
            jacobian[(i, axis)] = delta.to_radians() / (2.0 * h);
        }
    }
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_conventions_return_what_was_put_in() {
        for convention in [EulerConvention::Zyx, EulerConvention::Bonn] {
            let angles = [-143.769, -0.369, 89.833];
            let back =
                euler_deg_from_rotation(convention, &rotation_from_euler_deg(convention, angles));
            for i in 0..3 {
                assert!((angles[i] - back[i]).abs() < 1e-9, "{back:?}");
            }
        }
    }

    #[test]
    fn angles_reproduce_a_scanner_that_looks_straight_ahead() {
        for beta in [90.0, -90.0] {
            let rotation = rotation_from_euler_deg(EulerConvention::Zyx, [20.0, beta, 50.0]);
            let angles = euler_deg_from_rotation(EulerConvention::Zyx, &rotation);
            let back = rotation_from_euler_deg(EulerConvention::Zyx, angles);
            assert!(back.angle_to(&rotation) < 1e-7, "{angles:?}");
        }
    }

    #[test]
    fn the_left_scanner_of_the_paper_looks_inward_and_down() {
        // FRD: the left scanner sits at negative y, so inward is +y, down is +z.
        let r = rotation_from_euler_deg(EulerConvention::Bonn, [-143.769, -0.369, 89.833]);
        let view = r * Vec3::new(0.0, 0.0, -1.0);
        assert!(
            view.y > 0.5 && view.z > 0.75 && view.x.abs() < 0.02,
            "{view}"
        );
    }
}
