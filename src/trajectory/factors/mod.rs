//! The residuals of the factor graph, with analytic derivatives, and how they enter the normal
//! equations. Attitudes are perturbed as R ← R Exp(δφ), positions and velocities by addition.

mod ahead;
mod heading;
mod imu;
mod position;
#[cfg(test)]
mod tests;

pub(super) use ahead::Ahead;
pub(super) use heading::{HeadingFactor, Quantity};
pub(super) use imu::ImuFactor;
pub(super) use position::{PositionColumns, PositionFactor, PositionSensor};

use super::chain::{Border, NODE, STEP, StepSystem};
use super::constants::Constants;
use super::preintegration::MotionSums;
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::sensor::ImuBias;

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

impl MotionSums {
    /// Where these sums, corrected to `bias`, lead from a node.
    pub(super) fn lead(&self, bias: &ImuBias, gravity_m_s2: f64, from: &NodeState) -> NodeState {
        let (by, dt) = (self.corrected(bias), self.duration_s);
        let gravity = Vec3::new(0.0, 0.0, -gravity_m_s2);
        NodeState {
            rotation: from.rotation * by.rotation,
            position_m: from.position_m
                + from.velocity_m_s * dt
                + gravity * (0.5 * dt * dt)
                + from.rotation * by.position_m,
            velocity_m_s: from.velocity_m_s + gravity * dt + from.rotation * by.velocity_m_s,
        }
    }
}

/// First columns of a step's unknowns: attitude, position and velocity of node i, then node
/// i + 1 and the bias.
pub(super) const ATTITUDE: usize = 0;
pub(super) const POSITION: usize = 3;
pub(super) const VELOCITY: usize = 6;
pub(super) const GYRO: usize = 2 * NODE;
pub(super) const ACCEL: usize = 2 * NODE + 3;

/// Rows of a Jacobian over a step's unknowns.
pub(super) type Rows<const R: usize> = [[f64; STEP]; R];
/// A constant's column of the border, and the derivatives of the R residuals by it.
pub(super) type Row<const R: usize> = (usize, [f64; R]);

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

/// Adds whitened rows: H += Jᵀ J, g −= Jᵀ r, with the columns of the constants.
fn add_rows<const R: usize>(
    system: &mut StepSystem,
    border: &mut Border,
    rows: &Rows<R>,
    by_constants: &[Row<R>],
    residual: &[f64; R],
) {
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
    for (i, (column, by)) in by_constants.iter().enumerate() {
        for (row, (own, r)) in rows.iter().zip(by.iter().zip(residual)) {
            for (x, j) in border.h[*column].iter_mut().zip(row) {
                *x += own * j;
            }
            border.g[*column] -= own * r;
        }
        for (other, theirs) in &by_constants[i..] {
            let sum: f64 = by.iter().zip(theirs).map(|(a, b)| a * b).sum();
            let (a, b) = (*column.min(other), *column.max(other));
            border.c[a * border.count + b] += sum;
        }
    }
}

/// How fast the body moves where the logs show that it rests: r = v, m/s.
#[derive(Debug, Clone, Copy)]
pub(super) struct RestFactor {
    pub sigma_m_s: f64,
}

impl RestFactor {
    /// Normalised derivatives and residual.
    pub fn rows(&self, node: &NodeState) -> (Rows<3>, [f64; 3]) {
        let weight = 1.0 / self.sigma_m_s;
        let mut rows = [[0.0; STEP]; 3];
        put(&mut rows, 0, VELOCITY, &(Mat3::identity() * weight));
        (rows, (node.velocity_m_s * weight).into())
    }

    /// Adds the factor to its step.
    pub fn add_to(&self, system: &mut StepSystem, border: &mut Border, node: &NodeState) {
        let (rows, residual) = self.rows(node);
        add_rows(system, border, &rows, &[], &residual);
    }
}
