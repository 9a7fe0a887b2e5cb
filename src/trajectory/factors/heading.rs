//! The antenna baseline: heading and pitch.

use super::position::Late;
use super::{ATTITUDE, Ahead, Constants, GYRO, NodeState, Row, Rows, STEP, add_rows};
use crate::geometry::heading::{heading_rad, wrap};
use crate::geometry::so3::hat;
use crate::geometry::{Rotation, Vec3};
use crate::sensor::ImuBias;
use crate::trajectory::chain::{Border, StepSystem};

/// What the antennas say at a time: r = heading(R(t)) − z − o wrapped into (−π, π], and
/// r = elevation(R(t) b) − z for the pitch, radians. o is an estimated correction of the mounting
/// offset, b the direction of the baseline in the body.
#[derive(Debug, Clone)]
pub(in crate::trajectory) struct HeadingFactor {
    pub ahead: Ahead,
    /// Number of the record in its log, from 0.
    pub record: usize,
    pub time_s: f64,
    pub quantity: Quantity,
    pub value_rad: f64,
    pub sigma_rad: f64,
    /// Weight that the loss leaves, 0 to 1.
    pub weight: f64,
    pub late: Late,
}

/// What a [`HeadingFactor`] compares.
#[derive(Debug, Clone, Copy)]
pub(in crate::trajectory) enum Quantity {
    /// Grid heading of the body's x axis, clockwise from north.
    Heading,
    /// Elevation of this direction of the body above the horizon.
    Pitch(Vec3),
}

/// Least squared horizontal length that is divided by: nose-up within a milliradian of the vertical
/// there is no heading.
const LEAST_HORIZONTAL_SQUARED: f64 = 1e-6;

impl Quantity {
    fn direction(&self) -> Vec3 {
        match self {
            Self::Heading => Vec3::x(),
            Self::Pitch(baseline) => *baseline,
        }
    }

    fn of(&self, rotation: &Rotation) -> f64 {
        match self {
            Self::Heading => heading_rad(rotation),
            Self::Pitch(baseline) => (rotation * baseline).z.clamp(-1.0, 1.0).asin(),
        }
    }

    /// Derivative by the world coordinates of the direction.
    fn gradient(&self, rotation: &Rotation) -> Vec3 {
        let x = rotation * self.direction();
        let horizontal = (x.x * x.x + x.y * x.y).max(LEAST_HORIZONTAL_SQUARED);
        match self {
            Self::Heading => Vec3::new(x.y, -x.x, 0.0) / horizontal,
            Self::Pitch(_) => Vec3::new(0.0, 0.0, 1.0 / horizontal.sqrt()),
        }
    }
}

impl HeadingFactor {
    fn late_s(&self, constants: &[f64]) -> f64 {
        self.late.iter().map(|&c| constants[c]).sum()
    }

    pub fn residual(
        &self,
        known: &Constants,
        node: &NodeState,
        bias: &ImuBias,
        constants: &[f64],
    ) -> f64 {
        let gravity = known.gravity_m_s2(constants);
        let at = self
            .ahead
            .reach(gravity, node, bias, self.late_s(constants));
        let offset = match (self.quantity, known.heading_offset) {
            (Quantity::Heading, Some(c)) => constants[c],
            _ => 0.0,
        };
        wrap(self.quantity.of(&at.rotation) - self.value_rad - offset)
    }

    pub(in crate::trajectory) fn jacobian(
        &self,
        known: &Constants,
        node: &NodeState,
        bias: &ImuBias,
        constants: &[f64],
    ) -> (Rows<1>, Vec<Row<1>>) {
        let gravity = known.gravity_m_s2(constants);
        let at = self
            .ahead
            .reach(gravity, node, bias, self.late_s(constants));
        let direction = self.quantity.direction();
        let gradient = self.quantity.gradient(&at.rotation);
        let (by_attitude, by_gyro) = self.ahead.turned_jacobian(&at, node, bias, &direction);
        let (attitude, gyro) = (
            by_attitude.transpose() * gradient,
            by_gyro.transpose() * gradient,
        );
        let mut rows = [[0.0; STEP]; 1];
        for i in 0..3 {
            rows[0][ATTITUDE + i] = attitude[i];
            rows[0][GYRO + i] = gyro[i];
        }
        let mut by_constants = Vec::new();
        if !self.late.is_empty() {
            let moving = at.rotation * (hat(&at.rate_rad_s) * direction);
            let by_time = gradient.dot(&moving);
            by_constants.extend(self.late.iter().map(|&c| (c, [by_time])));
        }
        if let (Quantity::Heading, Some(c)) = (self.quantity, known.heading_offset) {
            by_constants.push((c, [-1.0]));
        }
        (rows, by_constants)
    }

    /// Normalised and weighted derivatives and residual.
    pub fn rows(
        &self,
        known: &Constants,
        node: &NodeState,
        bias: &ImuBias,
        constants: &[f64],
    ) -> (Rows<1>, Vec<Row<1>>, [f64; 1]) {
        let weight = self.weight.sqrt() / self.sigma_rad;
        let (raw, raw_constants) = self.jacobian(known, node, bias, constants);
        let residual = self.residual(known, node, bias, constants);
        let by_constants = raw_constants
            .iter()
            .map(|(column, by)| (*column, [by[0] * weight]))
            .collect();
        (
            raw.map(|row| row.map(|x| x * weight)),
            by_constants,
            [residual * weight],
        )
    }

    /// Adds the factor to its step.
    pub fn add_to(
        &self,
        system: &mut StepSystem,
        border: &mut Border,
        known: &Constants,
        (node, bias, constants): (&NodeState, &ImuBias, &[f64]),
    ) {
        if self.weight > 0.0 {
            let (rows, by_constants, residual) = self.rows(known, node, bias, constants);
            add_rows(system, border, &rows, &by_constants, &residual);
        }
    }
}
