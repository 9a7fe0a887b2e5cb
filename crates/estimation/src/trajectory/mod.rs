//! The trajectory: from logs to poses with standard deviations, and poses at any time between.
//!
//! Files depend on each other in this order: states → factors → graph → batch → diagnostics,
//! conclusion → estimate → online. Other modules of the crate may use the rows of a graph and the
//! derivatives of its poses (`recovery`) in problems of their own.

pub(crate) mod batch;
mod clock;
mod conclusion;
pub(crate) mod constants;
mod covariance;
mod diagnostics;
mod doubt;
mod doubts;
mod estimate;
pub(crate) mod factors;
mod gaps;
pub(crate) mod graph;
mod gyro_scale;
mod imu_noise;
pub(crate) mod imu_series;
pub(crate) mod initial;
mod interpolate;
mod lasting;
mod logs;
mod motion_sums;
mod online;
mod preintegration;
pub(crate) mod recovery;
mod rest;
mod robust;
mod settings;
mod solution;
pub(crate) mod states;
mod steps;
pub(crate) mod streams;
#[cfg(test)]
mod tests;
pub(crate) mod timeline;
mod trial;
mod variance;

pub use covariance::{PoseGradient, PosteriorCovariance};
pub use doubt::Doubt;
pub use doubts::{Tested, estimate_tested};
pub use estimate::{Estimate, estimate};
pub use imu_noise::{ImuDatasheet, ImuNoise};
pub use interpolate::{PoseCursor, Trajectory};
pub use logs::MotionLogs;
pub use online::{Jump, Online, OnlineOptions, Thresholds, Update};
pub use settings::{
    Constant, HeadingSettings, Loss, Nodes, PoseLimits, PositionKind, PositionSettings,
    SENSOR_CORRELATION_S, TrajectorySettings,
};
pub use solution::{
    ClockJump, EstimatedConstant, Rejection, RejectionReason, Residual, SensorDiagnostics,
    Solution, StopReason,
};
pub use steps::PositionStep;
