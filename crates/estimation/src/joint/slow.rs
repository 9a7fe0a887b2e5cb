//! Test whether mountings move slowly during a drive.
//!
//! The trajectory follows a slow motion of a mounting as far as its sensors allow, so that it shows neither in the
//! residuals of the IMU nor in those of the scans, and yet the mean mounting is off by more than its standard deviation.
//! It shows in what all of them say together: in an estimate of the motion with all unknowns free.

use super::bend::{Rung, is_fixed};
use super::held::{HeldMotion, MODES};
use super::problem::JointProblem;
use super::row::RowBatch;
use super::score::Score;
use super::state::State;

/// Probability that an estimate of a mounting that does not move exceeds the limit.
const LEVEL: f64 = 1e-3;

/// The estimate of a coefficient, all others held.
pub struct SlowMotion {
    /// Index of the scanner.
    pub scanner: usize,
    /// Index in (δφ, δp).
    pub component: usize,
    /// The coefficient, which is the root mean square of the motion: radians or metres.
    pub score: Score,
}

/// The contradiction between the observations and mountings that move as a rung allows, in words: the slow motion whose
/// estimate is largest in its standard deviations, if it exceeds the limit. Of n normally distributed estimates, one
/// exceeds √(2 ln(n/α)) with a probability below α. The problem must hold the factor, at this state or one nearby.
pub fn slow_contradiction(problem: &JointProblem<'_>, state: &State) -> Option<String> {
    let rung = state.rung();
    if rung >= Rung::SlowKnots {
        return None;
    }
    let motions = slow_motions(problem, problem.factored().unwrap_or(state));
    let limit = (2.0 * (motions.len() as f64 / LEVEL).ln()).sqrt();
    let sigmas = |motion: &SlowMotion| motion.score.sigmas();
    let worst = motions
        .iter()
        .max_by(|a, b| sigmas(a).total_cmp(&sigmas(b)))?;
    if sigmas(worst) <= limit {
        return None;
    }
    let name = &problem.input.mountings[worst.scanner].name;
    let axis = ["x", "y", "z"][worst.component % 3];
    let size = worst.score.value.abs();
    let moves = if worst.component < 3 {
        format!("turned slowly about {axis}, by {:.3}°", size.to_degrees())
    } else {
        format!("shifted slowly along {axis}, by {:.2} mm", 1e3 * size)
    };
    Some(format!(
        "scans and sensors contradict a {} mounting: they would agree better, by {:.1} standard deviations (at most \
         {limit:.1}), if scanner `{name}` {moves} (root mean square)",
        rung.name(),
        sigmas(worst),
    ))
}

/// Estimates of the slow motions of all mountings in all drives that are not fixed, with the factor at a state.
pub fn slow_motions(problem: &JointProblem<'_>, state: &State) -> Vec<SlowMotion> {
    let drives = problem.input.drives.iter().enumerate();
    let held = drives.flat_map(|(drive, input)| {
        let scanners = input.scans.samples.iter().enumerate();
        scanners.filter_map(move |(scanner, sample)| {
            let (first, last) = (sample.profiles.first()?, sample.profiles.last()?);
            Some(HeldMotion {
                drive,
                scanner,
                first: problem.layout.sizes.len(),
                from_s: first.time_s,
                duration_s: last.time_s - first.time_s,
            })
        })
    });
    let all = held.filter(|held| held.duration_s > 0.0).flat_map(|held| {
        let scanner = held.scanner;
        let mut blocks = problem.layout.of_scanners.clone();
        blocks.motion = Some(held);
        let visit = |visit: &mut dyn FnMut(&RowBatch)| problem.visit_with(state, &blocks, visit);
        let estimates = problem.score(6 * MODES, None, visit);
        let estimates = estimates.into_iter().enumerate();
        estimates.filter_map(move |(place, estimate)| {
            let component = place % 6;
            let is_free = !is_fixed(&problem.input.mountings[scanner], component);
            estimate.filter(|_| is_free).map(|estimate| SlowMotion {
                scanner,
                component,
                score: estimate.score,
            })
        })
    });
    all.collect()
}
