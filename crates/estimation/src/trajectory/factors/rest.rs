//! A body at rest.

use super::jacobian::put;
use crate::adjustment::{FactorRows, STEP};
use crate::geometry::Mat3;
use crate::trajectory::states::{NodeState, VELOCITY};

/// The velocity of a body that is at rest according to the logs: r = v, m/s.
#[derive(Debug, Clone, Copy)]
pub struct RestFactor {
    pub sigma_m_s: f64,
}

impl RestFactor {
    /// Whitened rows.
    pub fn rows(&self, node: &NodeState) -> FactorRows<3> {
        let mut by_step = [[0.0; STEP]; 3];
        let weight = Mat3::identity() * (1.0 / self.sigma_m_s);
        put(&mut by_step, 0, VELOCITY, &weight);
        FactorRows::new(self.whitened(node), by_step)
    }

    /// The residual in standard deviations.
    pub fn whitened(&self, node: &NodeState) -> [f64; 3] {
        (node.velocity_m_s * (1.0 / self.sigma_m_s)).into()
    }
}
