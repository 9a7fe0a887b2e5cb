//! Rows of Jacobians: derivatives of a point's coordinate along a direction by pose and by
//! mounting.

use crate::geometry::{Mat3, Vec3, transposed_product};

/// Derivative of a distance by the [perturbation](crate::geometry::Transform#perturbations)
/// (δφ, δp) of a transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Derivative by δφ, in body axes, metres per radian.
    pub rotation: Vec3,
    /// Derivative by δp, metres per metre: in world axes for a pose, in body axes for a mounting.
    pub translation: Vec3,
}

impl Row {
    /// The derivatives of n·x_m by the pose `world_from_body`, for one point x_m = t_mb + R_mb (t_bs + R_bs x_s) and n =
    /// `direction`, fixed in the world, of any length:
    ///
    /// n·∂x_m = n·δp_mb + (l × m)·δφ_mb with m = R_mbᵀ n,
    ///
    /// where l = t_bs + R_bs x_s is the point in the body frame (`lever_m`). The row is linear in l, so that of a mean of
    /// points is the mean of their rows.
    #[inline]
    pub fn by_pose(direction: &Vec3, world_from_body: &Mat3, lever_m: &Vec3) -> Self {
        let in_body = transposed_product(world_from_body, direction);
        Self {
            rotation: lever_m.cross(&in_body),
            translation: *direction,
        }
    }

    /// Those by the mounting `body_from_scanner`:
    ///
    /// n·∂x_m = m·δp_bs + (a × m)·δφ_bs with m = R_mbᵀ n,
    ///
    /// where a = R_bs x_s (`arm_m`), in which the row is linear.
    #[inline]
    pub fn by_mounting(direction: &Vec3, world_from_body: &Mat3, arm_m: &Vec3) -> Self {
        let in_body = transposed_product(world_from_body, direction);
        Self {
            rotation: arm_m.cross(&in_body),
            translation: in_body,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BodyFromScanner, WorldFromBody, so3};

    #[test]
    fn both_rows_match_finite_differences() {
        let pose = WorldFromBody::new(
            so3::exp(&Vec3::new(0.3, -0.2, 1.1)),
            Vec3::new(4.0, -2.0, 1.5),
        );
        let mounting = BodyFromScanner::new(
            so3::exp(&Vec3::new(-2.1, 0.4, 0.7)),
            Vec3::new(1.2, -0.5, 0.6),
        );
        let (x, normal) = (Vec3::new(0.2, 0.1, -1.1), Vec3::new(0.48, -0.64, 0.6));
        let rotation = pose.rotation.to_rotation_matrix();
        let arm = mounting.rotation * x;
        let row_by_pose = Row::by_pose(&normal, rotation.matrix(), &mounting.map(&x));
        let row_by_mounting = Row::by_mounting(&normal, rotation.matrix(), &arm);
        // Central differences of 1e-6 carry an error of about 1e-10.
        let h = 1e-6;
        for axis in 0..3 {
            let mut d = Vec3::zeros();
            d[axis] = h;
            let zero = Vec3::zeros();
            let by_pose = |turn: Vec3, shift: Vec3| {
                (pose.perturbed(&turn, &shift) * mounting)
                    .map(&x)
                    .dot(&normal)
            };
            let by_mounting = |turn: Vec3, shift: Vec3| {
                (pose * mounting.perturbed(&turn, &shift))
                    .map(&x)
                    .dot(&normal)
            };
            for (row, moved) in [
                (row_by_pose, &by_pose as &dyn Fn(Vec3, Vec3) -> f64),
                (row_by_mounting, &by_mounting),
            ] {
                let turned = (moved(d, zero) - moved(-d, zero)) / (2.0 * h);
                let shifted = (moved(zero, d) - moved(zero, -d)) / (2.0 * h);
                assert!((turned - row.rotation[axis]).abs() < 1e-9);
                assert!((shifted - row.translation[axis]).abs() < 1e-9);
            }
        }
    }
}
