//! Outliers: how much each record counts.
//!
//! A first adjustment takes all records at full weight. Where none of them passes the limit of its
//! test, that is the result. Otherwise the weights follow the loss of each sensor; for the
//! truncated loss by graduated non-convexity (Yang, Antonante, Tzoumas, Carlone 2020): the
//! surrogate of the truncated quadratic starts convex and is sharpened by µ from round to round,
//!   w = 1 where u ≤ µ/(µ+1) c², 0 where u ≥ (µ+1)/µ c², c √(µ(µ+1)/u) − µ between,
//! with u the squared normalised residual and c² the limit.

use super::chain::ChainFactor;
use super::diagnostics::{imu_median_component, imu_variance_component};
use super::graph::{Ended, Graph, MOST_ITERATIONS, State};
use crate::error::Result;
use crate::progress::Progress;
use crate::statistics::{chi_square, median};
use crate::trajectory::{Loss, TrajectorySettings};
use std::collections::HashMap;

/// The limit of the test as a standard normal: 1 good record in 10,000 passes it.
pub(super) const LIMIT_NORMAL: f64 = 3.72;
/// The share of good records that passes it.
const PASSING: f64 = 1e-4;
/// More than this many standard deviations over the number expected is no chance.
const CHANCE_SIGMAS: f64 = 3.0;
/// No good record passes this limit: 1 in 10⁹.
const FAR_NORMAL: f64 = 6.0;
/// Growth of µ from round to round.
const SHARPENING: f64 = 2.0;
/// Iterations of the adjustment in each round: enough to follow the weights.
const ROUND_ITERATIONS: usize = 2;
/// Most rounds; µ grows from 1e-6 past 1e3 in 30.
const MOST_ROUNDS: usize = 60;
/// Most rounds in which the set of outliers settles.
const MOST_SETTLINGS: usize = 10;
/// An IMU whose residuals are as many times what the project says is tested as such.
const NOTABLE_SCALE: f64 = 1.5;
/// Times that the IMU's scale is found anew for each set of outliers.
const SCALINGS: usize = 2;
/// Where the bends of Huber's and Cauchy's losses lie, standard deviations per component.
const HUBER_SIGMAS: f64 = 1.345;
const CAUCHY_SIGMAS: f64 = 2.385;

/// The weights of records by their numbers in the logs.
#[derive(Debug, Clone, Default)]
pub(super) struct Weights {
    positions: HashMap<(usize, usize), f64>,
    headings: HashMap<usize, f64>,
}

impl Weights {
    /// Those of a graph.
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

/// What one sensor's records are tested against.
struct Test {
    loss: Loss,
    components: f64,
    /// Places among the squares below.
    records: Vec<usize>,
}

/// Adjusts with the losses of the settings. The weights of the factors end as used.
///
/// `known` are weights that a near adjustment found: the search for outliers starts from them.
pub(super) fn solve(
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
    let mut ended = graph.solve(state, factor, MOST_ITERATIONS, progress)?;
    let tests = tests(graph, settings);
    let squares = squares(graph, state);
    let suspicious = tests.iter().any(|test| test.is_suspicious(&squares));
    let all_count = weights_of(graph).iter().all(|weight| *weight >= 1.0);
    if !suspicious && all_count {
        return Ok(ended);
    }
    let first = ended;
    // First with the IMU as the project says and the median of its residuals, which outliers that
    // still bend the trajectory do not move; then, where the IMU turns out to shake more than that,
    // anew with the mean, which also holds one that shakes now and then.
    let truncated = known.is_none() && tests.iter().any(|test| test.loss == Loss::Truncated);
    let choose =
        |graph: &mut Graph, state: &mut State, factor: &mut ChainFactor, component: Component| {
            if truncated {
                graduate(graph, state, factor, &tests, progress)?;
            }
            settle(graph, state, factor, &tests, component, progress)
        };
    ended.iterations += choose(graph, state, factor, imu_median_component)?;
    rescale(graph, state, factor, mean_component);
    if graph.imu_scale > NOTABLE_SCALE {
        ended.iterations += choose(graph, state, factor, mean_component)?;
    }
    // The records are chosen; the adjustment takes the IMU as the project does.
    graph.imu_scale = 1.0;
    let last = graph.solve(state, factor, MOST_ITERATIONS, progress)?;
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
    tests: &[Test],
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
        let next = final_weights(tests, &squares(graph, state), &weights_of(graph));
        set_weights(graph, &next);
        iterations += graph
            .solve(state, factor, MOST_ITERATIONS, progress)?
            .iterations;
        let settled = before.as_ref().is_some_and(|before| {
            let mut pairs = before.iter().zip(&next);
            pairs.all(|(a, b)| (a - b).abs() < 1e-3)
        });
        before = Some(next);
        rounds += 1;
        if settled || rounds == MOST_SETTLINGS {
            return Ok(iterations);
        }
    }
}

/// Half the squared normalised residuals with the IMU as the project says, a rejected record
/// counting as one at the limit of its test: what the truncated loss makes least.
pub(super) fn truncated_cost(graph: &Graph, ended: &Ended) -> f64 {
    let lost =
        |components: f64, weight: f64| 0.5 * (1.0 - weight) * chi_square(components, LIMIT_NORMAL);
    let positions = graph.positions.iter().map(|fix| lost(3.0, fix.weight));
    let headings = graph.headings.iter().map(|fix| lost(1.0, fix.weight));
    ended.cost + positions.sum::<f64>() + headings.sum::<f64>()
}

/// Scales the IMU's standard deviations with which records are tested by what its residuals say: an
/// IMU that shakes more than its datasheet says would else make outliers of good records. The
/// scale stays at 1 or above.
fn rescale(graph: &mut Graph, state: &State, factor: &ChainFactor, component: Component) {
    if let Some(square) = component(graph, state, factor) {
        graph.imu_scale = (graph.imu_scale * square.sqrt()).max(1.0);
    }
}

/// A variance component of the IMU.
type Component = fn(&Graph, &State, &ChainFactor) -> Option<f64>;

fn mean_component(graph: &Graph, state: &State, factor: &ChainFactor) -> Option<f64> {
    imu_variance_component(graph, state, factor).map(|(square, _)| square)
}

impl Test {
    /// c²: the limit for records whose standard deviations are right, scaled up where the median
    /// shows that the sensor's are too small.
    fn limit(&self, squares: &[f64]) -> f64 {
        self.scale(squares) * chi_square(self.components, LIMIT_NORMAL)
    }

    /// Whether more records pass the limit than chance lets pass, or one by far: a search for
    /// outliers costs ten adjustments.
    fn is_suspicious(&self, squares: &[f64]) -> bool {
        if self.loss == Loss::None {
            return false;
        }
        let scale = self.scale(squares);
        let beyond = |normal: f64| {
            let limit = scale * chi_square(self.components, normal);
            self.records.iter().filter(|&&i| squares[i] > limit).count()
        };
        let expected = PASSING * self.records.len() as f64;
        let chance = expected + CHANCE_SIGMAS * expected.sqrt() + 1.0;
        beyond(LIMIT_NORMAL) as f64 > chance || beyond(FAR_NORMAL) > 0
    }

    fn scale(&self, squares: &[f64]) -> f64 {
        let median = median(self.records.iter().map(|&i| squares[i]));
        let scale = median.map(|median| median / chi_square(self.components, 0.0));
        scale.map_or(f64::INFINITY, |scale| scale.max(1.0))
    }
}

fn tests(graph: &Graph, settings: &TrajectorySettings) -> Vec<Test> {
    let positions = graph.positions.len();
    let mut tests: Vec<Test> = settings
        .positions
        .iter()
        .enumerate()
        .map(|(sensor, own)| Test {
            loss: own.loss,
            components: 3.0,
            records: (0..positions)
                .filter(|&i| graph.positions[i].sensor == sensor)
                .collect(),
        })
        .collect();
    tests.push(Test {
        loss: settings.heading.loss,
        components: 1.0,
        records: (positions..positions + graph.headings.len()).collect(),
    });
    tests
}

/// Squared normalised residuals of all positions, then of all headings.
pub(super) fn squares(graph: &Graph, state: &State) -> Vec<f64> {
    let constants = state.constants.as_slice();
    let gravity = graph.known.gravity_m_s2(constants);
    let steps = || 0..graph.timeline.steps();
    let positions = steps().flat_map(|step| {
        graph.positions_of(step).iter().map(move |fix| {
            let (node, bias) = (&state.nodes[step], graph.bias(state, step));
            let sensor = &graph.sensors[fix.sensor];
            let residual = fix.residual(sensor, gravity, node, bias, constants);
            fix.normalised(&residual).norm_squared()
        })
    });
    let headings = steps().flat_map(|step| {
        graph.headings[graph.heading_range(step)]
            .iter()
            .map(move |fix| {
                let (node, bias) = (&state.nodes[step], graph.bias(state, step));
                (fix.residual(&graph.known, node, bias, constants) / fix.sigma_rad).powi(2)
            })
    });
    positions.chain(headings).collect()
}

fn weights_of(graph: &Graph) -> Vec<f64> {
    let positions = graph.positions.iter().map(|fix| fix.weight);
    positions
        .chain(graph.headings.iter().map(|fix| fix.weight))
        .collect()
}

pub(super) fn set_weights(graph: &mut Graph, weights: &[f64]) {
    let (positions, headings) = weights.split_at(graph.positions.len());
    for (fix, weight) in graph.positions.iter_mut().zip(positions) {
        fix.weight = *weight;
    }
    for (fix, weight) in graph.headings.iter_mut().zip(headings) {
        fix.weight = *weight;
    }
}

/// Rounds of graduated non-convexity over the sensors with truncated loss.
fn graduate(
    graph: &mut Graph,
    state: &mut State,
    factor: &mut ChainFactor,
    tests: &[Test],
    progress: &dyn Progress,
) -> Result<()> {
    let mut sharpness: Option<f64> = None;
    for _ in 0..MOST_ROUNDS {
        let squares = squares(graph, state);
        let mut weights = weights_of(graph);
        let truncated = || tests.iter().filter(|test| test.loss == Loss::Truncated);
        let worst = truncated()
            .flat_map(|test| {
                let limit = test.limit(&squares);
                test.records.iter().map(move |&i| (i, limit))
            })
            .map(|(i, limit)| squares[i] / limit)
            .fold(0.0, f64::max);
        let mu = match sharpness {
            None => 1.0 / (2.0 * worst - 1.0).max(1e-3),
            Some(mu) => mu * SHARPENING,
        };
        sharpness = Some(mu);
        let mut undecided = false;
        for test in truncated() {
            let limit = test.limit(&squares);
            for &i in &test.records {
                let ratio = squares[i] / limit;
                weights[i] = if ratio <= mu / (mu + 1.0) {
                    1.0
                } else if ratio >= (mu + 1.0) / mu {
                    0.0
                } else {
                    undecided = true;
                    (mu * (mu + 1.0) / ratio).sqrt() - mu
                };
            }
        }
        for test in tests.iter().filter(|test| smooth(test.loss)) {
            for &i in &test.records {
                weights[i] = smooth_weight(test, squares[i]);
            }
        }
        set_weights(graph, &weights);
        graph.solve(state, factor, ROUND_ITERATIONS, progress)?;
        if !undecided && mu > 1.0 {
            break;
        }
    }
    Ok(())
}

fn smooth(loss: Loss) -> bool {
    matches!(loss, Loss::Huber | Loss::Cauchy)
}

/// ψ(u)/u of Huber's and Cauchy's losses of the length √u.
fn smooth_weight(test: &Test, square: f64) -> f64 {
    match test.loss {
        Loss::Huber => (HUBER_SIGMAS * (test.components / square).sqrt()).min(1.0),
        Loss::Cauchy => 1.0 / (1.0 + square / (CAUCHY_SIGMAS.powi(2) * test.components)),
        Loss::None | Loss::Truncated => 1.0,
    }
}

fn final_weights(tests: &[Test], squares: &[f64], before: &[f64]) -> Vec<f64> {
    let mut weights = before.to_vec();
    for test in tests {
        // The scale of a sensor is that of the records it keeps.
        let limit = test.limit(squares);
        for &i in &test.records {
            weights[i] = match test.loss {
                Loss::Truncated => f64::from(squares[i] <= limit),
                _ => smooth_weight(test, squares[i]),
            };
        }
    }
    weights
}

/// Huber's weights for every record, whatever its loss: for tests that must see what is rejected.
pub(super) fn cautious_weights(squares: &[f64], positions: usize) -> Vec<f64> {
    squares
        .iter()
        .enumerate()
        .map(|(i, square)| {
            let components: f64 = if i < positions { 3.0 } else { 1.0 };
            (HUBER_SIGMAS * (components / square).sqrt()).min(1.0)
        })
        .collect()
}
