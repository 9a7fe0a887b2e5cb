//! The factor graph of one drive: its factors, its cost, and its adjustment by
//! Levenberg-Marquardt.

mod growing;

use super::chain::{
    BIAS, Border, ChainFactor, ChainSystem, ConstantsSystem, NODE, NotPositive, StepSystem, TAIL,
    WalkSystem,
};
use super::constants::Constants;
use super::factors::{
    Ahead, HeadingFactor, ImuFactor, NodeState, PositionFactor, PositionSensor, Quantity,
    RestFactor,
};
use super::preintegration::{MotionSums, Preintegrated};
use super::rest::Rest;
use super::solution::StopReason;
use super::streams::{Numbered, Stream, Streams};
use super::timeline::{Timeline, starts};
use crate::error::{Error, Result};
use crate::geometry::heading::wrap;
use crate::geometry::so3::exp;
use crate::geometry::{Mat3, Vec3};
use crate::progress::Progress;
use crate::project::{ImuNoise, TrajectorySettings};
use crate::sensor::{HeadingFix, ImuBias, ImuSample, PositionFix};
use rayon::prelude::*;

/// Standard deviations of the priors on node 0 (about the start values) and bias 0 (gyro about
/// the rest or filter value, accelerometer about zero). Wide: they only keep a drive solvable
/// that leaves something free, and its claimed standard deviation then says so. The accelerometer
/// prior is the turn-on bias of an inexpensive MEMS; it decides the tilt of a drive that never
/// turns.
const PRIOR_SIGMA: [f64; 5] = [
    1.0,   // attitude, rad
    100.0, // position, m
    100.0, // velocity, m/s
    0.1,   // gyro bias, rad/s
    0.2,   // accelerometer bias, m/s²
];
/// Scales of the damping, in the order of [`PRIOR_SIGMA`]: what the start values may miss by.
const DAMPING_SIGMA: [f64; 5] = [0.1, 1.0, 1.0, 0.01, 0.1];
/// Damping after the first refused step; Gauss-Newton steps have none.
const FIRST_DAMPING: f64 = 1e-2;
const DAMPING_FACTOR: f64 = 10.0;
const LARGEST_DAMPING: f64 = 1e10;
/// Most iterations of one adjustment.
pub(super) const MOST_ITERATIONS: usize = 50;
/// Converged where a step is shorter than this, in posterior standard deviations: it moves no
/// functional of the trajectory by more than 5 % of its own sigma. The step is still taken, and
/// as convergence is quadratic, what is left is far less.
const CONVERGED_SIGMAS: f64 = 0.05;
/// Rise of the cost (half the sum of squared normalised residuals) that rounding may cause, as a
/// share of it.
const COST_ROUNDING: f64 = 1e-9;
/// Steps per task where costs are summed; fixed, so that sums do not depend on the threads.
const TASK: usize = 512;

/// All unknowns.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub nodes: Vec<NodeState>,
    pub biases: Vec<ImuBias>,
    /// Corrections of the constants, in the order of [`Constants::unknowns`].
    pub constants: Vec<f64>,
}

/// How one adjustment ended.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ended {
    pub stop: StopReason,
    pub iterations: usize,
    pub cost_initial: f64,
    pub cost: f64,
}

/// The factor graph.
#[derive(Debug, Clone)]
pub(super) struct Graph {
    pub timeline: Timeline,
    pub samples: Vec<ImuSample>,
    pub bridged: Vec<bool>,
    noise: ImuNoise,
    bridge_noise: ImuNoise,
    /// One a step.
    pub imu: Vec<ImuFactor>,
    /// Factor on the standard deviations of the IMU.
    pub imu_scale: f64,
    /// Sorted by step.
    pub positions: Vec<PositionFactor>,
    position_start: Vec<u32>,
    pub headings: Vec<HeadingFactor>,
    heading_start: Vec<u32>,
    /// Whether the body rests at a node, and a bias begins there.
    pub rests: Vec<Option<RestFactor>>,
    pub sensors: Vec<PositionSensor>,
    pub known: Constants,
    /// Centre of the priors.
    first: (NodeState, ImuBias),
}

fn per_unknown(values: [f64; 5]) -> [f64; TAIL] {
    std::array::from_fn(|i| values[i / 3])
}

impl Graph {
    /// Lays the streams out on the timeline, about the start values of node 0 and of the bias.
    pub fn new(
        timeline: Timeline,
        streams: &Streams,
        settings: &TrajectorySettings,
        known: Constants,
        rests: &[Rest],
        first: (NodeState, ImuBias),
    ) -> Result<Self> {
        let bias = first.1;
        let sensors = position_sensors(settings, &known);
        let mut graph = Self {
            samples: streams.imu.clone(),
            bridged: streams.bridged.clone(),
            noise: settings.imu,
            bridge_noise: streams.bridge_noise,
            imu: Vec::new(),
            imu_scale: 1.0,
            positions: Vec::new(),
            position_start: Vec::new(),
            headings: Vec::new(),
            heading_start: Vec::new(),
            rests: rest_factors(&timeline, rests),
            sensors,
            known,
            first,
            timeline,
        };
        let factors: Option<Vec<ImuFactor>> = (0..graph.timeline.steps())
            .into_par_iter()
            .with_min_len(32)
            .map(|step| ImuFactor::new(&graph.preintegrated(step, &bias)))
            .collect();
        graph.imu = factors.ok_or_else(|| {
            Error::data(
                "the IMU noise makes no positive definite covariance",
                "check the IMU's noise densities",
            )
        })?;
        graph.add_positions(streams, settings, &bias);
        graph.add_headings(streams, settings, &bias);
        Ok(graph)
    }

    /// The IMU from the node of a step to the next.
    fn preintegrated(&self, step: usize, bias: &ImuBias) -> Preintegrated {
        let (from, to) = (self.timeline.node_s[step], self.timeline.node_s[step + 1]);
        let mut sums = Preintegrated::new(*bias);
        for piece in self.timeline.pieces(from, to) {
            let sample = &self.samples[piece.sample];
            let noise = self.noise_of(piece.sample);
            sums.add(
                sample.gyro_rad_s,
                sample.accel_m_s2,
                piece.duration_s,
                noise,
            );
        }
        sums
    }

    /// Noise of a sample: that of the datasheet, or of unknown motion where it bridges a gap.
    pub fn noise_of(&self, sample: usize) -> &ImuNoise {
        if self.bridged[sample] {
            &self.bridge_noise
        } else {
            &self.noise
        }
    }

    fn ahead(&self, step: usize, time_s: f64, rest_s: f64, bias: &ImuBias) -> Ahead {
        let sample = self.samples[self.timeline.pose_at_or_before(time_s)];
        if rest_s == 0.0 {
            return Ahead { sums: None, sample };
        }
        let mut sums = MotionSums::new(*bias);
        for piece in self.timeline.pieces(self.timeline.node_s[step], time_s) {
            let sample = &self.samples[piece.sample];
            sums.add(sample.gyro_rad_s, sample.accel_m_s2, piece.duration_s);
        }
        Ahead {
            sums: Some(Box::new(sums)),
            sample,
        }
    }

    fn add_positions(&mut self, streams: &Streams, settings: &TrajectorySettings, bias: &ImuBias) {
        let mut placed = Vec::new();
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            for fix in fixes {
                let at = self.timeline.place(fix.value.time_s);
                placed.push((at.0, self.position_factor(sensor, fix, settings, at, bias)));
            }
        }
        placed.sort_by_key(|(step, _)| *step);
        self.position_start = starts(placed.iter().map(|p| p.0), self.timeline.steps());
        self.positions = placed.into_iter().map(|(_, factor)| factor).collect();
    }

    /// The factor of a fix that lies `rest_s` after the node of `step`.
    fn position_factor(
        &self,
        sensor: usize,
        fix: &Numbered<PositionFix>,
        settings: &TrajectorySettings,
        (step, rest_s): (usize, f64),
        bias: &ImuBias,
    ) -> PositionFactor {
        let time_s = fix.value.time_s;
        PositionFactor {
            ahead: self.ahead(step, time_s, rest_s, bias),
            sensor,
            record: fix.record,
            time_s,
            position_m: fix.value.position_m,
            whitener: whitener(fix.value.covariance_m2, &settings.positions[sensor].sigma_m),
            weight: 1.0,
            late: self.known.late(Stream::Position(sensor), fix.record),
        }
    }

    fn add_headings(&mut self, streams: &Streams, settings: &TrajectorySettings, bias: &ImuBias) {
        let mut steps = Vec::new();
        for fix in &streams.heading {
            let at = self.timeline.place(fix.value.time_s);
            let factors = self.heading_factors(fix, settings, at, bias);
            steps.extend(factors.iter().map(|_| at.0));
            self.headings.extend(factors);
        }
        self.heading_start = starts(steps.into_iter(), self.timeline.steps());
    }

    /// The factors of a heading, and of its pitch, that lies `rest_s` after the node of `step`.
    fn heading_factors(
        &self,
        fix: &Numbered<HeadingFix>,
        settings: &TrajectorySettings,
        (step, rest_s): (usize, f64),
        bias: &ImuBias,
    ) -> Vec<HeadingFactor> {
        let antennas = &settings.heading;
        let time_s = fix.value.time_s;
        let ahead = self.ahead(step, time_s, rest_s, bias);
        let heading = antennas.mounting_offset_rad - antennas.grid_convergence_rad;
        let factor = |quantity, value_rad, sigma_rad| HeadingFactor {
            ahead: ahead.clone(),
            record: fix.record,
            time_s,
            quantity,
            value_rad,
            sigma_rad,
            weight: 1.0,
            late: self.known.late(Stream::Heading, fix.record),
        };
        let mut factors = vec![factor(
            Quantity::Heading,
            wrap(fix.value.heading_rad + heading),
            fix.value.sigma_rad.unwrap_or(antennas.sigma_rad),
        )];
        if let Some(pitch_rad) = fix.value.pitch_rad {
            // Seen from above, the baseline lies counter-clockwise of the x axis by the offset.
            let (sin, cos) = antennas.mounting_offset_rad.sin_cos();
            let baseline = Vec3::x() * cos + settings.axes.up().cross(&Vec3::x()) * sin;
            let sigma = fix.value.pitch_sigma_rad;
            factors.push(factor(
                Quantity::Pitch(baseline),
                pitch_rad,
                sigma.unwrap_or(antennas.pitch_sigma_rad),
            ));
        }
        factors
    }

    /// Exchanges the constants, and with them which columns say how late each record is.
    pub fn set_constants(&mut self, known: Constants) {
        for fix in &mut self.positions {
            fix.late = known.late(Stream::Position(fix.sensor), fix.record);
        }
        for fix in &mut self.headings {
            fix.late = known.late(Stream::Heading, fix.record);
        }
        for (sensor, columns) in self.sensors.iter_mut().zip(&known.positions) {
            sensor.columns = *columns;
        }
        self.known = known;
    }

    /// The position factors of a step.
    pub fn positions_of(&self, step: usize) -> &[PositionFactor] {
        &self.positions[self.position_range(step)]
    }

    /// Where in [`Graph::positions`] those of a step stand.
    pub fn position_range(&self, step: usize) -> std::ops::Range<usize> {
        self.position_start[step] as usize..self.position_start[step + 1] as usize
    }

    /// Where in [`Graph::headings`] those of a step stand.
    pub fn heading_range(&self, step: usize) -> std::ops::Range<usize> {
        self.heading_start[step] as usize..self.heading_start[step + 1] as usize
    }

    /// The bias in force in a step.
    pub fn bias<'s>(&self, state: &'s State, step: usize) -> &'s ImuBias {
        &state.biases[self.timeline.layout.bias_of_step[step] as usize]
    }

    /// Half the squared normalised residuals of one step.
    fn step_cost(&self, state: &State, step: usize) -> f64 {
        let constants = state.constants.as_slice();
        let g = self.known.gravity_m_s2(constants);
        let bias = self.bias(state, step);
        let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
        let factor = &self.imu[step];
        let whitened = factor.whiten(&factor.residual(g, from, to, bias));
        let mut sum = whitened.iter().map(|x| x * x).sum::<f64>() / self.imu_scale.powi(2);
        for fix in self.positions_of(step) {
            let sensor = &self.sensors[fix.sensor];
            let residual = fix.residual(sensor, g, from, bias, constants);
            sum += fix.weight * fix.normalised(&residual).norm_squared();
        }
        for fix in &self.headings[self.heading_range(step)] {
            let residual = fix.residual(&self.known, from, bias, constants);
            sum += fix.weight * (residual / fix.sigma_rad).powi(2);
        }
        if let Some(rest) = &self.rests[step] {
            sum += rest.rows(from).1.iter().map(|x| x * x).sum::<f64>();
        }
        0.5 * sum
    }

    /// Half the sum of all squared normalised residuals.
    pub fn cost(&self, state: &State) -> f64 {
        let steps = self.timeline.steps();
        let tasks: Vec<f64> = (0..steps.div_ceil(TASK))
            .into_par_iter()
            .map(|task| {
                let end = ((task + 1) * TASK).min(steps);
                (task * TASK..end)
                    .map(|step| self.step_cost(state, step))
                    .sum()
            })
            .collect();
        let walks: f64 = (0..state.biases.len() - 1)
            .map(|k| {
                let walk = self.walk(state, k);
                (0..BIAS)
                    .map(|i| 0.5 * walk.weight[i] * walk.difference[i].powi(2))
                    .sum::<f64>()
            })
            .sum();
        let miss = self.prior_miss(state);
        let weight = per_unknown(PRIOR_SIGMA).map(|s| 1.0 / (s * s));
        let prior: f64 = (0..TAIL).map(|i| 0.5 * weight[i] * miss[i].powi(2)).sum();
        let constants: f64 = self
            .known
            .unknowns
            .iter()
            .zip(&state.constants)
            .map(|(unknown, value)| 0.5 * (value / unknown.prior_sigma).powi(2))
            .sum();
        tasks.iter().sum::<f64>() + walks + prior + constants
    }

    fn prior_miss(&self, state: &State) -> [f64; TAIL] {
        let (node, bias) = (&state.nodes[0], &state.biases[0]);
        let parts = [
            (self.first.0.rotation.inverse() * node.rotation).scaled_axis(),
            node.position_m - self.first.0.position_m,
            node.velocity_m_s - self.first.0.velocity_m_s,
            bias.gyro_rad_s - self.first.1.gyro_rad_s,
            bias.accel_m_s2 - self.first.1.accel_m_s2,
        ];
        std::array::from_fn(|i| parts[i / 3][i % 3])
    }

    pub fn walk(&self, state: &State, k: usize) -> WalkSystem {
        let dt = self.timeline.bias_start_s[k + 1] - self.timeline.bias_start_s[k];
        let (old, new) = (&state.biases[k], &state.biases[k + 1]);
        let gyro = new.gyro_rad_s - old.gyro_rad_s;
        let accel = new.accel_m_s2 - old.accel_m_s2;
        let weight =
            [self.noise.gyro_bias_walk, self.noise.accel_bias_walk].map(|w| 1.0 / (w * w * dt));
        WalkSystem {
            weight: std::array::from_fn(|i| weight[i / 3]),
            difference: [gyro.x, gyro.y, gyro.z, accel.x, accel.y, accel.z],
        }
    }

    fn linearise(&self, state: &State, step: usize, system: &mut StepSystem, border: &mut Border) {
        let constants = state.constants.as_slice();
        let bias = self.bias(state, step);
        let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
        self.imu[step].add_to(
            system,
            border,
            &self.known,
            (from, to),
            (bias, constants),
            self.imu_scale,
        );
        let at = (from, bias, constants);
        for fix in self.positions_of(step) {
            fix.add_to(system, border, &self.sensors[fix.sensor], &self.known, at);
        }
        for fix in &self.headings[self.heading_range(step)] {
            fix.add_to(system, border, &self.known, at);
        }
        if let Some(rest) = &self.rests[step] {
            rest.add_to(system, border, from);
        }
    }

    /// Factorises the normal equations at `state`.
    pub fn factorise(
        &self,
        state: &State,
        damping: f64,
        factor: &mut ChainFactor,
    ) -> std::result::Result<(), NotPositive> {
        let priors = || self.known.unknowns.iter().map(|u| u.prior_sigma.powi(-2));
        factor.factorise(&ChainSystem {
            step: &|step, system: &mut StepSystem, border: &mut Border| {
                self.linearise(state, step, system, border);
            },
            walk: &|k| self.walk(state, k),
            prior: self.prior(state),
            damping: per_unknown(DAMPING_SIGMA).map(|s| damping / (s * s)),
            constants: ConstantsSystem {
                weight: priors().collect(),
                g: priors()
                    .zip(&state.constants)
                    .map(|(w, x)| -w * x)
                    .collect(),
                damping: priors().map(|w| damping * w).collect(),
            },
        })
    }

    /// Levenberg-Marquardt from `state` in place; every step is accepted or refused on the true
    /// cost. `factor` ends as the undamped factor within 5 % of a standard deviation of the
    /// solution where it converged, and is of no use where it did not.
    pub fn solve(
        &self,
        state: &mut State,
        factor: &mut ChainFactor,
        most_iterations: usize,
        progress: &dyn Progress,
    ) -> Ended {
        let mut node_steps = vec![[0.0; NODE]; state.nodes.len()];
        let mut bias_steps = vec![[0.0; BIAS]; state.biases.len()];
        let mut constant_steps = vec![0.0; state.constants.len()];
        let cost_initial = self.cost(state);
        let (mut cost, mut damping, mut iterations) = (cost_initial, 0.0, 0);
        let stop = loop {
            if iterations == most_iterations {
                break StopReason::IterationLimit;
            }
            iterations += 1;
            progress.advance(1);
            if self.factorise(state, damping, factor).is_ok() {
                factor.back_substitute(&mut node_steps, &mut bias_steps, &mut constant_steps);
                let trial = moved(state, &node_steps, &bias_steps, &constant_steps);
                let trial_cost = self.cost(&trial);
                if trial_cost <= cost + COST_ROUNDING * (1.0 + cost) {
                    (*state, cost) = (trial, trial_cost);
                    if damping == 0.0 && factor.decrement() < CONVERGED_SIGMAS.powi(2) {
                        break StopReason::Converged;
                    }
                    damping /= DAMPING_FACTOR;
                    if damping < FIRST_DAMPING {
                        damping = 0.0;
                    }
                    continue;
                }
            }
            damping = (damping * DAMPING_FACTOR).max(FIRST_DAMPING);
            if damping > LARGEST_DAMPING {
                break StopReason::NoBetterStep;
            }
        };
        Ended {
            stop,
            iterations,
            cost_initial,
            cost,
        }
    }
}

fn position_sensors(settings: &TrajectorySettings, known: &Constants) -> Vec<PositionSensor> {
    let sensors = settings.positions.iter().zip(&known.positions);
    sensors
        .map(|(sensor, columns)| PositionSensor {
            lever_arm_m: sensor.lever_arm_m,
            station_m: sensor.station_m,
            up: settings.axes.up(),
            columns: *columns,
        })
        .collect()
}

/// The resting nodes at which a bias begins: as many whatever the nodes.
fn rest_factors(timeline: &Timeline, rests: &[Rest]) -> Vec<Option<RestFactor>> {
    (0..timeline.steps())
        .map(|step| {
            let time_s = timeline.node_s[step];
            let resting = rests.iter().any(|rest| rest.holds_at(time_s));
            let begins = step == 0 || timeline.layout.changes_before(step);
            (resting && begins).then_some(RestFactor {
                sigma_m_s: Rest::SIGMA_M_S,
            })
        })
        .collect()
}

/// W with Wᵀ W the inverse of the covariance, or of the variances where none is given.
fn whitener(covariance_m2: Option<Mat3>, sigma_m: &Vec3) -> Mat3 {
    covariance_m2
        .and_then(|c| c.cholesky())
        .and_then(|c| c.l().try_inverse())
        .unwrap_or_else(|| Mat3::from_diagonal(&sigma_m.map(|s| 1.0 / s)))
}

fn part(d: &[f64], at: usize) -> Vec3 {
    Vec3::new(d[at], d[at + 1], d[at + 2])
}

/// R ← R Exp(δφ), all else by addition.
pub(super) fn moved_node(node: &NodeState, d: &[f64; NODE]) -> NodeState {
    let mut rotation = node.rotation * exp(&part(d, 0));
    rotation.renormalize_fast();
    NodeState {
        rotation,
        position_m: node.position_m + part(d, 3),
        velocity_m_s: node.velocity_m_s + part(d, 6),
    }
}

pub(super) fn moved_bias(bias: &ImuBias, d: &[f64; BIAS]) -> ImuBias {
    ImuBias {
        gyro_rad_s: bias.gyro_rad_s + part(d, 0),
        accel_m_s2: bias.accel_m_s2 + part(d, 3),
    }
}

fn moved(state: &State, nodes: &[[f64; NODE]], biases: &[[f64; BIAS]], constants: &[f64]) -> State {
    let nodes = state
        .nodes
        .par_iter()
        .zip(nodes)
        .with_min_len(TASK)
        .map(|(node, d)| moved_node(node, d))
        .collect();
    let biases = state.biases.iter().zip(biases);
    let constants = state.constants.iter().zip(constants);
    State {
        nodes,
        biases: biases.map(|(bias, d)| moved_bias(bias, d)).collect(),
        constants: constants.map(|(x, d)| x + d).collect(),
    }
}
