//! Poses within a step, and at any time between them.

use crate::geometry::so3::{exp, log};
use crate::geometry::{Vec3, WorldFromBody};

/// Unknowns of a bridge.
pub const BRIDGE: usize = 3;
/// Place of the first of these: after the largest number of unknowns of two nodes.
pub const AT_BRIDGE: usize = 18;
/// Most unknowns of a step.
const WIDTH: usize = AT_BRIDGE + BRIDGE;

/// Derivatives of a pose (δφ, δp) by the unknowns of both nodes, node i first, and of the bridge.
pub type PoseDerivative = [[f64; WIDTH]; 6];

/// Derivatives of a number by the unknowns of both nodes, node i first, and of the bridge.
pub type NodeGradient = [f64; WIDTH];

/// A pose within a step.
#[derive(Debug, Clone)]
pub struct Knot {
    /// Seconds.
    pub time_s: f64,
    /// The pose.
    pub world_from_body: WorldFromBody,
    /// World, m/s; `None` if positions are joined by straight lines.
    pub velocity_m_s: Option<Vec3>,
    /// Derivatives by the leading unknowns of both nodes, and by the bridge.
    pub by: PoseDerivative,
}

/// The poses of a step in time order, its nodes first and last.
#[derive(Debug, Clone)]
pub struct StepPoses {
    /// Two or more.
    pub knots: Vec<Knot>,
    /// Unknowns of one node that poses depend on.
    pub width: usize,
}

/// A pose at a time with the body's motion.
#[derive(Debug, Clone, Copy)]
pub struct MovingPose {
    /// The pose.
    pub world_from_body: WorldFromBody,
    /// World, m/s.
    pub velocity_m_s: Vec3,
    /// Turning rate in the body frame, rad/s.
    pub rate_rad_s: Vec3,
}

impl StepPoses {
    /// The knot that begins the interval of a time, and the fraction of the interval passed; below
    /// 0 or above 1 outside the step.
    fn locate(&self, time_s: f64) -> (usize, f64) {
        let after = self.knots.partition_point(|knot| knot.time_s <= time_s);
        let index = after.saturating_sub(1).min(self.knots.len() - 2);
        let (a, b) = (self.knots[index].time_s, self.knots[index + 1].time_s);
        (index, (time_s - a) / (b - a))
    }

    /// The pose at a time: positions on the cubic Hermite curve, attitudes turning at constant rate,
    /// as [`Trajectory`](crate::trajectory::Trajectory) does.
    pub fn at(&self, time_s: f64) -> MovingPose {
        let (index, u) = self.locate(time_s);
        let (a, b) = (&self.knots[index], &self.knots[index + 1]);
        let dt = b.time_s - a.time_s;
        let (pa, pb) = (
            a.world_from_body.translation_m,
            b.world_from_body.translation_m,
        );
        let (position_m, velocity_m_s) = match (a.velocity_m_s, b.velocity_m_s) {
            (Some(va), Some(vb)) => {
                let (u2, u3) = (u * u, u * u * u);
                let position = pa * (2.0 * u3 - 3.0 * u2 + 1.0)
                    + va * (dt * (u3 - 2.0 * u2 + u))
                    + pb * (3.0 * u2 - 2.0 * u3)
                    + vb * (dt * (u3 - u2));
                (position, va * (1.0 - u) + vb * u)
            }
            _ => (pa + (pb - pa) * u, (pb - pa) / dt),
        };
        let turn = log(&(a.world_from_body.rotation.inverse() * b.world_from_body.rotation));
        let rotation = a.world_from_body.rotation * exp(&(turn * u));
        MovingPose {
            world_from_body: WorldFromBody::new(rotation, position_m),
            velocity_m_s,
            rate_rad_s: turn / dt,
        }
    }

    /// Adds a gradient by the pose at a time (δφ, δp) to one by the unknowns of both nodes. Between
    /// knots, derivatives are those of the knots in proportion.
    pub fn pull_back(&self, time_s: f64, by_pose: &[f64; 6], by_nodes: &mut NodeGradient) {
        let (index, u) = self.locate(time_s);
        for (knot, share) in [(index, 1.0 - u), (index + 1, u)] {
            for (row, value) in self.knots[knot].by.iter().zip(by_pose) {
                let factor = share * value;
                for (x, d) in by_nodes.iter_mut().zip(row) {
                    *x += factor * d;
                }
            }
        }
    }
}

/// Derivatives of a node's pose by its own unknowns, which begin at column `first`; the first six are (δφ,
/// δp).
pub fn node_derivative(first: usize) -> PoseDerivative {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| f64::from(u8::from(column == first + row)))
    })
}
