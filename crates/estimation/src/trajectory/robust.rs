//! Outliers: the weight of each record.
//!
//! A first adjustment takes all records at full weight. Where none of them exceeds the limit of
//! its test, that is the result. Otherwise the weights follow the loss of each sensor; the truncated
//! loss is reached by graduated non-convexity.

use super::graph::{Graph, Source};
use super::settings::TrajectorySettings;
use super::states::State;
use super::variance::{imu_mean_component, imu_median_component};
use crate::adjustment::{
    ChainFactor, ChainProblem, Ended, Graduation, Loss, LossGroup, cautious_weight,
    rejection_limit, weigh,
};
use crate::error::Result;
use crate::progress::Progress;
use std::collections::HashMap;

/// Limit of the iterations of one adjustment.
pub const MAX_ITERATIONS: usize = 50;
/// Iterations of the adjustment in each round: enough to follow the weights.
const ROUND_ITERATIONS: usize = 2;
/// Limit of the rounds; µ grows from 1e-6 past 1e3 in 30.
const MAX_ROUNDS: usize = 60;
/// Limit of the rounds in which the set of outliers settles.
const MAX_SETTLINGS: usize = 10;
/// From this scale on, records are tested with an IMU as noisy as its residuals.
const NOTABLE_SCALE: f64 = 1.5;
/// How often the IMU's scale is estimated for each set of outliers.
const SCALINGS: usize = 2;
/// Components of a position and of a heading.
const POSITION_COMPONENTS: f64 = 3.0;
const HEADING_COMPONENTS: f64 = 1.0;

/// The weights of records by their numbers in the logs.
#[derive(Debug, Clone, Default)]
pub struct Weights {
    positions: HashMap<(usize, usize), f64>,
    headings: HashMap<usize, f64>,
}

impl Weights {
    /// The weights of a graph.
    pub fn of(graph: &Graph) -> Self {
        let positions = graph.positions.iter();
        let headings = graph.headings.iter();
        Self {
            positions: positions
                .map(|fix| ((fix.sensor, fix.record), fix.weight))
                .collect(),
            headings: headings.map(|fix| (fix.record, fix.weight)).collect(),
        }
    }

    /// Gives the records of another graph of the same logs their weights.
    fn give(&self, graph: &mut Graph) {
        for fix in &mut graph.positions {
            let known = self.positions.get(&(fix.sensor, fix.record));
            fix.weight = *known.unwrap_or(&1.0);
        }
        for fix in &mut graph.headings {
            fix.weight = *self.headings.get(&fix.record).unwrap_or(&1.0);
        }
    }
}

/// Adjusts with the losses of the settings. The factors keep the weights of the final adjustment.
///
/// `known` are the weights of an adjustment that differs little: the search for outliers starts from them.
pub fn solve(
    graph: &mut Graph,
    state: &mut State,
    factor: &mut ChainFactor,
    settings: &TrajectorySettings,
    known: Option<&Weights>,
    progress: &dyn Progress,
) -> Result<Ended> {
    if let Some(known) = known {
        known.give(graph);
    }
    let mut ended = graph.solve(state, factor, MAX_ITERATIONS, progress)?;
    let groups = groups(graph, settings);
    let squares = squares(graph, state);
    let suspicious = groups.iter().any(|group| group.is_suspicious(&squares));
    let all_at_full_weight = weights_of(graph).iter().all(|weight| *weight >= 1.0);
    if !suspicious && all_at_full_weight {
        return Ok(ended);
    }
    let first = ended;
    // First with the median of the IMU's residuals, which is robust against outliers that still
    // bend the trajectory; then, where the IMU turns out to be noisier than the project says, again
    // with the mean, which also covers vibration that comes and goes.
    let truncated = known.is_none() && groups.iter().any(|group| group.loss == Loss::Truncated);
    let choose =
        |graph: &mut Graph, state: &mut State, factor: &mut ChainFactor, component: Component| {
            if truncated {
                graduate(graph, state, factor, &groups, progress)?;
            }
            settle(graph, state, factor, &groups, component, progress)
        };
    ended.iterations += choose(graph, state, factor, imu_median_component)?;
    rescale(graph, state, factor, imu_mean_component);
    if graph.imu_scale > NOTABLE_SCALE {
        ended.iterations += choose(graph, state, factor, imu_mean_component)?;
    }
    // The records are chosen; the final adjustment uses the project's noise of the IMU.
    graph.imu_scale = 1.0;
    let last = graph.solve(state, factor, MAX_ITERATIONS, progress)?;
    ended.iterations += last.iterations;
    ended.stop = last.stop;
    ended.cost = last.cost;
    ended.cost_initial = first.cost_initial;
    Ok(ended)
}

/// Finds scale and weights in turn until the weights settle; returns the iterations taken.
fn settle(
    graph: &mut Graph,
    state: &mut State,
    factor: &mut ChainFactor,
    groups: &[LossGroup],
    component: Component,
    progress: &dyn Progress,
) -> Result<usize> {
    let mut before: Option<Vec<f64>> = None;
    let (mut iterations, mut rounds) = (0, 0);
    loop {
        for _ in 0..SCALINGS {
            rescale(graph, state, factor, component);
            iterations += graph
                .solve(state, factor, ROUND_ITERATIONS, progress)?
                .iterations;
        }
        let mut next = weights_of(graph);
        weigh(groups, &squares(graph, state), &mut next);
        set_weights(graph, &next);
        iterations += graph
            .solve(state, factor, MAX_ITERATIONS, progress)?
            .iterations;
        let settled = before.as_ref().is_some_and(|before| {
            let mut pairs = before.iter().zip(&next);
            pairs.all(|(a, b)| (a - b).abs() < 1e-3)
        });
        before = Some(next);
        rounds += 1;
        if settled || rounds == MAX_SETTLINGS {
            return Ok(iterations);
        }
    }
}

/// Half the squared normalised residuals with the project's noise of the IMU, a rejected record
/// counting as one at the limit of its test: what the truncated loss minimises.
pub fn truncated_cost(graph: &Graph, ended: &Ended) -> f64 {
    let rejected_cost =
        |components: f64, weight: f64| 0.5 * (1.0 - weight) * rejection_limit(components);
    let positions = graph.positions.iter();
    let positions = positions.map(|fix| rejected_cost(POSITION_COMPONENTS, fix.weight));
    let headings = graph.headings.iter();
    let headings = headings.map(|fix| rejected_cost(HEADING_COMPONENTS, fix.weight));
    ended.cost + positions.sum::<f64>() + headings.sum::<f64>()
}

/// Scales the IMU's standard deviations, with which records are tested, to its residuals: otherwise
/// an IMU noisier than its datasheet would make outliers of good records. The scale stays at 1 or
/// above.
fn rescale(graph: &mut Graph, state: &State, factor: &ChainFactor, component: Component) {
    if let Some(square) = component(graph, state, factor) {
        graph.imu_scale = (graph.imu_scale * square.sqrt()).max(1.0);
    }
}

/// A variance component of the IMU.
type Component = fn(&Graph, &State, &ChainFactor) -> Option<f64>;

/// The records of each sensor; indices count all positions, then all headings.
fn groups(graph: &Graph, settings: &TrajectorySettings) -> Vec<LossGroup> {
    let positions = graph.positions.len();
    let of_sensor = |sensor: usize| {
        let of_this = move |&i: &usize| graph.positions[i].sensor == sensor;
        (0..positions).filter(of_this).collect()
    };
    let sensors = settings.positions.iter().enumerate();
    let mut groups: Vec<LossGroup> = sensors
        .map(|(sensor, position)| LossGroup {
            loss: position.loss,
            components: POSITION_COMPONENTS,
            records: of_sensor(sensor),
        })
        .collect();
    groups.push(LossGroup {
        loss: settings.heading.loss,
        components: HEADING_COMPONENTS,
        records: (positions..positions + graph.headings.len()).collect(),
    });
    groups
}

/// Squared normalised residuals of all positions, then of all headings.
fn squares(graph: &Graph, state: &State) -> Vec<f64> {
    let mut positions = Vec::with_capacity(graph.positions.len() + graph.headings.len());
    let mut headings = Vec::with_capacity(graph.headings.len());
    for step in 0..graph.timeline.steps() {
        graph.record_residuals(state, step, |source, _, residual| {
            let square = residual.iter().map(|x| x * x).sum();
            match source {
                Source::Position(_) => positions.push(square),
                Source::Heading(_) => headings.push(square),
                Source::Imu(_) | Source::Rest => {}
            }
        });
    }
    positions.append(&mut headings);
    positions
}

fn weights_of(graph: &Graph) -> Vec<f64> {
    let positions = graph.positions.iter().map(|fix| fix.weight);
    positions
        .chain(graph.headings.iter().map(|fix| fix.weight))
        .collect()
}

fn set_weights(graph: &mut Graph, weights: &[f64]) {
    let (positions, headings) = weights.split_at(graph.positions.len());
    for (fix, weight) in graph.positions.iter_mut().zip(positions) {
        fix.weight = *weight;
    }
    for (fix, weight) in graph.headings.iter_mut().zip(headings) {
        fix.weight = *weight;
    }
}

/// Rounds of graduated non-convexity.
fn graduate(
    graph: &mut Graph,
    state: &mut State,
    factor: &mut ChainFactor,
    groups: &[LossGroup],
    progress: &dyn Progress,
) -> Result<()> {
    let mut graduation = Graduation::default();
    for _ in 0..MAX_ROUNDS {
        let mut weights = weights_of(graph);
        let reached = graduation.round(groups, &squares(graph, state), &mut weights);
        set_weights(graph, &weights);
        graph.solve(state, factor, ROUND_ITERATIONS, progress)?;
        if reached {
            break;
        }
    }
    Ok(())
}

/// Gives every record Huber's weight, whatever its loss: for tests in which rejected records count.
pub fn weigh_cautiously(graph: &mut Graph, state: &State) {
    let positions = graph.positions.len();
    let squares = squares(graph, state);
    let weights = squares.iter().enumerate().map(|(i, square)| {
        let components = if i < positions {
            POSITION_COMPONENTS
        } else {
            HEADING_COMPONENTS
        };
        cautious_weight(components, *square)
    });
    set_weights(graph, &weights.collect::<Vec<f64>>());
}
