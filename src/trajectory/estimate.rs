//! The trajectory stage: logs in, poses with standard deviations out.

use super::chain::{
    BIAS, ChainFactor, ChainSystem, NODE, NotPositive, PriorSystem, StepSystem, TAIL, WalkSystem,
};
use super::covariance::PosteriorCovariance;
use super::factors::{ImuFactor, NodeState};
use super::initial::{Initial, initial};
use super::interpolate::Trajectory;
use super::preintegration::Preintegrated;
use super::solution::{SensorResiduals, Solution, StopReason, Tally};
use super::timeline::Timeline;
use crate::error::{Error, Result};
use crate::geometry::so3::exp;
use crate::geometry::{Mat3, Vec3, pose};
use crate::progress::Progress;
use crate::project::TrajectorySettings;
use crate::sensor::{HeadingFix, ImuBias, ImuSample, PoseRecord, PoseSigma, PositionFix};
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
const MOST_ITERATIONS: usize = 50;
/// Converged where a step is shorter than this, in posterior standard deviations: it moves no
/// functional of the trajectory by more than 5 % of its own sigma. The step is still taken, and
/// as convergence is quadratic, what is left is far less.
const CONVERGED_SIGMAS: f64 = 0.05;
/// Rise of the cost (half the sum of squared normalised residuals) that rounding may cause.
const COST_ROUNDING: f64 = 1e-6;
/// Steps per task where costs are summed; fixed, so that sums do not depend on the threads.
const TASK: usize = 512;

/// What the sensors of one drive recorded, each stream in time order.
#[derive(Debug, Clone, Copy)]
pub struct MotionLogs<'a> {
    /// Rates and specific forces.
    pub imu: &'a [ImuSample],
    /// Positions, one stream for each of [`TrajectorySettings::positions`].
    pub positions: &'a [Vec<PositionFix>],
    /// Headings; may be empty.
    pub heading: &'a [HeadingFix],
}

/// The estimated trajectory and all that is known about it.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// A node at every IMU sample and one at the end of the last, with velocity, biases and
    /// standard deviations.
    pub trajectory: Trajectory,
    /// How the adjustment ended and what it left.
    pub solution: Solution,
    /// The joint covariance of all nodes.
    pub covariance: PosteriorCovariance,
}

/// Estimates the trajectory from an IMU, prism fixes and headings: a factor graph on a chain with
/// a node at every IMU sample and biases at the prism rate, solved by Levenberg-Marquardt.
///
/// Fixes outside the IMU's span are ignored and counted. Without headings the direction of travel
/// gives the start, and the standard deviations say how well the yaw is found.
///
/// # Errors
/// Records that are not finite or not in strictly increasing time, streams that do not overlap,
/// too few prism fixes, an IMU gap over a second, neither headings nor motion.
pub fn estimate(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Estimate> {
    let imu = logs.imu;
    let timeline = Timeline::new(imu, &logs.positions[0], logs.heading, settings)?;
    report_flaws(&timeline, progress);
    let start = initial(imu, &timeline, settings)?;
    if let Some((from, to)) = start.rest_s {
        progress.say(&format!(
            "gyro bias from the rest between {from:.1} s and {to:.1} s"
        ));
    }
    if start.heading_from_motion {
        progress.warn("no headings: the yaw starts from the direction of travel");
    }
    let graph = Graph::new(imu, timeline, settings, &start)?;
    let state = State {
        biases: vec![start.bias; graph.timeline.layout.biases()],
        nodes: start.nodes,
    };
    progress.begin("trajectory", MOST_ITERATIONS as u64);
    // Enter the thread pool once: each entry from outside costs two thread switches.
    let solved = rayon::scope(|_| graph.solve(state, progress));
    progress.end();
    let (state, factor, mut solution) = solved?;
    graph.summarise(&state, &mut solution);
    let trajectory = Trajectory::new(graph.records(&state, &factor))?;
    if solution.converged {
        progress.say(&solution.to_string());
    } else {
        progress.warn(&format!(
            "{solution}: check lever arm, axes, heading offset and the clocks of the logs"
        ));
    }
    Ok(Estimate {
        trajectory,
        solution,
        covariance: PosteriorCovariance::new(factor),
    })
}

fn report_flaws(timeline: &Timeline, progress: &dyn Progress) {
    if let Some((from, length)) = timeline.imu_gap_s {
        progress.warn(&format!(
            "the IMU log is silent for {length:.3} s from {from:.3} s: the sample before stands \
             for that time"
        ));
    }
    for (name, ignored) in [
        ("prism fixes", timeline.prism_ignored),
        ("headings", timeline.heading_ignored),
    ] {
        if ignored > 0 {
            progress.warn(&format!(
                "{ignored} {name} outside the IMU's span are not used"
            ));
        }
    }
}

/// All unknowns.
#[derive(Debug, Clone)]
struct State {
    nodes: Vec<NodeState>,
    biases: Vec<ImuBias>,
}

/// The factor graph.
struct Graph<'a> {
    timeline: Timeline,
    imu: Vec<ImuFactor>,
    settings: &'a TrajectorySettings,
    /// Centre of the priors.
    first: (NodeState, ImuBias),
}

fn per_unknown(values: [f64; 5]) -> [f64; TAIL] {
    std::array::from_fn(|i| values[i / 3])
}

impl<'a> Graph<'a> {
    fn new(
        imu: &[ImuSample],
        timeline: Timeline,
        settings: &'a TrajectorySettings,
        start: &Initial,
    ) -> Result<Self> {
        let factors: Option<Vec<ImuFactor>> = imu
            .par_iter()
            .enumerate()
            .with_min_len(TASK)
            .map(|(step, sample)| {
                let mut sums = Preintegrated::new(start.bias);
                let dt = timeline.dt_s(step);
                sums.add(sample.gyro_rad_s, sample.accel_m_s2, dt, &settings.imu);
                ImuFactor::new(&sums)
            })
            .collect();
        let imu = factors.ok_or_else(|| {
            Error::data(
                "the IMU noise makes no positive definite covariance",
                "check the IMU's noise densities",
            )
        })?;
        Ok(Self {
            timeline,
            imu,
            settings,
            first: (start.nodes[0], start.bias),
        })
    }

    fn bias<'s>(&self, state: &'s State, step: usize) -> &'s ImuBias {
        &state.biases[self.timeline.layout.bias_of_step[step] as usize]
    }

    /// Half the squared normalised residuals of one step.
    fn step_cost(&self, state: &State, step: usize) -> f64 {
        let g = self.settings.gravity_m_s2;
        let bias = self.bias(state, step);
        let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
        let factor = &self.imu[step];
        let whitened = factor.whiten(&factor.residual(g, from, to, bias));
        let mut sum: f64 = whitened.iter().map(|x| x * x).sum();
        for fix in self.timeline.prism_of(step) {
            sum += fix.residual(g, from, bias).norm_squared() / fix.sigma_m.powi(2);
        }
        for fix in self.timeline.heading_of(step) {
            sum += (fix.residual(from, bias) / fix.sigma_rad).powi(2);
        }
        0.5 * sum
    }

    /// Half the sum of all squared normalised residuals.
    fn cost(&self, state: &State) -> f64 {
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
        tasks.iter().sum::<f64>() + walks + prior
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

    fn walk(&self, state: &State, k: usize) -> WalkSystem {
        let dt = self.timeline.bias_start_s[k + 1] - self.timeline.bias_start_s[k];
        let (old, new) = (&state.biases[k], &state.biases[k + 1]);
        let gyro = new.gyro_rad_s - old.gyro_rad_s;
        let accel = new.accel_m_s2 - old.accel_m_s2;
        let noise = &self.settings.imu;
        let weight = [noise.gyro_bias_walk, noise.accel_bias_walk].map(|w| 1.0 / (w * w * dt));
        WalkSystem {
            weight: std::array::from_fn(|i| weight[i / 3]),
            difference: [gyro.x, gyro.y, gyro.z, accel.x, accel.y, accel.z],
        }
    }

    fn linearise(&self, state: &State, step: usize, system: &mut StepSystem) {
        let g = self.settings.gravity_m_s2;
        let bias = self.bias(state, step);
        let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
        self.imu[step].add_to(system, g, from, to, bias);
        for fix in self.timeline.prism_of(step) {
            fix.add_to(system, g, from, bias);
        }
        for fix in self.timeline.heading_of(step) {
            fix.add_to(system, from, bias);
        }
    }

    fn factorise(
        &self,
        state: &State,
        damping: f64,
        factor: &mut ChainFactor,
    ) -> std::result::Result<(), NotPositive> {
        let weight = per_unknown(PRIOR_SIGMA).map(|s| 1.0 / (s * s));
        let miss = self.prior_miss(state);
        // The derivative of the attitude's miss is the identity to first order of the miss, and
        // the prior's weight is small: no more is needed.
        let prior = PriorSystem {
            weight,
            g: std::array::from_fn(|i| -weight[i] * miss[i]),
        };
        factor.factorise(&ChainSystem {
            step: &|step, system: &mut StepSystem| self.linearise(state, step, system),
            walk: &|k| self.walk(state, k),
            prior,
            damping: per_unknown(DAMPING_SIGMA).map(|s| damping / (s * s)),
        })
    }

    /// Levenberg-Marquardt from `state`; every step is accepted or refused on the true cost.
    /// Returns the state, the undamped factor at it (or within 5 % of a standard deviation of
    /// it) and how it ended.
    fn solve(
        &self,
        mut state: State,
        progress: &dyn Progress,
    ) -> Result<(State, ChainFactor, Solution)> {
        let mut factor = ChainFactor::new(self.timeline.layout.clone());
        let mut node_steps = vec![[0.0; NODE]; state.nodes.len()];
        let mut bias_steps = vec![[0.0; BIAS]; state.biases.len()];
        let cost_initial = self.cost(&state);
        let (mut cost, mut damping, mut iterations) = (cost_initial, 0.0, 0);
        let stop = loop {
            if iterations == MOST_ITERATIONS {
                break StopReason::IterationLimit;
            }
            iterations += 1;
            progress.advance(1);
            let solvable = self.factorise(&state, damping, &mut factor).is_ok();
            if solvable {
                factor.back_substitute(&mut node_steps, &mut bias_steps);
                let trial = moved(&state, &node_steps, &bias_steps);
                let trial_cost = self.cost(&trial);
                if trial_cost <= cost + COST_ROUNDING {
                    (state, cost) = (trial, trial_cost);
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
        if stop != StopReason::Converged {
            self.factorise(&state, 0.0, &mut factor).map_err(|NotPositive { node }| {
                Error::data(
                    format!(
                        "the trajectory is not determined at {:.3} s ({stop} after {iterations} \
                         iterations)",
                        self.timeline.times_s[node]
                    ),
                    "check lever arm, axes, heading offset and the clocks of the logs",
                )
            })?;
        }
        let solution = Solution::new(iterations, stop, cost_initial, cost);
        Ok((state, factor, solution))
    }

    /// Adds the residuals of every sensor to `solution`.
    fn summarise(&self, state: &State, solution: &mut Solution) {
        let g = self.settings.gravity_m_s2;
        let [mut prism, mut heading, mut gyro, mut accel] = [Tally::default(); 4];
        let noise = &self.settings.imu;
        for step in 0..self.timeline.steps() {
            let bias = self.bias(state, step);
            let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
            let factor = &self.imu[step];
            let dt = factor.duration_s();
            let [turn, _, velocity] = factor.residual(g, from, to, bias);
            gyro.add_vector(&(turn / dt), noise.gyro_density / dt.sqrt());
            accel.add_vector(&(velocity / dt), noise.accel_density / dt.sqrt());
            for fix in self.timeline.prism_of(step) {
                prism.add_vector(&fix.residual(g, from, bias), fix.sigma_m);
            }
            for fix in self.timeline.heading_of(step) {
                heading.add(fix.residual(from, bias), fix.sigma_rad);
            }
        }
        solution.prism = SensorResiduals::new(&prism, 3, self.timeline.prism_ignored);
        solution.heading = SensorResiduals::new(&heading, 1, self.timeline.heading_ignored);
        solution.gyro = SensorResiduals::new(&gyro, 3, 0);
        solution.accel = SensorResiduals::new(&accel, 3, 0);
    }

    /// The nodes with their marginal standard deviations.
    fn records(&self, state: &State, factor: &ChainFactor) -> Vec<PoseRecord> {
        let layout = &self.timeline.layout;
        let mut records: Vec<PoseRecord> = state
            .nodes
            .iter()
            .enumerate()
            .map(|(i, node)| PoseRecord {
                time_s: self.timeline.times_s[i],
                world_from_body: pose(node.rotation, node.position_m),
                velocity_m_s: Some(node.velocity_m_s),
                bias: Some(state.biases[layout.bias_of_node(i)]),
                sigma: None,
            })
            .collect();
        factor.marginals(|node, covariance| {
            let block = |at: usize| Mat3::from_fn(|a, b| covariance[at + a][at + b]);
            let world = state.nodes[node].rotation.to_rotation_matrix().into_inner();
            let rotation = world * block(0) * world.transpose();
            let root = |m: &Mat3| m.diagonal().map(|x| x.max(0.0).sqrt());
            records[node].sigma = Some(PoseSigma {
                position_m: root(&block(3)),
                rotation_rad: root(&rotation),
            });
        });
        records
    }
}

/// R ← R Exp(δφ), all else by addition.
fn moved(state: &State, nodes: &[[f64; NODE]], biases: &[[f64; BIAS]]) -> State {
    let part = |d: &[f64], at: usize| Vec3::new(d[at], d[at + 1], d[at + 2]);
    let nodes = state
        .nodes
        .par_iter()
        .zip(nodes)
        .with_min_len(TASK)
        .map(|(node, d)| {
            let mut rotation = node.rotation * exp(&part(d, 0));
            rotation.renormalize_fast();
            NodeState {
                rotation,
                position_m: node.position_m + part(d, 3),
                velocity_m_s: node.velocity_m_s + part(d, 6),
            }
        })
        .collect();
    let biases = state
        .biases
        .iter()
        .zip(biases)
        .map(|(bias, d)| ImuBias {
            gyro_rad_s: bias.gyro_rad_s + part(d, 0),
            accel_m_s2: bias.accel_m_s2 + part(d, 3),
        })
        .collect();
    State { nodes, biases }
}
