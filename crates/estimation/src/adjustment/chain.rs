//! Cholesky factorisation of normal equations that form a chain.
//!
//! Unknowns are nodes (9) and segments (6). Step i ties node i, node i + 1 and its segment, which
//! the steps beside it may share; a random walk ties each segment to the next. Eliminating in time
//! order keeps every front small and of fixed shape:
//!
//! | front | pivots | separator |
//! |---|---|---|
//! | step i | node i (9) | node i + 1 (9), segment (6) |
//! | change of segment before step i | old segment (6) | node i (9), new segment (6) |
//! | tail | last node and segment (15) | |
//!
//! H = Uᵀ U with one block of rows of U per front. Unknowns that touch many steps are eliminated
//! last; they are a dense border at the right end of each separator.

use super::border::{BorderCarry, BorderFactor};
use super::front::{Carry, ChangeFront, StepFront, TailFront, solve_rows};
use super::layout::{CHANGE, ChainLayout, NODE, SEGMENT, STEP, TAIL};
use super::prior::{BorderPrior, Prior};
use super::system::{BorderSystem, StepSystem};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Steps linearised at a time while the steps before them are eliminated; sized for the cache.
pub(super) const CHUNK: usize = 256;
/// Steps linearised by one task.
const TASK: usize = 64;

/// The normal equations of a chain, linearised on demand.
pub struct ChainSystem<'a, S, W> {
    /// Adds the normal equations of step i to a zeroed system and a zeroed border.
    pub step: &'a S,
    /// The random walk from segment k to segment k + 1, with the deviation new − old.
    pub walk: &'a W,
    /// Prior of node 0 and segment 0.
    pub prior: Prior<TAIL>,
    /// Added to the diagonal of every node and segment.
    pub damping: [f64; TAIL],
    pub border: BorderPrior,
    /// Added to the diagonal of the border.
    pub border_damping: Vec<f64>,
}

/// The factor U and y = U⁻ᵀ g, and Y = U⁻ᵀ E of the border.
#[derive(Debug, Clone)]
pub struct ChainFactor {
    pub layout: ChainLayout,
    steps: Vec<StepFront>,
    changes: Vec<ChangeFront>,
    tail: TailFront,
    /// Rows of Y: NODE × n per step, SEGMENT × n per change, TAIL × n.
    step_border: Vec<f64>,
    change_border: Vec<f64>,
    tail_border: Vec<f64>,
    border: BorderFactor,
}

/// A step of all unknowns.
#[derive(Debug, Clone)]
pub struct ChainStep {
    pub nodes: Vec<[f64; NODE]>,
    pub segments: Vec<[f64; SEGMENT]>,
    pub border: Vec<f64>,
}

impl ChainStep {
    /// All zero.
    pub fn new(layout: &ChainLayout, border: usize) -> Self {
        Self {
            nodes: vec![[0.0; NODE]; layout.nodes()],
            segments: vec![[0.0; SEGMENT]; layout.segments()],
            border: vec![0.0; border],
        }
    }
}

/// A pivot that is not positive: an unknown that data and priors leave free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NotPositive {
    /// An unknown of this node or of its segment.
    Node(usize),
    /// This column of the border, with the columns before it held.
    Border(usize),
}

/// The linearised steps of a chunk.
struct Chunk {
    systems: Vec<StepSystem>,
    borders: Vec<BorderSystem>,
}

impl Chunk {
    fn new(border: usize) -> Self {
        Self {
            systems: vec![StepSystem::ZERO; CHUNK],
            borders: vec![BorderSystem::new(border); CHUNK],
        }
    }
}

impl ChainFactor {
    /// Allocates the factor of a chain with a border of n columns.
    pub fn new(layout: ChainLayout, border: usize) -> Self {
        let (steps, changes) = (layout.steps(), layout.segments().saturating_sub(1));
        Self {
            layout,
            steps: vec![StepFront::ZERO; steps],
            changes: vec![ChangeFront::ZERO; changes],
            tail: TailFront::ZERO,
            step_border: vec![0.0; steps * NODE * border],
            change_border: vec![0.0; changes * SEGMENT * border],
            tail_border: vec![0.0; TAIL * border],
            border: BorderFactor::new(border),
        }
    }

    /// Columns of the border, n.
    pub fn border(&self) -> usize {
        self.border.y.len()
    }

    pub(super) fn border_factor(&self) -> &BorderFactor {
        &self.border
    }

    /// The front of step i and its rows of Y, NODE × n.
    pub fn step(&self, i: usize) -> (&StepFront, &[f64]) {
        let size = NODE * self.border();
        (&self.steps[i], &self.step_border[i * size..(i + 1) * size])
    }

    /// The front that eliminates segment `old` and its rows of Y, SEGMENT × n.
    pub fn change(&self, old: usize) -> (&ChangeFront, &[f64]) {
        let size = SEGMENT * self.border();
        let range = old * size..(old + 1) * size;
        (&self.changes[old], &self.change_border[range])
    }

    /// The front of the last node and segment and its rows of Y, TAIL × n.
    pub fn tail(&self) -> (&TailFront, &[f64]) {
        (&self.tail, &self.tail_border)
    }

    /// Factorises the normal equations. One chunk of steps is linearised while the one before is
    /// eliminated; the result does not depend on the number of threads.
    pub fn factorise<S, W>(&mut self, system: &ChainSystem<'_, S, W>) -> Result<(), NotPositive>
    where
        S: Fn(usize, &mut StepSystem, &mut BorderSystem) + Sync,
        W: Fn(usize) -> Prior<SEGMENT> + Sync,
    {
        let (steps, n) = (self.layout.steps(), self.border());
        assert!(
            [
                &system.border.weight,
                &system.border.miss,
                &system.border_damping
            ]
            .iter()
            .all(|values| values.len() == n),
            "one weight, miss and damping for each column of the border"
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
        let mut border_carry = BorderCarry::new(&system.border, &system.border_damping);
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
            self.border = border_carry.factorise().map_err(NotPositive::Border)?;
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
        W: Fn(usize) -> Prior<SEGMENT>,
    {
        let n = self.border();
        let first = chunk * CHUNK;
        let end = (first + CHUNK).min(self.layout.steps());
        let steps = linearised.systems.iter_mut().zip(&linearised.borders);
        for (i, (step, border)) in (first..end).zip(steps) {
            if self.layout.changes_before(i) {
                let old = self.layout.segment_of_step[i - 1] as usize;
                let front = &mut self.changes[old];
                if !carry.change_segment(&(system.walk)(old), &system.damping, front) {
                    return Err(NotPositive::Node(i));
                }
                if n > 0 {
                    let y_rows =
                        &mut self.change_border[old * SEGMENT * n..(old + 1) * SEGMENT * n];
                    border_carry.change(&front.rows, &front.y, y_rows);
                }
            }
            let front = &mut self.steps[i];
            if !carry.eliminate_step(step, &system.damping, front) {
                return Err(NotPositive::Node(i));
            }
            if n > 0 {
                let y_rows = &mut self.step_border[i * NODE * n..(i + 1) * NODE * n];
                border_carry.step(border, &front.rows, &front.y, y_rows);
            }
        }
        Ok(())
    }

    /// gᵀ H⁻¹ g: the squared length of the step in units of the posterior standard deviation. The step
    /// moves no linear functional of the unknowns by more than this length times the functional's sigma.
    pub fn decrement(&self) -> f64 {
        let square = |y: &[f64]| y.iter().map(|x| x * x).sum::<f64>();
        self.steps.iter().map(|f| square(&f.y)).sum::<f64>()
            + self.changes.iter().map(|f| square(&f.y)).sum::<f64>()
            + square(&self.tail.y)
            + square(&self.border.y)
    }

    /// Solves H δ = g.
    pub fn back_substitute(&self, step: &mut ChainStep) {
        let ChainStep {
            nodes,
            segments,
            border,
        } = step;
        let steps = self.layout.steps();
        let last = self.layout.segments() - 1;
        border.copy_from_slice(&self.border.y);
        self.border.back_substitute(border);
        let (front, rows) = self.tail();
        let y = less_border(&front.y, rows, border);
        let tail = solve_rows::<TAIL, TAIL>(&front.rows, &y, [0.0; TAIL]);
        nodes[steps].copy_from_slice(&tail[..NODE]);
        segments[last].copy_from_slice(&tail[NODE..]);
        for i in (0..steps).rev() {
            let segment = self.layout.segment_of_step[i] as usize;
            let mut x = [0.0; STEP];
            x[NODE..2 * NODE].copy_from_slice(&nodes[i + 1]);
            x[2 * NODE..].copy_from_slice(&segments[segment]);
            let (front, rows) = self.step(i);
            let y = less_border(&front.y, rows, border);
            let x = solve_rows::<NODE, STEP>(&front.rows, &y, x);
            nodes[i].copy_from_slice(&x[..NODE]);
            if self.layout.changes_before(i) {
                let mut x = [0.0; CHANGE];
                x[SEGMENT..TAIL].copy_from_slice(&nodes[i]);
                x[TAIL..].copy_from_slice(&segments[segment]);
                let (front, rows) = self.change(segment - 1);
                let y = less_border(&front.y, rows, border);
                let x = solve_rows::<SEGMENT, CHANGE>(&front.rows, &y, x);
                segments[segment - 1].copy_from_slice(&x[..SEGMENT]);
            }
        }
    }

    /// Step and standard deviation of each column of the border from `first` on, as if the other columns
    /// from `first` on did not exist.
    pub fn each_alone(&self, first: usize) -> Vec<(f64, f64)> {
        self.border.each_alone(first)
    }

    /// S⁻¹: the covariance of the border, n × n.
    pub fn border_covariance(&self) -> DMatrix<f64> {
        let n = self.border();
        DMatrix::from_vec(n, n, self.border.covariance())
    }

    /// Allocates one more step of this segment, which is that of the step before or the next one. The
    /// chain must have no border.
    pub fn push_step(&mut self, segment: u32) {
        self.layout.segment_of_step.push(segment);
        self.steps.push(StepFront::ZERO);
        if self.layout.changes_before(self.steps.len() - 1) {
            self.changes.push(ChangeFront::ZERO);
        }
    }

    /// The front of step i, to be written.
    pub fn step_mut(&mut self, i: usize) -> &mut StepFront {
        &mut self.steps[i]
    }

    /// The front that eliminates segment `old`, to be written.
    pub fn change_mut(&mut self, old: usize) -> &mut ChangeFront {
        &mut self.changes[old]
    }

    /// The front of the newest node and segment, to be written.
    pub fn tail_mut(&mut self) -> &mut TailFront {
        &mut self.tail
    }
}

/// y − Y δk of one front.
fn less_border<const P: usize>(y: &[f64; P], rows: &[f64], border: &[f64]) -> [f64; P] {
    let mut y = *y;
    if !border.is_empty() {
        for (y, row) in y.iter_mut().zip(rows.chunks_exact(border.len())) {
            for (factor, x) in row.iter().zip(border) {
                *y -= factor * x;
            }
        }
    }
    y
}
