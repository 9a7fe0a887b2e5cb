//! The rotation group: exponential, logarithm and their Jacobians (Forster et al. 2017, eq. 1–8).

use super::{Mat3, Rotation, Vec3};

/// The skew-symmetric matrix with `hat(a) b = a × b`.
#[inline]
pub fn hat(v: &Vec3) -> Mat3 {
    Mat3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The rotation by the rotation vector `phi` (radians).
#[inline]
pub fn exp(phi: &Vec3) -> Rotation {
    Rotation::from_scaled_axis(*phi)
}

/// The rotation vector (radians, length at most π) of `rotation`.
#[inline]
pub fn log(rotation: &Rotation) -> Vec3 {
    rotation.scaled_axis()
}

/// The right Jacobian J_r, with Exp(φ + δ) ≈ Exp(φ) Exp(J_r(φ) δ).
pub fn right_jacobian(phi: &Vec3) -> Mat3 {
    let theta2 = phi.norm_squared();
    let w = hat(phi);
    let (a, b) = if theta2 < 1e-8 {
        (0.5 - theta2 / 24.0, 1.0 / 6.0 - theta2 / 120.0)
    } else {
        let theta = theta2.sqrt();
        (
            (1.0 - theta.cos()) / theta2,
            (theta - theta.sin()) / (theta2 * theta),
        )
    };
    Mat3::identity() - w * a + w * w * b
}

/// The inverse of [`right_jacobian`]: Log(Exp(φ) Exp(δ)) ≈ φ + J_r⁻¹(φ) δ.
pub fn right_jacobian_inverse(phi: &Vec3) -> Mat3 {
    let theta2 = phi.norm_squared();
    let w = hat(phi);
    let b = if theta2 < 1e-8 {
        1.0 / 12.0 + theta2 / 720.0
    } else {
        let theta = theta2.sqrt();
        1.0 / theta2 - (1.0 + theta.cos()) / (2.0 * theta * theta.sin())
    };
    Mat3::identity() + w * 0.5 + w * w * b
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASES: [[f64; 3]; 4] = [
        [0.0, 0.0, 0.0],
        [1e-5, -2e-5, 3e-5],
        [0.3, -0.2, 0.5],
        [1.5, 1.0, -2.0],
    ];

    #[test]
    fn jacobians_meet_finite_differences() {
        // Central differences with step 1e-5 are accurate to about 1e-10.
        let h = 1e-5;
        for phi in CASES.map(Vec3::from) {
            for axis in 0..3 {
                let mut d = Vec3::zeros();
                d[axis] = h;
                let plus = log(&(exp(&phi).inverse() * exp(&(phi + d))));
                let minus = log(&(exp(&phi).inverse() * exp(&(phi - d))));
                let numeric = (plus - minus) / (2.0 * h);
                assert!((numeric - right_jacobian(&phi).column(axis)).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn inverse_jacobian_inverts() {
        for phi in CASES.map(Vec3::from) {
            let product = right_jacobian(&phi) * right_jacobian_inverse(&phi);
            assert!((product - Mat3::identity()).norm() < 1e-10);
        }
    }
}
