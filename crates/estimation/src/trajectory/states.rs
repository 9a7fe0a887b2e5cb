//! The unknowns of a trajectory.

use super::constants::Constants;
use crate::adjustment::{NODE, SEGMENT, Unknown};
use crate::geometry::{Vec3, WorldFromBody};
use crate::sensor::ImuBias;

/// Unknowns of the biases of the IMU, which a segment of steps shares: gyro, accelerometer.
pub const BIAS: usize = SEGMENT;

/// First columns of a step's unknowns: attitude, position and velocity of node i, then of node
/// i + 1, and the bias.
pub const ATTITUDE: usize = 0;
pub const POSITION: usize = 3;
pub const VELOCITY: usize = 6;
pub const GYRO: usize = 2 * NODE;
pub const ACCEL: usize = 2 * NODE + 3;

/// The motion state at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeState {
    pub world_from_body: WorldFromBody,
    /// World.
    pub velocity_m_s: Vec3,
}

/// δφ, δp as [`Transform`](crate::geometry::Transform#perturbations) says, δv in world axes.
impl Unknown for NodeState {
    const DIMENSION: usize = NODE;

    fn retracted(&self, step: &[f64]) -> Self {
        Self {
            world_from_body: self.world_from_body.retracted(&step[..VELOCITY]),
            velocity_m_s: self.velocity_m_s.retracted(&step[VELOCITY..]),
        }
    }

    fn step_from(&self, origin: &Self, step: &mut [f64]) {
        let (pose, velocity) = step.split_at_mut(VELOCITY);
        self.world_from_body
            .step_from(&origin.world_from_body, pose);
        self.velocity_m_s.step_from(&origin.velocity_m_s, velocity);
    }
}

impl Unknown for ImuBias {
    const DIMENSION: usize = BIAS;

    fn retracted(&self, step: &[f64]) -> Self {
        Self {
            gyro_rad_s: self.gyro_rad_s.retracted(&step[..3]),
            accel_m_s2: self.accel_m_s2.retracted(&step[3..]),
        }
    }

    fn step_from(&self, origin: &Self, step: &mut [f64]) {
        let (gyro, accel) = step.split_at_mut(3);
        self.gyro_rad_s.step_from(&origin.gyro_rad_s, gyro);
        self.accel_m_s2.step_from(&origin.accel_m_s2, accel);
    }
}

/// All unknowns.
#[derive(Debug, Clone)]
pub struct State {
    pub nodes: Vec<NodeState>,
    pub biases: Vec<ImuBias>,
    pub constants: Constants,
}
