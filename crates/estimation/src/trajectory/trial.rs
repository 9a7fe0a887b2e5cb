//! Trials of other models of the same logs, and how well they fit.

use super::estimate::{Estimate, estimate};
use super::logs::MotionLogs;
use super::settings::TrajectorySettings;
use super::solution::Solution;
use crate::error::{Result, unless_cancelled};
use crate::progress::Progress;

/// What a rejected component of a record counts in the sum of squares.
const REJECTED_SQUARE: f64 = 16.0;

/// The estimate; `None` if it fails or does not converge.
pub fn try_estimate(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Option<Estimate>> {
    // It fails if the drive does not determine what is free.
    let estimate = unless_cancelled(estimate(logs, settings, progress))?;
    Ok(estimate.filter(|estimate| estimate.solution.converged))
}

/// −2 ln L: how badly all records fit, with the squares of those used and a large one for each that was rejected.
pub fn misfit(solution: &Solution) -> f64 {
    let used: f64 = solution
        .sensors
        .iter()
        .map(|sensor| sensor.chi_square)
        .sum();
    used + rejected_squares(solution) + solution.noise_penalty()
}

/// The part of rejected records.
pub fn rejected_squares(solution: &Solution) -> f64 {
    let rejected: usize = solution.sensors.iter().map(|sensor| sensor.rejected).sum();
    REJECTED_SQUARE * rejected as f64
}
