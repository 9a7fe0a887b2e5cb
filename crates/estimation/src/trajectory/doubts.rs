//! The noise of the IMU and the constants that the project takes as known, tested against the drive.
//!
//! Noise comes first: an IMU that vibrates more than its datasheet says would free any constant that
//! follows its residuals a little. Models are compared by −2 ln L = Ω + r ln s² up to a constant, with the sum of
//! squares Ω of the normalised residuals, the redundancy r of the IMU and the factor s on its standard deviations: a
//! constant has to explain more than a larger s does.

use super::doubt::Doubt;
use super::estimate::{Estimate, estimate};
use super::logs::{ClockCorrection, MotionLogs};
use super::settings::{Constant, TrajectorySettings};
use super::solution::Solution;
use super::steps::{PositionStep, SIGNIFICANT_SQUARE, find, steps_of, with_steps};
use super::trial::{misfit, rejected_squares, try_estimate};
use crate::adjustment::ChainProblem;
use crate::error::Result;
use crate::progress::{Progress, Silent, Steps};
use crate::statistics::median;

/// The IMU's noise is scaled where its residuals ask for more than this factor.
const NOTABLE_NOISE: f64 = 1.2;
/// Smallest decrease of −2 ln L that is not chance.
const MIN_GAIN: f64 = 40.0;
/// A fit is far off from this ratio of the sum of squares to the redundancy on.
const MAX_RATIO: f64 = 3.0;
/// A constant explains enough where it leaves no more than this share of what all constants explain.
const LEFT_SHARE: f64 = 0.02;
/// Largest number of constants that are doubted.
const MAX_DOUBTS: usize = 3;
/// A latency of more records than this is not used without being asked for: it is rather a clock that was never set.
const MAX_LATE_RECORDS: f64 = 10.0;

/// Trials of a drive that nothing contradicts, and the units of their progress.
const TRIALS: u64 = 1;
const PROGRESS_UNITS: u64 = 1000;

/// A trajectory, estimated with the noise and the constants that the drive asks for.
#[derive(Debug, Clone)]
pub struct Tested {
    /// The trajectory, with the noise of the IMU scaled and the doubted constants estimated where they may be.
    pub estimate: Estimate,
    /// The constants that the drive contradicts, those first that explain most.
    pub doubts: Vec<Doubt>,
    /// Steps of positions, which are estimated.
    pub steps: Vec<PositionStep>,
}

/// Estimates the trajectory, and tests the noise of the IMU and the held constants against the drive. If `releases`, the
/// noise is scaled and doubted constants are estimated where that explains the drive.
///
/// # Errors
/// As [`estimate`].
pub fn estimate_tested(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    releases: bool,
    progress: &dyn Progress,
) -> Result<Tested> {
    let plain = estimate(logs, settings, progress)?;
    let by_constants = with_constants(logs, settings, plain, releases, progress)?;
    // A wrong lever arm moves positions with each turn of the body, which looks like steps, until it is estimated.
    if find(&by_constants.estimate, settings).is_none() {
        return Ok(by_constants);
    }
    // Rare enough to estimate again what every other drive would have to keep a copy of.
    let plain = estimate(logs, settings, &Silent)?;
    let (stepped, with_steps) = with_steps(logs, settings, plain, progress)?;
    let by_steps = with_constants(logs, &with_steps, stepped, releases, progress)?;
    let [of_constants, of_steps] = [&by_constants, &by_steps].map(|t| misfit(&t.estimate.solution));
    let explained = SIGNIFICANT_SQUARE * by_steps.steps.len() as f64;
    let is_told = !releases && !by_constants.doubts.is_empty();
    let is_simpler = of_constants < of_steps + explained;
    Ok(if is_told || is_simpler {
        by_constants
    } else {
        by_steps
    })
}

/// Tests the noise and the constants with a `plain` estimate with these settings.
fn with_constants(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    plain: Estimate,
    releases: bool,
    progress: &dyn Progress,
) -> Result<Tested> {
    let tested = |estimate: Estimate, doubts| Tested {
        steps: steps_of(logs, settings, &estimate.solution.constants),
        estimate,
        doubts,
    };
    let scaled = with_scaled_noise(logs, settings, &plain, progress)?;
    let doubts = doubts(logs, settings, &plain, scaled.as_ref(), progress)?;
    if !releases {
        return Ok(tested(plain, doubts));
    }
    let mut doubts: Vec<Doubt> = doubts
        .into_iter()
        .map(|doubt| Doubt {
            is_used: is_small(&doubt, logs),
            ..doubt
        })
        .collect();
    // A constant that the others and the noise explain as well is asked again, and held.
    while doubts.iter().any(|doubt| doubt.is_used) {
        let mut freed = settings.clone();
        let used = doubts.iter().filter(|doubt| doubt.is_used);
        freed.estimate.extend(used.map(|doubt| doubt.constant));
        let Some(released) = try_estimate(logs, &freed, progress)? else {
            doubts.iter_mut().for_each(|doubt| doubt.is_used = false);
            break;
        };
        let released = with_scaled_noise(logs, &freed, &released, progress)?.unwrap_or(released);
        let count = doubts.len();
        doubts = doubts
            .into_iter()
            .filter_map(|doubt| {
                if !doubt.is_used {
                    return Some(doubt);
                }
                let again = Doubt::of(doubt.constant, settings, &released.solution)?;
                Some(Doubt {
                    is_used: true,
                    ..again
                })
            })
            .collect();
        if doubts.len() == count {
            return Ok(tested(released, doubts));
        }
    }
    Ok(tested(scaled.unwrap_or(plain), doubts))
}

/// The estimate with the noise of the IMU scaled, where the residuals of an estimate with these settings ask for that;
/// `None` where they do not.
fn with_scaled_noise(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    estimated: &Estimate,
    progress: &dyn Progress,
) -> Result<Option<Estimate>> {
    if settings.estimate.contains(&Constant::ImuNoiseScale) || !is_noisy(&estimated.solution) {
        return Ok(None);
    }
    try_estimate(logs, &noisy(settings), progress)
}

/// Whether the residuals of the IMU ask for more noise.
fn is_noisy(solution: &Solution) -> bool {
    solution.imu_noise_factor() > NOTABLE_NOISE
}

/// The settings with the noise of the IMU estimated.
fn noisy(settings: &TrajectorySettings) -> TrajectorySettings {
    let mut noisy = settings.clone();
    noisy.estimate.push(Constant::ImuNoiseScale);
    noisy
}

/// Whether a doubted constant may be used as the drive finds it.
fn is_small(doubt: &Doubt, logs: &MotionLogs<'_>) -> bool {
    let spacing = |times: &mut dyn Iterator<Item = f64>| {
        let times: Vec<f64> = times.collect();
        median(times.windows(2).map(|pair| pair[1] - pair[0])).unwrap_or(0.0)
    };
    let spacing_s = match doubt.constant {
        Constant::TimeOffset(sensor) | Constant::TimeDrift(sensor) => {
            spacing(&mut logs.positions[sensor].iter().map(|fix| fix.time_s))
        }
        Constant::HeadingTimeOffset => spacing(&mut logs.heading.iter().map(|fix| fix.time_s)),
        _ => return true,
    };
    doubt.off() <= MAX_LATE_RECORDS * spacing_s
}

/// The constants that the drive contradicts, those first that explain most. `plain` is the estimate with these settings,
/// `scaled` that with the noise of the IMU scaled, if `plain` asks for it.
///
/// First, the derivatives of all held constants at the solution tell by how much they would lower Ω; if that is
/// chance, nothing is doubted. Otherwise they are tested one by one. If the IMU is noisy, they have to explain more than
/// its noise does: either without noise, or with the noise estimated in each test, which takes longer.
fn doubts(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    plain: &Estimate,
    scaled: Option<&Estimate>,
    progress: &dyn Progress,
) -> Result<Vec<Doubt>> {
    let stage = progress.stage("testing the constants", PROGRESS_UNITS);
    let base = scaled.unwrap_or(plain);
    let held = candidates(logs, settings);
    // Derivatives know nothing of rejected records, which a constant that is far off has many of.
    let is_blind = rejected_squares(&base.solution) > MIN_GAIN;
    let is_chance = |gain: f64| gain < MIN_GAIN;
    if !is_blind && gain_of(&held, logs, settings, base).is_some_and(is_chance) {
        drop(stage);
        return Ok(Vec::new());
    }
    let mut test = Test {
        logs,
        settings,
        held: &held,
        trials: Steps::new(progress, TRIALS, PROGRESS_UNITS),
        progress,
    };
    let selected = test.select(&plain.solution)?;
    let doubts = match scaled {
        None => selected.doubts,
        Some(scaled) => {
            let with_noise = noisy(settings);
            let explains = |solution: &Solution| {
                !is_noisy(solution) && misfit(solution) < misfit(&scaled.solution) - MIN_GAIN
            };
            if selected.solution.as_ref().is_some_and(explains) {
                selected.doubts
            } else {
                test.settings = &with_noise;
                test.select(&scaled.solution)?.doubts
            }
        }
    };
    drop(stage);
    Ok(doubts)
}

/// Doubted constants, and the solution with them estimated.
#[derive(Default)]
struct Selected {
    doubts: Vec<Doubt>,
    solution: Option<Solution>,
}

/// Tests of constants by adjustments with these settings in which some are free.
struct Test<'a> {
    logs: &'a MotionLogs<'a>,
    settings: &'a TrajectorySettings,
    held: &'a [Constant],
    trials: Steps<'a>,
    progress: &'a dyn Progress,
}

impl Test<'_> {
    fn solve_with(&self, more: &[Constant]) -> Result<Option<Solution>> {
        self.progress.check()?;
        let mut trial = self.settings.clone();
        trial.estimate.extend(more);
        let estimate = try_estimate(self.logs, &trial, &Silent)?;
        self.trials.advance(1);
        Ok(estimate.map(|estimate| estimate.solution))
    }

    /// The constants that explain a solution in which all are held: Wald tests, forward selection.
    ///
    /// All are estimated at once, to know what there is to explain. Where the fit is far off to begin with, or something
    /// is left to explain, they are estimated one at a time, and the one with the best fit stays estimated while the
    /// others are tested, until nothing is left to explain or no constant explains its part: a drive that fits badly for
    /// another reason fits a little better with every constant.
    fn select(&self, solution: &Solution) -> Result<Selected> {
        let mut now = misfit(solution);
        let sensors = solution.sensors.iter();
        let redundancy: f64 = sensors.map(|sensor| sensor.redundancy).sum();
        let is_far_off = now >= MAX_RATIO * redundancy;
        let mut least = None;
        let mut freed = Vec::new();
        let mut selected = Selected::default();
        while freed.len() < MAX_DOUBTS {
            // From far off, an adjustment of all of them at once has far to go and may end elsewhere.
            if least.is_none() && now < MAX_RATIO * redundancy {
                least = self.solve_with(self.held)?.map(|all| misfit(&all));
            }
            let least = least.filter(|least| *least <= now).unwrap_or(0.0);
            if now - least <= MIN_GAIN {
                break;
            }
            let enough = least + MIN_GAIN.max(LEFT_SHARE * (now - least));
            // If constants together bring the fit down to its redundancy, one of them explains at least this.
            let part = if is_far_off {
                (now - redundancy) / MAX_DOUBTS as f64
            } else {
                0.0
            };
            let most = now - MIN_GAIN.max(part);
            let mut best: Option<(f64, Constant, Solution)> = None;
            for constant in self.held.iter().filter(|held| !freed.contains(*held)) {
                let Some(solution) = self.solve_with(&[&freed[..], &[*constant]].concat())? else {
                    continue;
                };
                let misfit = misfit(&solution);
                let better = best.as_ref().map_or(most, |(least, ..)| *least);
                if misfit < better && Doubt::of(*constant, self.settings, &solution).is_some() {
                    best = Some((misfit, *constant, solution));
                }
                if best.as_ref().is_some_and(|(misfit, ..)| *misfit < enough) {
                    break;
                }
            }
            let Some((misfit, constant, solution)) = best else {
                break;
            };
            now = misfit;
            freed.push(constant);
            let all = freed.iter();
            let doubts = all.filter_map(|constant| Doubt::of(*constant, self.settings, &solution));
            selected = Selected {
                doubts: doubts.collect(),
                solution: Some(solution),
            };
        }
        Ok(selected)
    }
}

/// By how much Ω falls to first order if these constants are estimated too: gᵀ H⁻¹ g with their columns, whose part of
/// the trajectory alone is zero at its solution. `None` if the normal equations are not positive definite.
fn gain_of(
    constants: &[Constant],
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    estimated: &Estimate,
) -> Option<f64> {
    let (graph, state, _) = estimated.covariance.parts();
    let (mut graph, mut state) = (graph.clone(), state.clone());
    for constant in constants {
        match ClockCorrection::of(*constant, logs) {
            Some(correction) => state.constants.correct(&correction, settings),
            None => state.constants.free(*constant, settings),
        }
    }
    graph.set_clocks(&state.constants);
    Some(graph.factor(&state).ok()?.decrement())
}

/// The constants that are held, those with the largest mistakes first.
fn candidates(logs: &MotionLogs<'_>, settings: &TrajectorySettings) -> Vec<Constant> {
    let sensors = 0..settings.positions.len();
    let of_positions = sensors.flat_map(|i| {
        let drift = Constant::TimeDrift(i);
        let drift = ClockCorrection::of(drift, logs).map(|_| drift);
        [Constant::LeverArm(i), Constant::TimeOffset(i)]
            .into_iter()
            .chain(drift)
    });
    let has_heading = !logs.heading.is_empty();
    let offset = has_heading.then_some(Constant::HeadingOffset);
    let latency = has_heading.then_some(Constant::HeadingTimeOffset);
    let all = offset.into_iter().chain(of_positions).chain(latency);
    let all = all.chain([Constant::GyroScale, Constant::Gravity]);
    all.filter(|constant| !settings.estimate.contains(constant))
        .collect()
}
