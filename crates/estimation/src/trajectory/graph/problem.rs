//! The graph as a least-squares problem: its rows, its priors, and how a step moves its unknowns.

use super::factor_graph::Graph;
use crate::adjustment::{
    BorderPrior, ChainLayout, ChainProblem, ChainStep, NODE, Prior, Rows, SEGMENT, TAIL, Unknown,
};
use crate::sensor::ImuBias;
use crate::trajectory::factors::{HeadingFactor, ImuFactor, PositionFactor};
use crate::trajectory::states::{NodeState, State};
use rayon::prelude::*;

/// Standard deviations of the priors on node 0 (about the start values) and bias 0 (gyro about
/// the rest or filter value, accelerometer about zero). They are wide: their only purpose is to
/// keep the problem solvable where a drive does not determine an unknown, whose standard deviation is
/// then as wide. The accelerometer prior is the turn-on bias of an inexpensive MEMS; it decides the tilt
/// of a drive that never turns.
const PRIOR_SIGMA: [f64; 5] = [
    1.0,   // attitude, rad
    100.0, // position, m
    100.0, // velocity, m/s
    0.1,   // gyro bias, rad/s
    0.2,   // accelerometer bias, m/s²
];
/// How far the start values may be off, in the order of [`PRIOR_SIGMA`].
const START_SIGMA: [f64; 5] = [0.1, 1.0, 1.0, 0.01, 0.1];
/// Smallest number of nodes moved by one task.
const TASK: usize = 512;

/// The factor that rows come from.
#[derive(Clone, Copy)]
pub enum Source<'a> {
    /// The IMU from the step's node to the next.
    Imu(&'a ImuFactor),
    Position(&'a PositionFactor),
    /// Heading or pitch.
    Heading(&'a HeadingFactor),
    /// The body rests at the step's node.
    Rest,
}

fn per_unknown(values: [f64; 5]) -> [f64; TAIL] {
    std::array::from_fn(|i| values[i / 3])
}

impl Graph {
    /// Visits the rows of the records of a step: all its rows but those of the IMU.
    pub fn record_rows<'a>(
        &'a self,
        state: &State,
        step: usize,
        mut visit: impl FnMut(Source<'a>, Rows<'_>),
    ) {
        let (node, bias, constants) =
            (&state.nodes[step], self.bias(state, step), &state.constants);
        for fix in self.positions_of(step) {
            let sensor = &self.sensors[fix.sensor];
            let rows = fix.rows(sensor, constants, node, bias);
            visit(Source::Position(fix), rows.weighted(fix.weight));
        }
        for fix in self.headings_of(step) {
            let rows = fix.rows(constants, node, bias);
            visit(Source::Heading(fix), rows.weighted(fix.weight));
        }
        if let Some(Some(rest)) = self.rests.get(step) {
            visit(Source::Rest, rest.rows(node).weighted(1.0));
        }
    }

    /// Visits the weights and whitened residuals of the records of a step.
    pub fn record_residuals<'a>(
        &'a self,
        state: &State,
        step: usize,
        mut visit: impl FnMut(Source<'a>, f64, &[f64]),
    ) {
        let (node, bias, constants) =
            (&state.nodes[step], self.bias(state, step), &state.constants);
        for fix in self.positions_of(step) {
            let sensor = &self.sensors[fix.sensor];
            let whitened = fix.whitened(sensor, constants, node, bias);
            visit(Source::Position(fix), fix.weight, &whitened);
        }
        for fix in self.headings_of(step) {
            let whitened = fix.whitened(constants, node, bias);
            visit(Source::Heading(fix), fix.weight, &whitened);
        }
        if let Some(Some(rest)) = self.rests.get(step) {
            visit(Source::Rest, 1.0, &rest.whitened(node));
        }
    }
}

impl ChainProblem for Graph {
    type State = State;
    type Source<'a> = Source<'a>;

    fn layout(&self) -> &ChainLayout {
        &self.timeline.layout
    }

    fn rows<'a>(&'a self, state: &State, step: usize, mut visit: impl FnMut(Source<'a>, Rows<'_>)) {
        let nodes = (&state.nodes[step], &state.nodes[step + 1]);
        let (bias, imu) = (self.bias(state, step), &self.imu[step]);
        let rows = imu.rows(&state.constants, nodes, bias, self.imu_scale);
        visit(Source::Imu(imu), rows.weighted(1.0));
        self.record_rows(state, step, visit);
    }

    fn residuals<'a>(
        &'a self,
        state: &State,
        step: usize,
        mut visit: impl FnMut(Source<'a>, f64, &[f64]),
    ) {
        let nodes = (&state.nodes[step], &state.nodes[step + 1]);
        let (bias, imu) = (self.bias(state, step), &self.imu[step]);
        let whitened = imu.whitened(&state.constants, nodes, bias, self.imu_scale);
        visit(Source::Imu(imu), 1.0, &whitened);
        self.record_residuals(state, step, visit);
    }

    /// To first order, the derivative of the attitude's miss with respect to the attitude is the identity.
    /// That suffices, because the prior's weight is small.
    fn prior(&self, state: &State) -> Prior<TAIL> {
        let mut miss = [0.0; TAIL];
        let (node, bias) = miss.split_at_mut(NODE);
        state.nodes[0].step_from(&self.first.0, node);
        state.biases[0].step_from(&self.first.1, bias);
        Prior {
            weight: per_unknown(PRIOR_SIGMA).map(|s| 1.0 / (s * s)),
            miss,
        }
    }

    fn walk(&self, state: &State, old: usize) -> Prior<SEGMENT> {
        let starts = &self.timeline.bias_start_s;
        let dt = starts[old + 1] - starts[old];
        let mut miss = [0.0; SEGMENT];
        state.biases[old + 1].step_from(&state.biases[old], &mut miss);
        let densities = [self.noise.gyro_bias_walk, self.noise.accel_bias_walk];
        let weight = densities.map(|w| 1.0 / (w * w * dt));
        Prior {
            weight: std::array::from_fn(|i| weight[i / 3]),
            miss,
        }
    }

    fn border_prior(&self, state: &State) -> BorderPrior {
        state.constants.prior()
    }

    fn damping_sigma(&self) -> [f64; TAIL] {
        per_unknown(START_SIGMA)
    }

    fn retracted(&self, state: &State, step: &ChainStep) -> State {
        let nodes = state.nodes.par_iter().zip(&step.nodes);
        let nodes = nodes.with_min_len(TASK);
        let biases = state.biases.iter().zip(&step.segments);
        State {
            nodes: nodes
                .map(|(node, d): (&NodeState, _)| node.retracted(d))
                .collect(),
            biases: biases
                .map(|(bias, d): (&ImuBias, _)| bias.retracted(d))
                .collect(),
            constants: state.constants.retracted(&step.border),
        }
    }
}
