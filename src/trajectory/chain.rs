//! Cholesky factorisation of normal equations that form a chain.
//!
//! Unknowns are nodes (9: attitude, position, velocity) and IMU biases (6: gyro, accelerometer).
//! Step i ties node i, node i + 1 and the bias in force; a random walk ties each bias to the next.
//! Eliminating in time order keeps every front small and of fixed shape:
//!
//! | front | pivots | separator |
//! |---|---|---|
//! | step i | node i (9) | node i + 1 (9), bias (6) |
//! | change of bias before step i | old bias (6) | node i (9), new bias (6) |
//! | tail | last node and bias (15) | |
//!
//! H = Uᵀ U with one block of rows of U per front. Constants that touch every step (a lever arm, a
//! latency) would widen each separator by a dense border at its right end; the order of
//! elimination stays as it is.

use rayon::prelude::*;

/// Unknowns of a node: δφ (body), δp (world), δv (world).
pub(super) const NODE: usize = 9;
/// Unknowns of a bias: gyro, accelerometer.
pub(super) const BIAS: usize = 6;
/// Node and bias together.
pub(super) const TAIL: usize = NODE + BIAS;
/// Unknowns a step touches: node i, node i + 1, bias.
pub(super) const STEP: usize = 2 * NODE + BIAS;
/// Unknowns a change of bias touches: old bias, node, new bias.
pub(super) const CHANGE: usize = NODE + 2 * BIAS;
/// Steps linearised at a time while the steps before them are eliminated; sized for the cache.
const CHUNK: usize = 256;
/// Steps linearised by one task.
const TASK: usize = 64;

/// Which bias each step uses; a step's bias is that of the step before or the next one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChainLayout {
    pub bias_of_step: Vec<u32>,
}

impl ChainLayout {
    pub fn steps(&self) -> usize {
        self.bias_of_step.len()
    }

    pub fn nodes(&self) -> usize {
        self.steps() + 1
    }

    pub fn biases(&self) -> usize {
        self.bias_of_step.last().map_or(0, |&k| k as usize + 1)
    }

    /// The bias in force at `node`: that of its step, for the last node that of the last step.
    pub fn bias_of_node(&self, node: usize) -> usize {
        self.bias_of_step[node.min(self.steps() - 1)] as usize
    }

    /// Whether the bias changes before step `i`; the old one is `bias_of_step[i] − 1`.
    pub fn changes_before(&self, i: usize) -> bool {
        i > 0 && self.bias_of_step[i] != self.bias_of_step[i - 1]
    }
}

/// The normal equations H δ = g of one step, order node i, node i + 1, bias; only the upper
/// triangle of H counts.
#[derive(Debug, Clone)]
pub(super) struct StepSystem {
    pub h: [[f64; STEP]; STEP],
    pub g: [f64; STEP],
}

impl StepSystem {
    pub const ZERO: Self = Self {
        h: [[0.0; STEP]; STEP],
        g: [0.0; STEP],
    };
}

/// The prior on (node 0, bias 0): diagonal weights and right-hand side.
#[derive(Debug, Clone, Copy)]
pub(super) struct PriorSystem {
    pub weight: [f64; TAIL],
    pub g: [f64; TAIL],
}

/// The random walk from one bias to the next: 1/σ², and new − old.
#[derive(Debug, Clone, Copy)]
pub(super) struct WalkSystem {
    pub weight: [f64; BIAS],
    pub difference: [f64; BIAS],
}

/// The normal equations of a chain, linearised on demand.
pub(super) struct ChainSystem<'a, S, W> {
    /// Adds step i to a zeroed system.
    pub step: &'a S,
    /// The walk from bias k to bias k + 1.
    pub walk: &'a W,
    pub prior: PriorSystem,
    /// Added to the diagonal of every node and bias.
    pub damping: [f64; TAIL],
}

/// The factor U and y = U⁻ᵀ g.
#[derive(Debug, Clone)]
pub(super) struct ChainFactor {
    pub layout: ChainLayout,
    pub step_rows: Vec<[[f64; STEP]; NODE]>,
    step_y: Vec<[f64; NODE]>,
    pub change_rows: Vec<[[f64; CHANGE]; BIAS]>,
    change_y: Vec<[f64; BIAS]>,
    pub tail_rows: [[f64; TAIL]; TAIL],
    tail_y: [f64; TAIL],
}

/// A pivot that is not positive: the data (and priors) leave something free at this node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NotPositive {
    pub node: usize,
}

/// Normal equations carried from the fronts before to (node, bias); upper triangle.
struct Carry {
    h: [[f64; TAIL]; TAIL],
    g: [f64; TAIL],
}

/// Where (node, bias) stand in a step's front.
fn step_place(a: usize) -> usize {
    if a < NODE { a } else { a + NODE }
}

/// Eliminates the first P of N unknowns in place: rows 0..P become rows of U, the rest the Schur
/// complement. Upper triangles. False where a pivot is not positive.
fn eliminate<const P: usize, const N: usize>(h: &mut [[f64; N]; N], g: &mut [f64; N]) -> bool {
    for k in 0..P {
        let pivot = h[k][k];
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        let inverse = 1.0 / pivot.sqrt();
        let row = h[k].map(|x| x * inverse);
        h[k] = row;
        g[k] *= inverse;
        let y = g[k];
        for i in k + 1..N {
            let factor = row[i];
            // From the multiple of 4 below i: whole vectors, the entries left of i are not used.
            let start = i & !3;
            for (x, r) in h[i][start..].iter_mut().zip(&row[start..]) {
                *x -= factor * r;
            }
            g[i] -= factor * y;
        }
    }
    true
}

impl ChainFactor {
    /// Room for the factor of a chain with at least one step.
    pub fn new(layout: ChainLayout) -> Self {
        let (steps, changes) = (layout.steps(), layout.biases() - 1);
        Self {
            layout,
            step_rows: vec![[[0.0; STEP]; NODE]; steps],
            step_y: vec![[0.0; NODE]; steps],
            change_rows: vec![[[0.0; CHANGE]; BIAS]; changes],
            change_y: vec![[0.0; BIAS]; changes],
            tail_rows: [[0.0; TAIL]; TAIL],
            tail_y: [0.0; TAIL],
        }
    }

    /// Factorises the normal equations. One chunk of steps is linearised while the one before is
    /// eliminated; the result does not depend on the number of threads.
    pub fn factorise<S, W>(&mut self, system: &ChainSystem<'_, S, W>) -> Result<(), NotPositive>
    where
        S: Fn(usize, &mut StepSystem) + Sync,
        W: Fn(usize) -> WalkSystem + Sync,
    {
        let steps = self.layout.steps();
        let chunks = steps.div_ceil(CHUNK);
        let linearise = |chunk: usize, buffer: &mut [StepSystem]| {
            let first = chunk * CHUNK;
            let count = CHUNK.min(steps.saturating_sub(first));
            buffer[..count]
                .par_chunks_mut(TASK)
                .enumerate()
                .for_each(|(task, systems)| {
                    for (offset, target) in systems.iter_mut().enumerate() {
                        *target = StepSystem::ZERO;
                        (system.step)(first + task * TASK + offset, target);
                    }
                });
        };
        let mut current = vec![StepSystem::ZERO; CHUNK];
        let mut following = vec![StepSystem::ZERO; CHUNK];
        let mut carry = Carry {
            h: [[0.0; TAIL]; TAIL],
            g: system.prior.g,
        };
        for a in 0..TAIL {
            carry.h[a][a] = system.prior.weight[a];
        }
        linearise(0, &mut current);
        for chunk in 0..chunks {
            let (done, ()) = rayon::join(
                || self.eliminate_chunk(chunk, &mut current, &mut carry, system),
                || linearise(chunk + 1, &mut following),
            );
            done?;
            std::mem::swap(&mut current, &mut following);
        }
        for a in 0..TAIL {
            carry.h[a][a] += system.damping[a];
        }
        if !eliminate::<TAIL, TAIL>(&mut carry.h, &mut carry.g) {
            return Err(NotPositive { node: steps });
        }
        self.tail_rows = carry.h;
        self.tail_y = carry.g;
        Ok(())
    }

    fn eliminate_chunk<S, W>(
        &mut self,
        chunk: usize,
        systems: &mut [StepSystem],
        carry: &mut Carry,
        system: &ChainSystem<'_, S, W>,
    ) -> Result<(), NotPositive>
    where
        W: Fn(usize) -> WalkSystem,
    {
        let first = chunk * CHUNK;
        let end = (first + CHUNK).min(self.layout.steps());
        for (i, front) in (first..end).zip(systems) {
            if self.layout.changes_before(i) {
                let old = self.layout.bias_of_step[i - 1] as usize;
                self.change_bias(old, carry, &(system.walk)(old), &system.damping)
                    .then_some(())
                    .ok_or(NotPositive { node: i })?;
            }
            for a in 0..TAIL {
                let row = &mut front.h[step_place(a)];
                for b in a..TAIL {
                    row[step_place(b)] += carry.h[a][b];
                }
                front.g[step_place(a)] += carry.g[a];
            }
            for a in 0..NODE {
                front.h[a][a] += system.damping[a];
            }
            if !eliminate::<NODE, STEP>(&mut front.h, &mut front.g) {
                return Err(NotPositive { node: i });
            }
            self.step_rows[i].copy_from_slice(&front.h[..NODE]);
            self.step_y[i].copy_from_slice(&front.g[..NODE]);
            for a in 0..TAIL {
                carry.h[a].copy_from_slice(&front.h[NODE + a][NODE..]);
                carry.g[a] = front.g[NODE + a];
            }
        }
        Ok(())
    }

    /// Eliminates bias `old` from `carry` over (node, old) and leaves (node, old + 1).
    fn change_bias(
        &mut self,
        old: usize,
        carry: &mut Carry,
        walk: &WalkSystem,
        damping: &[f64; TAIL],
    ) -> bool {
        // Order: old bias, node, new bias.
        let mut h = [[0.0; CHANGE]; CHANGE];
        let mut g = [0.0; CHANGE];
        let place = |a: usize| if a < NODE { BIAS + a } else { a - NODE };
        for a in 0..TAIL {
            for b in a..TAIL {
                let (i, j) = (place(a), place(b));
                h[i.min(j)][i.max(j)] = carry.h[a][b];
            }
            g[place(a)] = carry.g[a];
        }
        for a in 0..BIAS {
            let w = walk.weight[a];
            h[a][a] += w + damping[NODE + a];
            h[a][TAIL + a] = -w;
            h[TAIL + a][TAIL + a] = w;
            g[a] += w * walk.difference[a];
            g[TAIL + a] = -w * walk.difference[a];
        }
        if !eliminate::<BIAS, CHANGE>(&mut h, &mut g) {
            return false;
        }
        self.change_rows[old].copy_from_slice(&h[..BIAS]);
        self.change_y[old].copy_from_slice(&g[..BIAS]);
        for a in 0..TAIL {
            carry.h[a].copy_from_slice(&h[BIAS + a][BIAS..]);
            carry.g[a] = g[BIAS + a];
        }
        true
    }

    /// gᵀ H⁻¹ g: the squared length of the step in units of the posterior standard deviation.
    /// No linear functional of the unknowns moves by more than its root times its own sigma.
    pub fn decrement(&self) -> f64 {
        let square = |y: &[f64]| y.iter().map(|x| x * x).sum::<f64>();
        self.step_y.iter().map(|y| square(y)).sum::<f64>()
            + self.change_y.iter().map(|y| square(y)).sum::<f64>()
            + square(&self.tail_y)
    }

    /// Solves U δ = y into `nodes` (steps + 1) and `biases`.
    pub fn back_substitute(&self, nodes: &mut [[f64; NODE]], biases: &mut [[f64; BIAS]]) {
        let steps = self.layout.steps();
        let last_bias = self.layout.biases() - 1;
        let tail = solve_rows::<TAIL, TAIL>(&self.tail_rows, &self.tail_y, [0.0; TAIL]);
        nodes[steps].copy_from_slice(&tail[..NODE]);
        biases[last_bias].copy_from_slice(&tail[NODE..]);
        for i in (0..steps).rev() {
            let bias = self.layout.bias_of_step[i] as usize;
            let mut x = [0.0; STEP];
            x[NODE..2 * NODE].copy_from_slice(&nodes[i + 1]);
            x[2 * NODE..].copy_from_slice(&biases[bias]);
            let x = solve_rows::<NODE, STEP>(&self.step_rows[i], &self.step_y[i], x);
            nodes[i].copy_from_slice(&x[..NODE]);
            if self.layout.changes_before(i) {
                let mut x = [0.0; CHANGE];
                x[BIAS..TAIL].copy_from_slice(&nodes[i]);
                x[TAIL..].copy_from_slice(&biases[bias]);
                let old = bias - 1;
                let x = solve_rows::<BIAS, CHANGE>(&self.change_rows[old], &self.change_y[old], x);
                biases[old].copy_from_slice(&x[..BIAS]);
            }
        }
    }
}

/// Completes `x`, whose last N − P entries are known, by U x = y.
pub(super) fn solve_rows<const P: usize, const N: usize>(
    rows: &[[f64; N]; P],
    y: &[f64; P],
    mut x: [f64; N],
) -> [f64; N] {
    for a in (0..P).rev() {
        let sum: f64 = (a + 1..N).map(|b| rows[a][b] * x[b]).sum();
        x[a] = (y[a] - sum) / rows[a][a];
    }
    x
}

#[cfg(test)]
mod tests;
