//! Jacobians with respect to the unknowns of a step.

use crate::adjustment::{FactorRows, STEP};
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::trajectory::gyro_scale::GyroScale;
use crate::trajectory::states::GYRO;

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

/// Adds the derivatives of rows by the scale factor of the gyroscope, if it is estimated, in a step with this mean rate:
/// those by the bias that it acts as.
pub fn touch_gyro_scale<const R: usize>(
    rows: &mut FactorRows<R>,
    scale: &GyroScale,
    mean_rate_rad_s: impl FnOnce() -> Vec3,
) {
    let Some(block) = scale.factor.block() else {
        return;
    };
    let by_factor = scale.by_factor(&mean_rate_rad_s());
    let column = |axis: usize| rows.by_step.map(|row| row[GYRO + axis] * by_factor[axis]);
    let columns = [0, 1, 2].map(column);
    rows.touch(block, columns);
}
