//! The normal equations: assembled, factorised, and the step that solves them.

use super::bend::BENDING;
use super::problem::JointProblem;
use super::row::Row;
use super::state::State;
use crate::adjustment::{BlockPattern, LeastSquares, SparseSystem};

/// After a step shorter than this, standard deviations, derivatives hardly change, and the next step uses the same
/// factor: a chord method, which converges to the same solution as with new factors.
const NEAR_SIGMAS: f64 = 1.0;
/// A step with an old factor is computed again with a new one, unless its square is less than this share of that of
/// the step before.
const CHORD_GAIN: f64 = 0.25;

impl JointProblem<'_> {
    /// Assembles the normal equations at a state.
    fn assemble(&mut self, state: &State) {
        let mut system = std::mem::replace(&mut self.system, BlockPattern::new(vec![1]).analyse(1));
        system.zero();
        let sizes = &self.layout.sizes;
        let mut sums = Vec::new();
        self.visit(state, |batch| {
            let rows: Vec<Row<'_>> = batch.rows().collect();
            for rows in rows.chunk_by(are_alike) {
                scatter(rows, sizes, &mut sums, &mut system);
            }
        });
        self.system = system;
    }

    /// Factorises the system assembled at a state, with damping of each unknown or without.
    fn factorise_assembled(&mut self, state: &State, damping: &[f64]) -> Option<()> {
        self.factored = None;
        let factor = match self.factor.take() {
            Some(mut factor) => {
                let written = self.system.factorise_into(damping, &mut factor);
                written.map(|()| factor)
            }
            None => self.system.factorise(damping),
        };
        self.factor = Some(factor.ok()?);
        self.factored = damping.is_empty().then(|| state.clone());
        Some(())
    }

    /// Assembles and factorises at a state, without damping.
    pub fn factorise(&mut self, state: &State) -> Option<()> {
        self.assemble(state);
        self.factorise_assembled(state, &[])
    }

    /// As [`Self::factorise`], unless there is a factor already, from before the last steps.
    pub fn factorise_near(&mut self, state: &State) -> Option<()> {
        match self.factored {
            Some(_) => Some(()),
            None => self.factorise(state),
        }
    }

    /// Solves for the step with the last factor and gradient; sets its squared length and the slope of the cost along it.
    fn solve(&mut self) -> Option<()> {
        let mut step = self.system.gradient().to_vec();
        let factor = self.factor.as_ref()?;
        factor.solve(&mut step, 1);
        let terms = step.iter().zip(self.system.gradient());
        let all: f64 = terms.map(|(x, g)| x * g).sum();
        let first = self.offset(self.layout.last());
        let shared = factor.last_squared_length(&step[first..]);
        self.decrement = shared.max(all / step.len() as f64);
        // The right-hand side is the negative gradient.
        self.slope = -all;
        self.step = step;
        Some(())
    }

    /// Marks the factor as outdated: after a change of the weights of rows, or after a long last step.
    pub fn forget_factor(&mut self) {
        self.factored = None;
    }
}

/// Whether rows touch the same blocks except for the first. The rows of a scanner in a step do: only their surfels
/// differ.
fn are_alike(a: &Row<'_>, b: &Row<'_>) -> bool {
    a.by.len() == b.by.len() && a.blocks.get(1..) == b.blocks.get(1..)
}

/// Adds rows that are alike to the normal equations; the products of their common blocks are summed first and added
/// once.
fn scatter(rows: &[Row<'_>], sizes: &[usize], sums: &mut Vec<f64>, system: &mut SparseSystem) {
    let Some((&first, shared)) = rows[0].blocks.split_first() else {
        return;
    };
    let size = |block: u32| sizes[block as usize];
    let width = rows[0].by.len() - size(first);
    sums.clear();
    sums.resize(width * width, 0.0);
    let mut values = Vec::with_capacity(BENDING * BENDING);
    for row in rows.iter().filter(|row| row.weight != 0.0) {
        let (by_own, by_shared) = row.by.split_at(size(first));
        let lines = sums.chunks_exact_mut(width.max(1));
        for (i, (line, x)) in lines.zip(by_shared).enumerate() {
            let x = row.weight * x;
            let line = line[..=i].iter_mut().zip(by_shared);
            line.for_each(|(sum, y)| *sum += x * y);
        }
        let mut start = 0;
        for &block in row.blocks {
            let by = &row.by[start..start + size(block)];
            start += by.len();
            let place = system.offset(block as usize);
            for (g, j) in system.gradient_mut()[place..].iter_mut().zip(by) {
                *g -= row.weight * j * row.residual;
            }
            values.clear();
            let products = by_own.iter().flat_map(|x| by.iter().map(move |y| (x, y)));
            values.extend(products.map(|(x, y)| row.weight * x * y));
            system.add(system.slot(row.blocks[0] as usize, block as usize), &values);
        }
    }
    let mut top = 0;
    for (i, &a) in shared.iter().enumerate() {
        let mut left = 0;
        for &b in &shared[..=i] {
            values.clear();
            for row in top..top + size(a) {
                let line = (left..left + size(b)).map(|column| {
                    if column <= row {
                        sums[row * width + column]
                    } else {
                        sums[column * width + row]
                    }
                });
                values.extend(line);
            }
            system.add(system.slot(a as usize, b as usize), &values);
            left += size(b);
        }
        top += size(a);
    }
}

impl LeastSquares for JointProblem<'_> {
    type State = State;

    fn cost(&self, state: &State) -> f64 {
        let mut sum = 0.0;
        self.visit_residuals(state, |batch| sum += batch.cost());
        sum
    }

    fn step(&mut self, state: &State, damping: f64) -> Option<State> {
        let diagonal: Vec<f64> = if damping > 0.0 {
            self.damping_sigma
                .iter()
                .map(|s| damping / (s * s))
                .collect()
        } else {
            Vec::new()
        };
        let before = self.decrement;
        let is_near = self.factored.is_some() && before < NEAR_SIGMAS.powi(2);
        let is_old = diagonal.is_empty() && is_near;
        self.assemble(state);
        if !is_old {
            self.factorise_assembled(state, &diagonal)?;
        }
        self.solve()?;
        if is_old && self.decrement > CHORD_GAIN * before {
            self.factorise_assembled(state, &[])?;
            self.solve()?;
        }
        Some(self.retracted(state, &self.step))
    }

    /// The larger of two squared lengths: that of the step of the blocks that couple with everything, in their standard
    /// deviations, and the mean square over all unknowns.
    fn decrement(&self) -> f64 {
        self.decrement
    }

    fn slope(&self) -> Option<f64> {
        Some(self.slope)
    }

    fn part_of_step(&self, state: &State, share: f64) -> Option<State> {
        let step: Vec<f64> = self.step.iter().map(|x| share * x).collect();
        Some(self.retracted(state, &step))
    }
}
