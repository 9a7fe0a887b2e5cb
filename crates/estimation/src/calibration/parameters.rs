//! The unknowns: six parameters per scanner, free or fixed.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::geometry::euler::{euler_deg_from_rotation, euler_jacobian, rotation_from_euler_deg};
use crate::geometry::so3::exp;
use crate::geometry::{BodyFromScanner, EulerConvention, Mat3, Vec3};

/// Names of the six parameters of a mounting: translation, then rotation about the body's axes.
pub const PARAMETER_NAMES: [&str; 6] = ["tx", "ty", "tz", "rx", "ry", "rz"];

/// The mounting of one scanner and its fixed parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mounting {
    /// Name of the scanner.
    pub name: String,
    /// Current estimate.
    pub body_from_scanner: BodyFromScanner,
    /// Convention of the angles in `fixed`.
    pub convention: EulerConvention,
    /// Parameters held at their values: tx ty tz rx ry rz, the last three being the Euler angles
    /// (α, β, γ) of `convention`.
    pub fixed: [bool; 6],
}

impl Mounting {
    /// A mounting with all parameters free.
    pub fn new(name: impl Into<String>, body_from_scanner: BodyFromScanner) -> Self {
        Self {
            name: name.into(),
            body_from_scanner,
            convention: EulerConvention::default(),
            fixed: [false; 6],
        }
    }

    /// Basis of this scanner's free [perturbations](crate::geometry::Transform#perturbations)
    /// (δp, δφ), in the order of the parameters: a 6 × f matrix.
    ///
    /// If all rotations are free, the basis is δφ itself; if single Euler angles are fixed, each
    /// column changes one of the other angles alone.
    fn free_basis(&self) -> DMatrix<f64> {
        let mut columns: Vec<[f64; 6]> = Vec::new();
        for axis in (0..3).filter(|&axis| !self.fixed[axis]) {
            let mut column = [0.0; 6];
            column[axis] = 1.0;
            columns.push(column);
        }
        let per_angle = self.body_rotation_from_angles();
        for angle in (0..3).filter(|&angle| !self.fixed[3 + angle]) {
            let mut column = [0.0; 6];
            for axis in 0..3 {
                column[3 + axis] = match per_angle {
                    Some(ref jacobian) => jacobian[(axis, angle)],
                    None => f64::from(u8::from(axis == angle)),
                };
            }
            columns.push(column);
        }
        DMatrix::from_fn(6, columns.len(), |row, column| columns[column][row])
    }

    /// dφ/d(α, β, γ) if any angle is fixed, `None` if all three are free.
    fn body_rotation_from_angles(&self) -> Option<Mat3> {
        if !self.fixed[3..].contains(&true) {
            return None;
        }
        self.angles_from_body_rotation().try_inverse()
    }

    /// d(α, β, γ)/dφ in the mounting's own convention, radians per radian.
    fn angles_from_body_rotation(&self) -> Mat3 {
        euler_jacobian_body(self.convention, &self.body_from_scanner)
    }

    /// The mounting perturbed by (δp, δφ). Fixed parameters stay unchanged to the last bit, except for
    /// single angles, which the conversion rounds.
    fn moved(&self, delta: &[f64]) -> Self {
        let mut moved = self.clone();
        let dp_m = Vec3::new(delta[0], delta[1], delta[2]);
        let dphi_rad = Vec3::new(delta[3], delta[4], delta[5]);
        moved.body_from_scanner = self.body_from_scanner.perturbed(&dphi_rad, &dp_m);
        for axis in (0..3).filter(|&axis| self.fixed[axis]) {
            moved.body_from_scanner.translation_m[axis] =
                self.body_from_scanner.translation_m[axis];
        }
        if self.fixed[3..] == [true; 3] {
            moved.body_from_scanner.rotation = self.body_from_scanner.rotation;
        } else if self.fixed[3..].contains(&true) {
            let rotation = &mut moved.body_from_scanner.rotation;
            let held = euler_deg_from_rotation(self.convention, &self.body_from_scanner.rotation);
            let mut angles = euler_deg_from_rotation(self.convention, rotation);
            for axis in (0..3).filter(|&axis| self.fixed[3 + axis]) {
                angles[axis] = held[axis];
            }
            *rotation = rotation_from_euler_deg(self.convention, angles);
        }
        moved
    }
}

/// d(α, β, γ)/dφ for R ← Exp(φ) R: the columns of [`euler_jacobian`] rotated into body axes.
pub fn euler_jacobian_body(
    convention: EulerConvention,
    body_from_scanner: &BodyFromScanner,
) -> Mat3 {
    let rotation = body_from_scanner.rotation;
    euler_jacobian(convention, &rotation) * rotation.inverse().to_rotation_matrix().matrix()
}

/// Block-diagonal basis of the free perturbations of all scanners: 6 s × (number of free
/// parameters).
pub fn free_basis(mountings: &[Mounting]) -> DMatrix<f64> {
    let blocks: Vec<DMatrix<f64>> = mountings.iter().map(Mounting::free_basis).collect();
    let columns = blocks.iter().map(|block| block.ncols()).sum();
    let mut basis = DMatrix::zeros(6 * mountings.len(), columns);
    let mut column = 0;
    for (index, block) in blocks.iter().enumerate() {
        basis
            .view_mut((6 * index, column), block.shape())
            .copy_from(block);
        column += block.ncols();
    }
    basis
}

/// Perturbs every mounting by its six entries of `delta`.
pub fn moved(mountings: &[Mounting], delta: &DVector<f64>) -> Vec<Mounting> {
    mountings
        .iter()
        .enumerate()
        .map(|(index, mounting)| mounting.moved(&delta.as_slice()[6 * index..6 * index + 6]))
        .collect()
}

/// Perturbs every mounting by its six entries of a step that may be long, given the mean x̄ of the points of each scanner,
/// scanner frame, metres: R ← Exp(δφ) R and t ← t + δp − (Exp(δφ) − 1 − δφ×) R x̄, so that R x̄ + t moves by δp + δφ × R x̄.
///
/// Surfaces often determine a turn about the points only weakly. Such a turn by δφ moves a scanner at the distance d from
/// them along an arc. A step along its tangent would carry the points away by d δφ²/2, far more than their noise.
pub fn stepped(mountings: &[Mounting], step: &DVector<f64>, centres_m: &[Vec3]) -> Vec<Mounting> {
    let mut delta = step.clone();
    for (index, (mounting, centre_m)) in mountings.iter().zip(centres_m).enumerate() {
        let turn = delta.fixed_rows::<3>(6 * index + 3).into_owned();
        let arm_m = mounting.body_from_scanner.rotation * centre_m;
        let arc_m = exp(&turn) * arm_m - arm_m - turn.cross(&arm_m);
        let mut shift_m = delta.fixed_rows_mut::<3>(6 * index);
        shift_m -= arc_m;
    }
    moved(mountings, &delta)
}

/// The perturbations (δp, δφ) that turn `from` into `to`.
pub fn change(from: &[Mounting], to: &[Mounting]) -> DVector<f64> {
    let parts = from.iter().zip(to).flat_map(|(from, to)| {
        let (turn, shift) = to
            .body_from_scanner
            .perturbation_from(&from.body_from_scanner);
        [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
    });
    DVector::from_iterator(6 * from.len(), parts)
}

/// The poses of the scanners on the body.
pub fn poses(mountings: &[Mounting]) -> Vec<BodyFromScanner> {
    mountings.iter().map(|m| m.body_from_scanner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left(fixed: [bool; 6]) -> Mounting {
        let convention = EulerConvention::Bonn;
        let rotation = rotation_from_euler_deg(convention, [-145.0, 2.0, 88.0]);
        let pose = BodyFromScanner::new(rotation, Vec3::new(1.2, -0.5, 0.5));
        Mounting {
            convention,
            fixed,
            ..Mounting::new("left", pose)
        }
    }

    #[test]
    fn a_held_angle_stays_and_the_others_move_alone() {
        let fixed = [false, true, false, false, true, false];
        let mounting = left(fixed);
        let basis = mounting.free_basis();
        assert_eq!(basis.ncols(), 4);
        // Column 2 is the direction of α alone: 1e-4 rad along it turns α by 1e-4 and, to second
        // order (1e-8), nothing else.
        let moved = mounting.moved((basis.column(2) * 1e-4).as_slice());
        let before =
            euler_deg_from_rotation(mounting.convention, &mounting.body_from_scanner.rotation);
        let after = euler_deg_from_rotation(mounting.convention, &moved.body_from_scanner.rotation);
        assert!(((after[0] - before[0]).to_radians() - 1e-4).abs() < 1e-7);
        assert!((after[1] - before[1]).abs() < 1e-9);
        assert!((after[2] - before[2]).to_radians().abs() < 1e-7);
    }

    #[test]
    fn free_mountings_move_as_the_tangent_says() {
        let mounting = left([false; 6]);
        assert_eq!(mounting.free_basis(), DMatrix::identity(6, 6));
        let delta = DVector::from_column_slice(&[0.1, 0.2, 0.3, 0.01, -0.02, 0.03]);
        let moved = mounting.moved(delta.as_slice());
        assert!((change(&[mounting], &[moved]) - delta).norm() < 1e-12);
    }

    #[test]
    fn a_step_moves_the_centre_of_the_points_along_its_tangent() {
        let mountings = [left([false; 6])];
        let centre_m = Vec3::new(0.1, -0.2, 0.8);
        let step = DVector::from_column_slice(&[0.01, 0.02, -0.01, 0.1, -0.2, 0.1]);
        let [stepped] = &stepped(&mountings, &step, &[centre_m])[..] else {
            panic!("one mounting")
        };
        let (before, after) = (&mountings[0].body_from_scanner, &stepped.body_from_scanner);
        let turn = Vec3::new(0.1, -0.2, 0.1);
        let along = Vec3::new(0.01, 0.02, -0.01) + turn.cross(&(before.rotation * centre_m));
        let travelled = after.map(&centre_m) - before.map(&centre_m);
        assert!((travelled - along).norm() < 1e-12);
        let plain = moved(&mountings, &step);
        assert_eq!(plain[0].body_from_scanner.rotation, after.rotation);
        // The plain perturbation carries the centre away from it.
        assert!(
            (plain[0].body_from_scanner.map(&centre_m) - before.map(&centre_m) - along).norm()
                > 1e-3
        );
    }
}
