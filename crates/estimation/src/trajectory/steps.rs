//! Positions that step and stay: a base or a fix that changed, a tripod that was bumped.
//!
//! The IMU cannot follow a step, but within seconds the trajectory does, and half of the drive lies elsewhere. At the records
//! between which residuals change most, the offset of all later records of the sensor is an unknown. One factorisation
//! gives the estimate of each alone; the most significant is estimated with the trajectory, and the search begins again.

use serde::{Deserialize, Serialize};

use super::estimate::Estimate;
use super::graph::Graph;
use super::logs::MotionLogs;
use super::robust::weigh_cautiously;
use super::settings::{Constant, TrajectorySettings};
use super::solution::EstimatedConstant;
use super::states::State;
use super::trial::{misfit, try_estimate};
use super::variance::imu_median_component;
use crate::adjustment::ChainProblem;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Records before and after a step whose residuals are compared.
const WINDOW: usize = 5;
/// Least change of their means, standard deviations of a position: of white noise, one of a thousand windows exceeds it
/// (√(2/5) times the root of χ² with three degrees), so that clean drives need no test.
const LEAST_CHANGE: f64 = 2.5;
/// Most places of a sensor that are tested.
const MAX_PLACES: usize = 16;
/// Most steps that are corrected: two blocks.
const MAX_STEPS: usize = 4;
/// A step is one beyond this sum of squares over its three coordinates: that of 7 standard deviations, which none of
/// the thousands of records of a drive reaches by chance.
pub const SIGNIFICANT_SQUARE: f64 = 49.0;
/// Smaller steps are multipath and noise, metres.
const LEAST_STEP_M: f64 = 0.01;
/// Errors that are stated to last change by this many of their standard deviations at most: of the difference of two
/// independent values, one in 10,000 exceeds it.
const LASTING_SIGMAS: f64 = 5.6;

/// From one record on, the positions of a sensor are off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PositionStep {
    /// Name of the sensor.
    pub sensor: String,
    /// The first record that is off, from 1.
    pub record: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// By how much, world, metres.
    pub step_m: Vec3,
    /// Standard deviations, metres.
    pub sigma_m: Vec3,
}

/// Estimates steps of positions with the trajectory, as long as there are any. Returns the estimate and its settings,
/// with the steps among the constants to be estimated.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled).
pub fn with_steps(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    plain: Estimate,
    progress: &dyn Progress,
) -> Result<(Estimate, TrajectorySettings)> {
    let (mut found, mut settings) = (plain, settings.clone());
    for _ in 0..MAX_STEPS {
        let Some(step) = find(&found, &settings) else {
            break;
        };
        let mut trial = settings.clone();
        trial.estimate.push(step);
        let Some(with_step) = try_estimate(logs, &trial, progress)? else {
            break;
        };
        if misfit(&found.solution) - misfit(&with_step.solution) < SIGNIFICANT_SQUARE {
            break;
        }
        (found, settings) = (with_step, trial);
    }
    Ok((found, settings))
}

/// The steps among the constants of an estimate.
pub fn steps_of(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    constants: &[EstimatedConstant],
) -> Vec<PositionStep> {
    let steps = settings.estimate.iter().filter_map(|constant| {
        let Constant::PositionStep { sensor, record } = *constant else {
            return None;
        };
        let name = constant.name(&settings.positions);
        let mut components = constants.iter().filter(|c| c.name.starts_with(&name));
        let all = [components.next()?, components.next()?, components.next()?];
        Some(PositionStep {
            sensor: settings.positions[sensor].name.clone(),
            record: record + 1,
            time_s: logs.positions[sensor][record].time_s,
            step_m: Vec3::from(all.map(|c| c.value)),
            sigma_m: Vec3::from(all.map(|c| c.sigma.unwrap_or(f64::NAN))),
        })
    });
    steps.collect()
}

/// The most significant step that is not estimated yet.
pub fn find(estimate: &Estimate, settings: &TrajectorySettings) -> Option<Constant> {
    let (graph, state, _) = estimate.covariance.parts();
    let places: Vec<(usize, usize)> = (0..settings.positions.len())
        .flat_map(|sensor| places(graph, state, sensor))
        .filter(|&(sensor, record)| {
            let known = Constant::PositionStep { sensor, record };
            !settings.estimate.contains(&known)
        })
        .collect();
    if places.is_empty() {
        return None;
    }
    let (mut graph, mut state) = (graph.clone(), state.clone());
    // An IMU that vibrates follows positions anywhere.
    let component = imu_median_component(&graph, &state, estimate.covariance.factor());
    graph.imu_scale *= component.map_or(1.0, |square| square.sqrt().max(1.0));
    weigh_cautiously(&mut graph, &state);
    let first = state.constants.count();
    for &(sensor, record) in &places {
        state
            .constants
            .free(Constant::PositionStep { sensor, record }, settings);
    }
    let factor = graph.factor(&state).ok()?;
    let alone = factor.each_alone(first);
    let found = places.into_iter().zip(alone.chunks_exact(3));
    let significant = found.filter_map(|((sensor, record), components)| {
        let square: f64 = components
            .iter()
            .map(|(m, sigma)| (m / sigma).powi(2))
            .sum();
        let lasting_m = settings.positions[sensor].sigma_correlated_m;
        let is_step = components.iter().enumerate().any(|(axis, (m, sigma))| {
            m.abs() > LEAST_STEP_M.max(LASTING_SIGMAS * lasting_m[axis])
                && (m / sigma).powi(2) > SIGNIFICANT_SQUARE / 3.0
        });
        let is_significant = is_step && square > SIGNIFICANT_SQUARE;
        is_significant.then_some((square, Constant::PositionStep { sensor, record }))
    });
    let best = significant.max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, step)| step)
}

/// The records of a sensor at which its residuals change most: from the mean of the records before to that of those from
/// there on.
fn places(graph: &Graph, state: &State, sensor: usize) -> Vec<(usize, usize)> {
    let mut residuals: Vec<(usize, Vec3)> = Vec::new();
    for step in 0..graph.timeline.steps() {
        let (node, bias) = (&state.nodes[step], graph.bias(state, step));
        let fixes = graph.positions_of(step).iter();
        residuals.extend(fixes.filter(|fix| fix.sensor == sensor).map(|fix| {
            let antenna = &graph.sensors[sensor];
            let whitened = fix.whitened(antenna, &state.constants, node, bias);
            (fix.record, Vec3::from(whitened))
        }));
    }
    let mean = |fixes: &[(usize, Vec3)]| {
        fixes.iter().map(|(_, residual)| residual).sum::<Vec3>() / fixes.len() as f64
    };
    let windows = residuals.windows(2 * WINDOW);
    let changes = windows.map(|fixes| {
        let (before, after) = fixes.split_at(WINDOW);
        ((mean(after) - mean(before)).norm(), after[0].0)
    });
    let changes: Vec<(f64, usize)> = changes.collect();
    // The largest among their neighbours, which see the same step.
    let mut largest: Vec<(f64, usize)> = (0..changes.len())
        .filter(|&i| changes[i].0 > LEAST_CHANGE)
        .filter(|&i| {
            let around = i.saturating_sub(WINDOW - 1)..(i + WINDOW).min(changes.len());
            changes[around].iter().all(|other| other.0 <= changes[i].0)
        })
        .map(|i| changes[i])
        .collect();
    largest.sort_by(|a, b| b.0.total_cmp(&a.0));
    largest.truncate(MAX_PLACES);
    let records = largest.into_iter().map(|(_, record)| (sensor, record));
    records.collect()
}
