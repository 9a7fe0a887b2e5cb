//! The normal equations: assembled, factorised, and the step that solves them.

use nalgebra::DVector;

use super::bend::BENDING;
use super::problem::JointProblem;
use super::row::Row;
use super::state::State;
use crate::adjustment::{BlockPattern, LeastSquares, SparseSystem};

/// After a step shorter than this, in standard deviations, derivatives are nearly the same, and the next one takes
/// the same factor: a chord method, which ends where a new factor would.
const NEAR_SIGMAS: f64 = 1.0;
/// Unless its square is not less than this share of that of the step before.
const CHORD_GAIN: f64 = 0.25;

impl JointProblem<'_> {
    /// Assembles the normal equations at a state.
    fn assemble(&mut self, state: &State) {
        let mut system = std::mem::replace(&mut self.system, BlockPattern::new(vec![1]).analyse(1));
        system.zero();
        let sizes = &self.layout.sizes;
        self.visit(state, |batch| {
            for row in batch.rows() {
                scatter(&row, sizes, &mut system);
            }
        });
        self.system = system;
    }

    /// Assembles and factorises at a state, with damping of each unknown or without.
    fn factorise_damped(&mut self, state: &State, damping: &[f64]) -> Option<()> {
        self.assemble(state);
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
        self.factorise_damped(state, &[])
    }

    /// The same but where there is a factor already, from before the last steps.
    pub fn factorise_near(&mut self, state: &State) -> Option<()> {
        match self.factored {
            Some(_) => Some(()),
            None => self.factorise(state),
        }
    }

    /// The step by the last factor and gradient, whose length is then the decrement.
    fn solved(&mut self) -> Option<Vec<f64>> {
        let mut step = self.system.gradient().to_vec();
        self.factor.as_ref()?.solve(&mut step, 1);
        let terms = step.iter().zip(self.system.gradient());
        let all: f64 = terms.map(|(x, g)| x * g).sum();
        let shared = self.metric.as_ref().map_or(0.0, |metric| {
            let first = step.len() - metric.nrows();
            let step = DVector::from_column_slice(&step[first..]);
            step.dot(&(metric * &step))
        });
        self.decrement = shared.max(all / step.len() as f64);
        Some(step)
    }

    /// To be called where rows are weighted anew, which the factor knows nothing of, or where the last step was
    /// long.
    pub fn forget_factor(&mut self) {
        self.factored = None;
    }
}

/// Adds a row to the normal equations.
fn scatter(row: &Row<'_>, sizes: &[usize], system: &mut SparseSystem) {
    if row.weight == 0.0 {
        return;
    }
    let mut values = [0.0; BENDING * BENDING];
    let mut start = 0;
    for (i, &a) in row.blocks.iter().enumerate() {
        let a = a as usize;
        let by_a = &row.by[start..start + sizes[a]];
        let first = system.offset(a);
        for (g, j) in system.gradient_mut()[first..].iter_mut().zip(by_a) {
            *g -= row.weight * j * row.residual;
        }
        let mut other = 0;
        for &b in &row.blocks[..=i] {
            let b = b as usize;
            let by_b = &row.by[other..other + sizes[b]];
            other += sizes[b];
            let values = &mut values[..by_a.len() * by_b.len()];
            for (line, x) in values.chunks_exact_mut(by_b.len()).zip(by_a) {
                let x = row.weight * x;
                line.iter_mut().zip(by_b).for_each(|(v, y)| *v = x * y);
            }
            system.add(system.slot(a, b), values);
        }
        start += by_a.len();
    }
}

impl LeastSquares for JointProblem<'_> {
    type State = State;

    fn cost(&self, state: &State) -> f64 {
        let mut sum = 0.0;
        self.visit(state, |batch| sum += batch.cost());
        sum
    }

    fn step(&mut self, state: &State, damping: f64) -> Option<State> {
        let diagonal: Vec<f64> = match damping > 0.0 {
            true => self
                .damping_sigma
                .iter()
                .map(|s| damping / (s * s))
                .collect(),
            false => Vec::new(),
        };
        let before = self.decrement;
        let is_near = self.factored.is_some() && before < NEAR_SIGMAS.powi(2);
        let is_old = diagonal.is_empty() && is_near;
        match is_old {
            true => self.assemble(state),
            false => self.factorise_damped(state, &diagonal)?,
        }
        let mut step = self.solved()?;
        if is_old && self.decrement > CHORD_GAIN * before {
            self.factorise(state)?;
            step = self.solved()?;
        }
        Some(self.retracted(state, &step))
    }

    /// The larger of the squared step of all that couples with everything, in its standard
    /// deviations of the round before, and of the mean square over all unknowns.
    fn decrement(&self) -> f64 {
        self.decrement
    }
}
