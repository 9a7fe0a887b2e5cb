//! Prisms and GNSS antennas.

use super::{Ahead, Constants, NodeState, Row, Rows, STEP, add_rows};
use crate::geometry::so3::hat;
use crate::geometry::{Mat3, Vec3};
use crate::sensor::ImuBias;
use crate::trajectory::chain::{Border, StepSystem};

/// Periods of the incidence-dependent error of a 360° prism in a turn: one for each of its facets.
const FACETS: f64 = 6.0;

/// A fix of a prism or antenna: r = p(t) + R(t) l + e − z, metres in the world.
///
/// e is the error of a 360° prism that turns with the angle of incidence α of the line of sight in
/// the body's horizontal plane: for each of the directions along and across the line of sight and
/// up, a cos 6α + b sin 6α.
#[derive(Debug, Clone)]
pub(in crate::trajectory) struct PositionFactor {
    pub ahead: Ahead,
    /// Which of the position sensors.
    pub sensor: usize,
    /// Number of the record in its log, from 0.
    pub record: usize,
    pub time_s: f64,
    pub position_m: Vec3,
    /// W with Wᵀ W the inverse of the covariance.
    pub whitener: Mat3,
    /// Weight that the loss leaves, 0 to 1.
    pub weight: f64,
    pub late: Late,
}

/// The columns of the constants that say how late a record is.
pub(in crate::trajectory) type Late = Vec<usize>;

/// The constants a position sensor may have, as their first columns.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::trajectory) struct PositionColumns {
    pub lever_arm: Option<usize>,
    pub incidence: Option<usize>,
}

/// What is fixed about a position sensor.
#[derive(Debug, Clone, Copy)]
pub(in crate::trajectory) struct PositionSensor {
    pub lever_arm_m: Vec3,
    pub station_m: Option<Vec3>,
    /// Upwards in the body frame.
    pub up: Vec3,
    pub columns: PositionColumns,
}

impl PositionSensor {
    /// The lever arm with its estimated correction.
    pub fn lever_arm(&self, constants: &[f64]) -> Vec3 {
        match self.columns.lever_arm {
            Some(c) => {
                self.lever_arm_m + Vec3::new(constants[c], constants[c + 1], constants[c + 2])
            }
            None => self.lever_arm_m,
        }
    }

    /// The six directions that the amplitudes of the incidence-dependent error multiply.
    fn incidence_basis(&self, prism_m: &Vec3, rotation: &crate::geometry::Rotation) -> [Vec3; 6] {
        let station = self.station_m.unwrap_or_default();
        let sight = (prism_m - station).normalize();
        let seen = rotation.inverse() * sight;
        let level = self.up.cross(&Vec3::x());
        let angle = FACETS * seen.dot(&level).atan2(seen.x);
        let across = Vec3::z().cross(&sight);
        let (sin, cos) = angle.sin_cos();
        [
            sight * cos,
            sight * sin,
            across * cos,
            across * sin,
            Vec3::z() * cos,
            Vec3::z() * sin,
        ]
    }
}

impl PositionFactor {
    fn late_s(&self, constants: &[f64]) -> f64 {
        self.late.iter().map(|&c| constants[c]).sum()
    }

    pub fn residual(
        &self,
        sensor: &PositionSensor,
        gravity_m_s2: f64,
        node: &NodeState,
        bias: &ImuBias,
        constants: &[f64],
    ) -> Vec3 {
        let at = self
            .ahead
            .reach(gravity_m_s2, node, bias, self.late_s(constants));
        let prism = at.position_m + at.rotation * sensor.lever_arm(constants);
        let mut residual = prism - self.position_m;
        if let Some(c) = sensor.columns.incidence {
            let basis = sensor.incidence_basis(&prism, &at.rotation);
            residual += basis
                .iter()
                .zip(&constants[c..])
                .map(|(direction, amplitude)| direction * *amplitude)
                .sum::<Vec3>();
        }
        residual
    }

    /// W r, without the weight of the loss.
    pub fn normalised(&self, residual: &Vec3) -> Vec3 {
        self.whitener * residual
    }

    /// Derivatives by the step's unknowns and by the constants, before whitening. Left out is how
    /// the direction of the incidence-dependent error turns with the attitude: its amplitude of
    /// millimetres stands beside the lever arm's decimetres.
    pub(in crate::trajectory) fn jacobian(
        &self,
        sensor: &PositionSensor,
        known: &Constants,
        node: &NodeState,
        bias: &ImuBias,
        constants: &[f64],
    ) -> (Rows<3>, Vec<Row<3>>) {
        let gravity = known.gravity_m_s2(constants);
        let at = self
            .ahead
            .reach(gravity, node, bias, self.late_s(constants));
        let arm = sensor.lever_arm(constants);
        let rows = self.ahead.position_jacobian(&at, node, bias, &arm);
        let mut by_constants = Vec::new();
        let mut put = |column: usize, by: Vec3| by_constants.push((column, [by.x, by.y, by.z]));
        if !self.late.is_empty() {
            let by_time = at.velocity_m_s + at.rotation * (hat(&at.rate_rad_s) * arm);
            self.late.iter().for_each(|&c| put(c, by_time));
        }
        if let Some(c) = sensor.columns.lever_arm {
            (0..3).for_each(|axis| put(c + axis, at.rotation * Vec3::ith(axis, 1.0)));
        }
        if let Some(c) = sensor.columns.incidence {
            let prism = at.position_m + at.rotation * arm;
            let basis = sensor.incidence_basis(&prism, &at.rotation);
            (0..6).for_each(|i| put(c + i, basis[i]));
        }
        if let Some(c) = known.gravity {
            put(c, Ahead::gravity_jacobian(&at));
        }
        (rows, by_constants)
    }

    /// Whitened and weighted derivatives and residual.
    pub fn rows(
        &self,
        sensor: &PositionSensor,
        known: &Constants,
        node: &NodeState,
        bias: &ImuBias,
        constants: &[f64],
    ) -> (Rows<3>, Vec<Row<3>>, [f64; 3]) {
        let (raw, raw_constants) = self.jacobian(sensor, known, node, bias, constants);
        let residual = self.residual(sensor, known.gravity_m_s2(constants), node, bias, constants);
        let w = self.whitener * self.weight.sqrt();
        let mut rows = [[0.0; STEP]; 3];
        for (a, row) in rows.iter_mut().enumerate() {
            for (b, source) in raw.iter().enumerate() {
                for (x, j) in row.iter_mut().zip(source) {
                    *x += w[(a, b)] * j;
                }
            }
        }
        let by_constants = raw_constants
            .iter()
            .map(|(column, by)| (*column, (w * Vec3::from(*by)).into()))
            .collect();
        (rows, by_constants, (w * residual).into())
    }

    /// Adds the factor to its step.
    pub fn add_to(
        &self,
        system: &mut StepSystem,
        border: &mut Border,
        sensor: &PositionSensor,
        known: &Constants,
        (node, bias, constants): (&NodeState, &ImuBias, &[f64]),
    ) {
        if self.weight > 0.0 {
            let (rows, by_constants, residual) = self.rows(sensor, known, node, bias, constants);
            add_rows(system, border, &rows, &by_constants, &residual);
        }
    }
}
