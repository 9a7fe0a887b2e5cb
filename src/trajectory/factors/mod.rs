//! The residuals of the factor graph, with analytic derivatives, and how they enter the normal
//! equations. Attitudes are perturbed as R ← R Exp(δφ), positions and velocities by addition.

mod fixes;
mod imu;
#[cfg(test)]
mod tests;

pub(super) use fixes::{Ahead, HeadingFactor, PrismFactor};
pub(super) use imu::ImuFactor;

use super::chain::{NODE, STEP, StepSystem};
use crate::geometry::{Mat3, Rotation, Vec3};

/// The motion state at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NodeState {
    /// world_from_body.
    pub rotation: Rotation,
    /// World.
    pub position_m: Vec3,
    /// World.
    pub velocity_m_s: Vec3,
}

/// First columns of a step's unknowns: attitude, position and velocity of node i, then node
/// i + 1 and the bias.
const ATTITUDE: usize = 0;
const POSITION: usize = 3;
const VELOCITY: usize = 6;
const GYRO: usize = 2 * NODE;
const ACCEL: usize = 2 * NODE + 3;

/// Rows of a Jacobian over a step's unknowns.
type Rows<const R: usize> = [[f64; STEP]; R];

fn put<const R: usize>(rows: &mut Rows<R>, row: usize, column: usize, block: &Mat3) {
    for i in 0..3 {
        for j in 0..3 {
            rows[row + i][column + j] = block[(i, j)];
        }
    }
}

fn matrix(rotation: &Rotation) -> Mat3 {
    rotation.to_rotation_matrix().into_inner()
}

/// Adds whitened rows: H += Jᵀ J, g −= Jᵀ r.
fn add_rows<const R: usize>(system: &mut StepSystem, rows: &Rows<R>, residual: &[f64; R]) {
    for (row, r) in rows.iter().zip(residual) {
        for a in 0..STEP {
            let factor = row[a];
            if factor == 0.0 {
                continue;
            }
            // Upper triangle, from the multiple of 4 at or below the diagonal: whole vectors.
            let start = a & !3;
            for (x, j) in system.h[a][start..].iter_mut().zip(&row[start..]) {
                *x += factor * j;
            }
            system.g[a] -= factor * r;
        }
    }
}
