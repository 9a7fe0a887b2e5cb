//! The trajectory: from logs to poses with standard deviations, and poses at any time between.

mod batch;
mod clock;
mod conclusion;
mod constants;
mod covariance;
mod diagnostics;
mod estimate;
mod factors;
mod gaps;
mod graph;
mod imu_noise;
mod imu_series;
mod initial;
mod interpolate;
mod motion_sums;
mod online;
mod preintegration;
mod recovery;
mod rest;
mod robust;
mod settings;
mod solution;
mod states;
mod streams;
mod timeline;
mod variance;

pub use covariance::{PoseGradient, PosteriorCovariance};
pub use estimate::{Estimate, estimate};
pub use imu_noise::{ImuDatasheet, ImuNoise};
pub use interpolate::{PoseCursor, Trajectory};
pub use online::{Jump, Online, OnlineOptions, Thresholds, Update};
pub use settings::{
    Constant, HeadingSettings, Loss, Nodes, PoseLimits, PositionKind, PositionSettings,
    TrajectorySettings,
};
pub use solution::{
    ClockJump, EstimatedConstant, Rejection, RejectionReason, Residual, SensorDiagnostics,
    Solution, StopReason,
};
pub use streams::MotionLogs;
