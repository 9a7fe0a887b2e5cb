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
//! H = Uᵀ U with one block of rows of U per front. Constants that touch many steps (a lever arm, a
//! latency) are eliminated last; they are a dense border at the right end of each separator.

mod border;
mod front;
mod functional;
mod growing;

pub(super) use border::{Border, ConstantsSystem};
pub(super) use front::{Carry, ChangeFront, StepFront, TailFront, solve_rows};
pub(super) use functional::ChainGradient;

use border::{BorderCarry, ConstantsFactor};
use nalgebra::DMatrix;
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

    /// Whether the bias changes before step `i`; the old one is `bias_of_step[i] − 1`.
    pub fn changes_before(&self, i: usize) -> bool {
        i > 0 && self.bias_of_step[i] != self.bias_of_step[i - 1]
    }
}

/// The normal equations H δ = g of one step, order node i, node i + 1, bias; only the upper
/// triangle of H counts. Rows are whole lines of the cache.
#[derive(Debug, Clone)]
#[repr(align(64))]
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
    /// Adds step i to a zeroed system and a zeroed border.
    pub step: &'a S,
    /// The walk from bias k to bias k + 1.
    pub walk: &'a W,
    pub prior: PriorSystem,
    /// Added to the diagonal of every node and bias.
    pub damping: [f64; TAIL],
    pub constants: ConstantsSystem,
}

/// The factor U and y = U⁻ᵀ g, and Y = U⁻ᵀ E of the constants.
#[derive(Debug, Clone)]
pub(super) struct ChainFactor {
    pub layout: ChainLayout,
    steps: Vec<StepFront>,
    changes: Vec<ChangeFront>,
    tail: TailFront,
    /// Rows of Y: NODE × n per step, BIAS × n per change, TAIL × n.
    step_border: Vec<f64>,
    change_border: Vec<f64>,
    tail_border: Vec<f64>,
    constants: ConstantsFactor,
}

/// A pivot that is not positive: what the data (and priors) leave free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum NotPositive {
    /// Something at this node, or of the bias in force there.
    Node(usize),
    /// This constant, with those before it held.
    Constant(usize),
}

/// The linearised steps of a chunk.
struct Chunk {
    systems: Vec<StepSystem>,
    borders: Vec<Border>,
}

impl Chunk {
    fn new(constants: usize) -> Self {
        Self {
            systems: vec![StepSystem::ZERO; CHUNK],
            borders: vec![Border::new(constants); CHUNK],
        }
    }
}

impl ChainFactor {
    /// Room for the factor of a chain with at least one step, bordered by n constants.
    pub fn new(layout: ChainLayout, constants: usize) -> Self {
        let (steps, changes) = (layout.steps(), layout.biases() - 1);
        Self {
            layout,
            steps: vec![StepFront::ZERO; steps],
            changes: vec![ChangeFront::ZERO; changes],
            tail: TailFront::ZERO,
            step_border: vec![0.0; steps * NODE * constants],
            change_border: vec![0.0; changes * BIAS * constants],
            tail_border: vec![0.0; TAIL * constants],
            constants: ConstantsFactor::new(constants),
        }
    }

    /// Number of constants n.
    pub fn constants(&self) -> usize {
        self.constants.y.len()
    }

    /// The front of step i and its rows of Y, NODE × n.
    pub fn step(&self, i: usize) -> (&StepFront, &[f64]) {
        let size = NODE * self.constants();
        (&self.steps[i], &self.step_border[i * size..(i + 1) * size])
    }

    /// The front that eliminates bias `old` and its rows of Y, BIAS × n.
    pub fn change(&self, old: usize) -> (&ChangeFront, &[f64]) {
        let size = BIAS * self.constants();
        let range = old * size..(old + 1) * size;
        (&self.changes[old], &self.change_border[range])
    }

    /// The front of the last node and bias and its rows of Y, TAIL × n.
    pub fn tail(&self) -> (&TailFront, &[f64]) {
        (&self.tail, &self.tail_border)
    }

    /// Factorises the normal equations. One chunk of steps is linearised while the one before is
    /// eliminated; the result does not depend on the number of threads.
    pub fn factorise<S, W>(&mut self, system: &ChainSystem<'_, S, W>) -> Result<(), NotPositive>
    where
        S: Fn(usize, &mut StepSystem, &mut Border) + Sync,
        W: Fn(usize) -> WalkSystem + Sync,
    {
        let (steps, n) = (self.layout.steps(), self.constants());
        assert!(
            [
                &system.constants.weight,
                &system.constants.g,
                &system.constants.damping
            ]
            .iter()
            .all(|values| values.len() == n),
            "one weight, right-hand side and damping per constant"
        );
        let chunks = steps.div_ceil(CHUNK);
        let linearise = |chunk: usize, buffer: &mut Chunk| {
            let first = chunk * CHUNK;
            let count = CHUNK.min(steps.saturating_sub(first));
            buffer.systems[..count]
                .par_chunks_mut(TASK)
                .zip(buffer.borders[..count].par_chunks_mut(TASK))
                .enumerate()
                .for_each(|(task, (systems, borders))| {
                    for (offset, (target, border)) in systems.iter_mut().zip(borders).enumerate() {
                        *target = StepSystem::ZERO;
                        border.clear();
                        (system.step)(first + task * TASK + offset, target, border);
                    }
                });
        };
        let mut current = Chunk::new(n);
        let mut following = Chunk::new(n);
        let mut carry = Carry::new(&system.prior);
        let mut border_carry = BorderCarry::new(&system.constants);
        linearise(0, &mut current);
        for chunk in 0..chunks {
            let (done, ()) = rayon::join(
                || self.eliminate_chunk(chunk, &mut current, &mut carry, &mut border_carry, system),
                || linearise(chunk + 1, &mut following),
            );
            done?;
            std::mem::swap(&mut current, &mut following);
        }
        if !carry.eliminate_tail(&system.damping, &mut self.tail) {
            return Err(NotPositive::Node(steps));
        }
        if n > 0 {
            border_carry.tail(&self.tail.rows, &self.tail.y, &mut self.tail_border);
            self.constants = border_carry.factorise().map_err(NotPositive::Constant)?;
        }
        Ok(())
    }

    fn eliminate_chunk<S, W>(
        &mut self,
        chunk: usize,
        linearised: &mut Chunk,
        carry: &mut Carry,
        border_carry: &mut BorderCarry,
        system: &ChainSystem<'_, S, W>,
    ) -> Result<(), NotPositive>
    where
        W: Fn(usize) -> WalkSystem,
    {
        let n = self.constants();
        let first = chunk * CHUNK;
        let end = (first + CHUNK).min(self.layout.steps());
        let steps = linearised.systems.iter_mut().zip(&linearised.borders);
        for (i, (step, border)) in (first..end).zip(steps) {
            if self.layout.changes_before(i) {
                let old = self.layout.bias_of_step[i - 1] as usize;
                let front = &mut self.changes[old];
                if !carry.change_bias(&(system.walk)(old), &system.damping, front) {
                    return Err(NotPositive::Node(i));
                }
                if n > 0 {
                    let kept = &mut self.change_border[old * BIAS * n..(old + 1) * BIAS * n];
                    border_carry.change(&front.rows, &front.y, kept);
                }
            }
            let front = &mut self.steps[i];
            if !carry.eliminate_step(step, &system.damping, front) {
                return Err(NotPositive::Node(i));
            }
            if n > 0 {
                let kept = &mut self.step_border[i * NODE * n..(i + 1) * NODE * n];
                border_carry.step(border, &front.rows, &front.y, kept);
            }
        }
        Ok(())
    }

    /// gᵀ H⁻¹ g: the squared length of the step in units of the posterior standard deviation.
    /// No linear functional of the unknowns moves by more than its root times its own sigma.
    pub fn decrement(&self) -> f64 {
        let square = |y: &[f64]| y.iter().map(|x| x * x).sum::<f64>();
        self.steps.iter().map(|f| square(&f.y)).sum::<f64>()
            + self.changes.iter().map(|f| square(&f.y)).sum::<f64>()
            + square(&self.tail.y)
            + square(&self.constants.y)
    }

    /// Solves H δ = g into `nodes` (steps + 1), `biases` and `constants`.
    pub fn back_substitute(
        &self,
        nodes: &mut [[f64; NODE]],
        biases: &mut [[f64; BIAS]],
        constants: &mut [f64],
    ) {
        let steps = self.layout.steps();
        let last_bias = self.layout.biases() - 1;
        constants.copy_from_slice(&self.constants.y);
        self.constants.back_substitute(constants);
        let (front, border) = self.tail();
        let y = less_constants(&front.y, border, constants);
        let tail = solve_rows::<TAIL, TAIL>(&front.rows, &y, [0.0; TAIL]);
        nodes[steps].copy_from_slice(&tail[..NODE]);
        biases[last_bias].copy_from_slice(&tail[NODE..]);
        for i in (0..steps).rev() {
            let bias = self.layout.bias_of_step[i] as usize;
            let mut x = [0.0; STEP];
            x[NODE..2 * NODE].copy_from_slice(&nodes[i + 1]);
            x[2 * NODE..].copy_from_slice(&biases[bias]);
            let (front, border) = self.step(i);
            let y = less_constants(&front.y, border, constants);
            let x = solve_rows::<NODE, STEP>(&front.rows, &y, x);
            nodes[i].copy_from_slice(&x[..NODE]);
            if self.layout.changes_before(i) {
                let mut x = [0.0; CHANGE];
                x[BIAS..TAIL].copy_from_slice(&nodes[i]);
                x[TAIL..].copy_from_slice(&biases[bias]);
                let (front, border) = self.change(bias - 1);
                let y = less_constants(&front.y, border, constants);
                let x = solve_rows::<BIAS, CHANGE>(&front.rows, &y, x);
                biases[bias - 1].copy_from_slice(&x[..BIAS]);
            }
        }
    }

    /// For each constant from `first` on its step and standard deviation if none of the others from
    /// `first` on were there.
    pub fn each_alone(&self, first: usize) -> Vec<(f64, f64)> {
        self.constants.each_alone(first)
    }

    /// S⁻¹: the covariance of the constants, n × n.
    pub fn constants_covariance(&self) -> DMatrix<f64> {
        let n = self.constants();
        DMatrix::from_vec(n, n, self.constants.covariance())
    }
}

/// y − Y δk of one front.
fn less_constants<const P: usize>(y: &[f64; P], border: &[f64], constants: &[f64]) -> [f64; P] {
    let mut y = *y;
    if !constants.is_empty() {
        for (y, row) in y.iter_mut().zip(border.chunks_exact(constants.len())) {
            for (factor, constant) in row.iter().zip(constants) {
                *y -= factor * constant;
            }
        }
    }
    y
}

#[cfg(test)]
mod tests;
