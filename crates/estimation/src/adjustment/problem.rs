//! A least-squares problem on a chain, and its solution.

use super::chain::{ChainFactor, ChainStep, ChainSystem, NotPositive};
use super::damping::DampingRule;
use super::layout::{ChainLayout, SEGMENT, TAIL};
use super::levenberg_marquardt::{CONVERGED_SIGMAS, Ended, LeastSquares, levenberg_marquardt};
use super::prior::{BorderPrior, Prior};
use super::rows::Rows;
use super::system::{BorderSystem, StepSystem, assemble};
use crate::progress::Progress;
use rayon::prelude::*;

/// Steps per task when costs are summed; fixed, so that sums do not depend on the number of threads.
const TASK: usize = 512;

/// Damping is in units of the uncertainty of the start values; after a refused step it starts at a
/// hundredth, and Gauss-Newton steps have none.
const DAMPING: DampingRule = DampingRule::UNDAMPED;

/// Factors on a chain with a border, as whitened rows.
///
/// [`ChainProblem::rows`] shows all rows of a step to any visitor: to the normal equations of the
/// chain here, or to those of another solver that knows more factors and unknowns.
pub trait ChainProblem: Sync {
    /// Values of all unknowns.
    type State: Sync;
    /// Where rows come from.
    type Source<'a>
    where
        Self: 'a;

    /// The segments of the steps.
    fn layout(&self) -> &ChainLayout;

    /// Visits the whitened rows of every factor of a step.
    fn rows<'a>(
        &'a self,
        state: &Self::State,
        step: usize,
        visit: impl FnMut(Self::Source<'a>, Rows<'_>),
    );

    /// Visits the weight and the whitened residuals of every factor of a step, as
    /// [`ChainProblem::rows`] does, without derivatives.
    fn residuals<'a>(
        &'a self,
        state: &Self::State,
        step: usize,
        visit: impl FnMut(Self::Source<'a>, f64, &[f64]),
    );

    /// The prior of node 0 and segment 0.
    fn prior(&self, state: &Self::State) -> Prior<TAIL>;

    /// The random walk from segment `old` to the next, with the deviation new − old.
    fn walk(&self, state: &Self::State, old: usize) -> Prior<SEGMENT>;

    /// The prior of the border.
    fn border_prior(&self, state: &Self::State) -> BorderPrior;

    /// Uncertainty of the start values of a node and of a segment. For the border it is the sigma of its
    /// prior.
    fn damping_sigma(&self) -> [f64; TAIL];

    /// `state` after a step.
    fn retracted(&self, state: &Self::State, step: &ChainStep) -> Self::State;

    /// Half the sum of all squared normalised residuals.
    fn cost(&self, state: &Self::State) -> f64 {
        let layout = self.layout();
        let step_cost = |step: usize| {
            let mut sum = 0.0;
            self.residuals(state, step, |_, weight, residual| {
                sum += weight * residual.iter().map(|x| x * x).sum::<f64>();
            });
            0.5 * sum
        };
        let steps = layout.steps();
        let tasks: Vec<f64> = (0..steps.div_ceil(TASK))
            .into_par_iter()
            .map(|task| {
                let end = ((task + 1) * TASK).min(steps);
                (task * TASK..end).map(step_cost).sum()
            })
            .collect();
        let walks = (1..layout.segments()).map(|new| self.walk(state, new - 1).cost());
        tasks.iter().sum::<f64>()
            + walks.sum::<f64>()
            + self.prior(state).cost()
            + self.border_prior(state).cost()
    }

    /// Adds the normal equations of one step.
    fn linearise(
        &self,
        state: &Self::State,
        step: usize,
        system: &mut StepSystem,
        border: &mut BorderSystem,
    ) {
        self.rows(state, step, |_, rows| assemble(&rows, system, border));
    }

    /// Factorises the normal equations at `state`.
    fn factorise(
        &self,
        state: &Self::State,
        damping: f64,
        factor: &mut ChainFactor,
    ) -> Result<(), NotPositive> {
        let border = self.border_prior(state);
        factor.factorise(&ChainSystem {
            step: &|step, system: &mut StepSystem, border: &mut BorderSystem| {
                self.linearise(state, step, system, border);
            },
            walk: &|old| self.walk(state, old),
            prior: self.prior(state),
            damping: self.damping_sigma().map(|s| damping / (s * s)),
            border_damping: border.weight.iter().map(|w| damping * w).collect(),
            border,
        })
    }

    /// The undamped factor at `state`.
    fn factor(&self, state: &Self::State) -> Result<ChainFactor, NotPositive> {
        let columns = self.border_prior(state).weight.len();
        let mut factor = ChainFactor::new(self.layout().clone(), columns);
        self.factorise(state, 0.0, &mut factor)?;
        Ok(factor)
    }

    /// Levenberg-Marquardt from `state` in place. If it converges, `factor` is the undamped factor within
    /// 5 % of a standard deviation of the solution; otherwise `factor` is of no use.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::error::Error::Cancelled).
    fn solve(
        &self,
        state: &mut Self::State,
        factor: &mut ChainFactor,
        most_iterations: usize,
        progress: &dyn Progress,
    ) -> crate::error::Result<Ended>
    where
        Self: Sized,
    {
        let step = ChainStep::new(self.layout(), factor.border());
        let mut problem = Factorised {
            problem: self,
            factor,
            step,
        };
        levenberg_marquardt(
            &mut problem,
            state,
            DAMPING,
            most_iterations,
            CONVERGED_SIGMAS,
            progress,
        )
    }
}

/// A problem with its factor.
struct Factorised<'a, P> {
    problem: &'a P,
    factor: &'a mut ChainFactor,
    step: ChainStep,
}

impl<P: ChainProblem> LeastSquares for Factorised<'_, P> {
    type State = P::State;

    fn cost(&self, state: &P::State) -> f64 {
        self.problem.cost(state)
    }

    fn step(&mut self, state: &P::State, damping: f64) -> Option<P::State> {
        let factorised = self.problem.factorise(state, damping, self.factor);
        factorised.ok()?;
        self.factor.back_substitute(&mut self.step);
        Some(self.problem.retracted(state, &self.step))
    }

    fn decrement(&self) -> f64 {
        self.factor.decrement()
    }
}
