//! The antenna baseline: heading and pitch.

use super::jacobian::touch_gyro_scale;
use super::propagation::{Propagated, Propagation};
use crate::adjustment::{FactorRows, STEP};
use crate::geometry::heading::{heading_rad, wrap};
use crate::geometry::{Rotation, Vec3};
use crate::sensor::ImuBias;
use crate::trajectory::constants::{Constants, LateBy};
use crate::trajectory::states::{ATTITUDE, GYRO, NodeState};

/// What the antennas measure at a time: r = heading(R(t)) − z − o − c(t) wrapped into (−π, π], and
/// r = elevation(R(t) b) − z for the pitch, radians. o is an estimated correction of the mounting
/// offset, c the lasting error, b the direction of the baseline in the body.
#[derive(Debug, Clone)]
pub struct HeadingFactor {
    pub propagation: Propagation,
    /// Number of the record in its log, from 0.
    pub record: usize,
    pub time_s: f64,
    pub quantity: Quantity,
    pub value_rad: f64,
    pub sigma_rad: f64,
    /// Weight given by the loss, 0 to 1.
    pub weight: f64,
    /// The clocks that apply to the record.
    pub clocks: Vec<LateBy>,
}

/// The quantity that a [`HeadingFactor`] compares.
#[derive(Debug, Clone, Copy)]
pub enum Quantity {
    /// Grid heading of the body's x axis, clockwise from north.
    Heading,
    /// Elevation of this direction of the body above the horizon.
    Pitch(Vec3),
}

/// Smallest squared horizontal length used as a divisor: within a milliradian of the vertical there is
/// no heading.
const MIN_HORIZONTAL_SQUARED: f64 = 1e-6;

impl Quantity {
    fn direction(&self) -> Vec3 {
        match self {
            Self::Heading => Vec3::x(),
            Self::Pitch(baseline) => *baseline,
        }
    }

    /// Its value at this attitude, radians.
    fn value_rad(&self, world_from_body: &Rotation) -> f64 {
        match self {
            Self::Heading => heading_rad(world_from_body),
            Self::Pitch(baseline) => (world_from_body * baseline).z.clamp(-1.0, 1.0).asin(),
        }
    }

    /// Derivative with respect to the world coordinates of the direction.
    fn gradient(&self, world_from_body: &Rotation) -> Vec3 {
        let x = world_from_body * self.direction();
        let horizontal = (x.x * x.x + x.y * x.y).max(MIN_HORIZONTAL_SQUARED);
        match self {
            Self::Heading => Vec3::new(x.y, -x.x, 0.0) / horizontal,
            Self::Pitch(_) => Vec3::new(0.0, 0.0, 1.0 / horizontal.sqrt()),
        }
    }
}

impl HeadingFactor {
    fn propagated(&self, constants: &Constants, node: &NodeState, bias: &ImuBias) -> Propagated {
        let late_s = constants.late_s(&self.clocks);
        self.propagation.propagate(constants, node, bias, late_s)
    }

    fn residual_at(&self, constants: &Constants, at: &Propagated) -> f64 {
        let offset = match self.quantity {
            Quantity::Heading => {
                constants.heading_offset_rad.value + constants.lasting_rad(self.time_s)
            }
            Quantity::Pitch(_) => 0.0,
        };
        wrap(self.quantity.value_rad(&at.world_from_body.rotation) - self.value_rad - offset)
    }

    /// The residual r, radians.
    pub fn residual(&self, constants: &Constants, node: &NodeState, bias: &ImuBias) -> f64 {
        self.residual_at(constants, &self.propagated(constants, node, bias))
    }

    /// The residual in standard deviations.
    pub fn whitened(&self, constants: &Constants, node: &NodeState, bias: &ImuBias) -> [f64; 1] {
        [self.residual(constants, node, bias) / self.sigma_with(constants)]
    }

    /// The standard deviation of the record's noise and of the lasting errors that are taken for it.
    fn sigma_with(&self, constants: &Constants) -> f64 {
        match self.quantity {
            Quantity::Heading => self.sigma_rad * constants.heading_noise(),
            Quantity::Pitch(_) => self.sigma_rad,
        }
    }

    /// Whitened rows.
    pub fn rows(&self, constants: &Constants, node: &NodeState, bias: &ImuBias) -> FactorRows<1> {
        let at = self.propagated(constants, node, bias);
        let sigma_rad = self.sigma_with(constants);
        let weight = 1.0 / sigma_rad;
        let direction = self.quantity.direction();
        let gradient = self.quantity.gradient(&at.world_from_body.rotation);
        let (by_attitude, by_gyro) = self.propagation.turned_jacobian(&at, node, &direction);
        let attitude = by_attitude.transpose() * gradient;
        let gyro = by_gyro.transpose() * gradient;
        let mut by_step = [[0.0; STEP]; 1];
        for i in 0..3 {
            by_step[0][ATTITUDE + i] = attitude[i] * weight;
            by_step[0][GYRO + i] = gyro[i] * weight;
        }
        let residual = self.residual_at(constants, &at) / sigma_rad;
        let mut rows = FactorRows::new([residual], by_step);
        touch_gyro_scale(&mut rows, &constants.gyro_scale, || {
            self.propagation.mean_rate_rad_s()
        });
        let by_time = gradient.dot(&at.turning(&direction)) * weight;
        for late in &self.clocks {
            if let Some(block) = constants.clock(late.clock).block() {
                rows.touch(block, [[by_time * late.share]]);
            }
        }
        if matches!(self.quantity, Quantity::Heading) {
            if let Some(block) = constants.heading_offset_rad.block() {
                rows.touch(block, [[-weight]]);
            }
            for (amplitude, by) in constants.lasting_heading(self.time_s) {
                if let Some(block) = amplitude.block() {
                    rows.touch(block, [[-weight * by]]);
                }
            }
        }
        rows
    }
}
