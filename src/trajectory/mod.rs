//! The trajectory: from logs to poses with standard deviations, and poses at any time between.

mod chain;
mod covariance;
mod estimate;
mod factors;
mod initial;
mod interpolate;
mod marginals;
mod preintegration;
mod solution;
mod timeline;

pub use covariance::{PoseGradient, PosteriorCovariance};
pub use estimate::{Estimate, MotionLogs, estimate};
pub use interpolate::{PoseCursor, Trajectory};
pub use solution::{SensorResiduals, Solution, StopReason};
