//! Jacobians with respect to the unknowns of a step.

use crate::adjustment::STEP;
use crate::geometry::{Mat3, Rotation};

/// Rows of a Jacobian with respect to node i, node i + 1 and the bias.
pub type Jacobian<const R: usize> = [[f64; STEP]; R];

/// Writes a 3 × 3 block whose first element lies at this row and column.
pub fn put<const R: usize>(rows: &mut Jacobian<R>, row: usize, column: usize, block: &Mat3) {
    for i in 0..3 {
        for j in 0..3 {
            rows[row + i][column + j] = block[(i, j)];
        }
    }
}

pub fn matrix(rotation: &Rotation) -> Mat3 {
    rotation.to_rotation_matrix().into_inner()
}
