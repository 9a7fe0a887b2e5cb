//! The adjustment of a graph: its cost, its normal equations, and Levenberg-Marquardt.

use super::{Graph, State};
use crate::geometry::Vec3;
use crate::geometry::so3::exp;
use crate::progress::Progress;
use crate::sensor::ImuBias;
use crate::trajectory::chain::{
    BIAS, Border, ChainFactor, ChainSystem, ConstantsSystem, NODE, NotPositive, PriorSystem, STEP,
    StepSystem, TAIL, WalkSystem,
};
use crate::trajectory::factors::NodeState;
use crate::trajectory::solution::StopReason;
use rayon::prelude::*;

/// Standard deviations of the priors on node 0 (about the start values) and bias 0 (gyro about
/// the rest or filter value, accelerometer about zero). Wide: they only keep a drive solvable
/// that leaves something free, and its claimed standard deviation then says so. The accelerometer
/// prior is the turn-on bias of an inexpensive MEMS; it decides the tilt of a drive that never
/// turns.
pub(super) const PRIOR_SIGMA: [f64; 5] = [
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
pub const MOST_ITERATIONS: usize = 50;
/// Converged where a step is shorter than this, in posterior standard deviations: it moves no
/// functional of the trajectory by more than 5 % of its own sigma. The step is still taken, and
/// as convergence is quadratic, what is left is far less.
const CONVERGED_SIGMAS: f64 = 0.05;
/// Rise of the cost (half the sum of squared normalised residuals) that rounding may cause, as a
/// share of it.
const COST_ROUNDING: f64 = 1e-9;
/// Steps per task where costs are summed; fixed, so that sums do not depend on the threads.
const TASK: usize = 512;

/// How one adjustment ended.
#[derive(Debug, Clone, Copy)]
pub struct Ended {
    pub stop: StopReason,
    pub iterations: usize,
    pub cost_initial: f64,
    pub cost: f64,
}

pub(super) fn per_unknown(values: [f64; 5]) -> [f64; TAIL] {
    std::array::from_fn(|i| values[i / 3])
}

/// +1 or −1, as good as drawn for each probe and row (the finalizer of SplitMix64).
fn sign(probe: u64, step: usize, row: usize) -> f64 {
    let mut x = (probe << 48 | (step as u64) << 8 | row as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    if (x ^ (x >> 31)) & 1 == 0 { 1.0 } else { -1.0 }
}

impl Graph {
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

    pub(super) fn prior_miss(&self, state: &State) -> [f64; TAIL] {
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

    pub(super) fn linearise(
        &self,
        state: &State,
        step: usize,
        system: &mut StepSystem,
        border: &mut Border,
    ) {
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
    ) -> Result<(), NotPositive> {
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

    /// tr R² over the rows of the IMU, R = I − J H⁻¹ Jᵀ, by |R z|² for random signs z (Hutchinson
    /// 1990): the Fisher information of the logarithm of the IMU's variance is half of it.
    pub fn imu_information(&self, state: &State) -> Option<f64> {
        /// Signs drawn; each tells tr R² to √(2 tr R⁴), some 20 % of it.
        const PROBES: u64 = 8;
        let constants = state.constants.as_slice();
        let rows = |step: usize| {
            let nodes = (&state.nodes[step], &state.nodes[step + 1]);
            let at = (self.bias(state, step), constants);
            self.imu[step].rows(&self.known, nodes, at, self.imu_scale)
        };
        let count = self.known.count();
        let priors = || self.known.unknowns.iter().map(|u| u.prior_sigma.powi(-2));
        let mut factor = ChainFactor::new(self.timeline.layout.clone(), count);
        let mut nodes = vec![[0.0; NODE]; state.nodes.len()];
        let mut biases = vec![[0.0; BIAS]; state.biases.len()];
        let mut found = vec![0.0; count];
        let mut sum = 0.0;
        for probe in 0..PROBES {
            factor
                .factorise(&ChainSystem {
                    step: &|step, system: &mut StepSystem, border: &mut Border| {
                        self.linearise(state, step, system, border);
                        system.g = [0.0; STEP];
                        border.g.fill(0.0);
                        let (rows, by_constants, _) = rows(step);
                        for (i, row) in rows.iter().enumerate() {
                            let z = sign(probe, step, i);
                            for (g, x) in system.g.iter_mut().zip(row) {
                                *g += z * x;
                            }
                            for (column, by) in &by_constants {
                                border.g[*column] += z * by[i];
                            }
                        }
                    },
                    walk: &|k| WalkSystem {
                        difference: [0.0; BIAS],
                        ..self.walk(state, k)
                    },
                    prior: PriorSystem {
                        weight: per_unknown(PRIOR_SIGMA).map(|s| 1.0 / (s * s)),
                        g: [0.0; TAIL],
                    },
                    damping: [0.0; TAIL],
                    constants: ConstantsSystem {
                        weight: priors().collect(),
                        g: vec![0.0; count],
                        damping: vec![0.0; count],
                    },
                })
                .ok()?;
            factor.back_substitute(&mut nodes, &mut biases, &mut found);
            for step in 0..self.timeline.steps() {
                let (rows, by_constants, _) = rows(step);
                let bias = &biases[self.timeline.layout.bias_of_step[step] as usize];
                let unknowns = || nodes[step].iter().chain(&nodes[step + 1]).chain(bias);
                for (i, row) in rows.iter().enumerate() {
                    let chain: f64 = row.iter().zip(unknowns()).map(|(j, x)| j * x).sum();
                    let border: f64 = by_constants.iter().map(|(c, by)| by[i] * found[*c]).sum();
                    sum += (sign(probe, step, i) - chain - border).powi(2);
                }
            }
        }
        Some(sum / PROBES as f64)
    }

    /// Levenberg-Marquardt from `state` in place; every step is accepted or refused on the true
    /// cost. `factor` ends as the undamped factor within 5 % of a standard deviation of the
    /// solution where it converged, and is of no use where it did not.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn solve(
        &self,
        state: &mut State,
        factor: &mut ChainFactor,
        most_iterations: usize,
        progress: &dyn Progress,
    ) -> crate::Result<Ended> {
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
            progress.check()?;
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
        Ok(Ended {
            stop,
            iterations,
            cost_initial,
            cost,
        })
    }
}

fn part(d: &[f64], at: usize) -> Vec3 {
    Vec3::new(d[at], d[at + 1], d[at + 2])
}

/// R ← R Exp(δφ), all else by addition.
pub fn moved_node(node: &NodeState, d: &[f64; NODE]) -> NodeState {
    let mut rotation = node.rotation * exp(&part(d, 0));
    rotation.renormalize_fast();
    NodeState {
        rotation,
        position_m: node.position_m + part(d, 3),
        velocity_m_s: node.velocity_m_s + part(d, 6),
    }
}

pub fn moved_bias(bias: &ImuBias, d: &[f64; BIAS]) -> ImuBias {
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
