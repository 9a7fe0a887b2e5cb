//! The trajectory stage: logs in, poses with standard deviations out.

use super::batch::{Start, adjust};
use super::conclusion::conclude;
use super::covariance::PosteriorCovariance;
use super::initial::initial;
use super::interpolate::Trajectory;
use super::logs::{MotionLogs, latency_of};
use super::settings::{Constant, TrajectorySettings};
use super::solution::Solution;
use crate::error::Result;
use crate::progress::{Progress, Steps};

/// Usual number of steps of an adjustment, and the units of its progress.
const STEPS: u64 = 5;
const PROGRESS_UNITS: u64 = 1000;

/// The estimated trajectory and all that is known about it.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// A pose at every IMU sample and one at the end of the last, with velocity, biases and
    /// standard deviations.
    pub trajectory: Trajectory,
    /// How the adjustment ended and what it left.
    pub solution: Solution,
    /// The joint covariance of all poses.
    pub covariance: PosteriorCovariance,
}

/// Estimates the trajectory from an IMU, positions of prisms or antennas, and headings: a factor
/// graph on a chain, solved by Levenberg-Marquardt with the losses of the settings.
///
/// Records that do not fit are left out and listed in [`Solution::rejections`]. Without headings, the
/// direction of travel gives the start values, and the standard deviations show how well the yaw is
/// determined.
///
/// # Errors
/// Values that are not finite, streams that do not overlap, too few positions, an IMU gap of
/// minutes, neither headings nor motion; [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn estimate(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Estimate> {
    estimate_from(&initial, logs, settings, progress)
}

/// As [`estimate`], from given start values.
pub fn estimate_from(
    start: &Start<'_>,
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Estimate> {
    let stage = progress.stage("trajectory", PROGRESS_UNITS);
    let steps = &Steps::new(progress, STEPS, PROGRESS_UNITS);
    // Enter the thread pool once: each entry from outside costs two thread switches.
    let mut observable = settings.clone();
    let mut unobservable = Vec::new();
    let adjusted = rayon::scope(|_| {
        let adjusted = adjust(start, logs, settings, steps)?;
        // These latencies are not observable in the drive: they keep the project's values.
        let streams = adjusted.unobservable_latencies();
        if streams.is_empty() {
            return Ok(adjusted);
        }
        let is_observable = |constant: &Constant| {
            latency_of(*constant).is_none_or(|stream| !streams.contains(&stream))
        };
        let estimate = settings.estimate.iter().copied();
        (observable.estimate, unobservable) = estimate.partition(is_observable);
        adjust(start, logs, &observable, steps)
    });
    let adjusted = adjusted?;
    let (trajectory, solution) = conclude(&adjusted, &observable, &unobservable, progress)?;
    drop(stage);
    if solution.converged {
        progress.say(&solution.to_string());
    } else {
        progress.warn(&format!(
            "{solution}: check lever arm, axes, heading offset and the clocks of the logs"
        ));
    }
    let covariance = PosteriorCovariance::new(
        adjusted.factor,
        adjusted.graph,
        adjusted.state,
        adjusted.streams.imu,
    );
    Ok(Estimate {
        trajectory,
        solution,
        covariance,
    })
}
