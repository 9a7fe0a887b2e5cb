//! One adjustment of mountings and trajectories: the scans correct the poses that calibrate them.
//!
//! Only known values are fixed. Surfels (patches of the surface with offset and two slopes), the
//! poses behind the scans, the mountings and the constants are unknowns of one least-squares problem.
//! Its observations are scans, IMU, prism, heading and the reference, each with its own noise. Start
//! with [`adjust`], the algorithm; then see `surfel/` (the association of points with patches),
//! `scan.rs` (the scan factor), `motion/` (the unknowns behind poses), `problem.rs` (all rows),
//! `normal.rs` (their normal equations) and `components.rs` (variance components from residuals).

mod adjust;
mod bend;
mod components;
mod conclude;
mod covariance;
mod directions;
mod fixed;
mod followed;
mod held;
mod input;
mod keyframes;
mod known;
mod ladder;
mod late;
mod layout;
mod learn;
mod look;
mod model;
pub mod motion;
mod normal;
mod pattern;
mod places;
mod pose_errors;
mod priors;
mod problem;
mod result;
mod rounds;
mod row;
mod scan;
mod score;
mod second_start;
mod settings;
mod slopes;
mod slow;
mod state;
mod surfel;
#[cfg(test)]
mod tests;

pub use bend::{BENDING_STEP_S, COMPLIANCE, Compliance, Rung, loads};
pub use input::{JointDrive, JointInput, Scans};
pub use ladder::adjust;
pub use model::{DECIDING_BLOCK_S, MAX_BLOCK_RMS, contradictions, max_imu_ratio, misfit};
pub use motion::{ChainMotion, CorrectedPoses, CorrelatedError};
pub use motion::{PositionBlocks, PositionResiduals};
pub use result::{
    AdjustedDrive, Climb, ContradictedLogs, GroupTest, HeldOut, Joint, JointReport, Jump,
    KnownPoint, LateScanner, MovedMounting, PoseErrors, PoseMove, ReferenceError, SurfelPlane,
    known_m,
};
pub use score::{RangeScore, Score};
pub use second_start::{consider_start, is_weak};
pub use settings::{JointSettings, MountingMotion, ReferenceSigma};
pub use surfel::Region;
