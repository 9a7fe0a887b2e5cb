//! Levenberg-Marquardt: every step is accepted or refused on the true cost.

use serde::{Deserialize, Serialize};

use super::damping::{Damping, DampingRule, Verdict};
use crate::error::Result;
use crate::progress::Progress;
use std::fmt;

/// Length of a step below which the adjustment has converged, posterior standard deviations: the step
/// moves no functional of the unknowns by more than 5 % of its own sigma. The step is still taken, and
/// because convergence is quadratic, the remaining error is far smaller.
pub const CONVERGED_SIGMAS: f64 = 0.05;

/// Accepted steps in a row that do not lower the cost, after which no more are tried. Where derivatives are not exact, steps
/// go to and fro about the least cost.
const LEVEL_STEPS: usize = 8;

/// Why the adjustment stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// The last step was below 5 % of a posterior standard deviation.
    Converged,
    /// Steps no longer lower the cost, though they are longer: the least cost is between them.
    CostFloor,
    /// The iteration limit was reached.
    IterationLimit,
    /// No step, however small, lowers the cost.
    NoBetterStep,
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::CostFloor => "converged at the least cost",
            Self::IterationLimit => "stopped at the iteration limit",
            Self::NoBetterStep => "stopped because no step lowers the cost",
        })
    }
}

impl StopReason {
    /// Whether more steps would not have changed the result.
    pub fn is_converged(self) -> bool {
        matches!(self, Self::Converged | Self::CostFloor)
    }
}

/// The outcome of an adjustment.
#[derive(Debug, Clone, Copy)]
pub struct Ended {
    pub stop: StopReason,
    /// Steps tried, refused ones included.
    pub iterations: usize,
    pub cost_initial: f64,
    pub cost: f64,
}

/// A least-squares problem with the solver of its normal equations.
pub trait LeastSquares {
    /// Values of all unknowns.
    type State;

    /// Half the sum of all squared normalised residuals.
    fn cost(&self, state: &Self::State) -> f64;

    /// The state after the damped step from `state`; `None` if the normal equations are not
    /// positive definite.
    fn step(&mut self, state: &Self::State, damping: f64) -> Option<Self::State>;

    /// The squared length of the last step in posterior standard deviations.
    fn decrement(&self) -> f64;
}

/// Moves `state` to the least cost, in at most `most_iterations`, until a step is shorter than
/// `converged_sigmas` posterior standard deviations. If it converged, the last step was undamped.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn levenberg_marquardt<P: LeastSquares>(
    problem: &mut P,
    state: &mut P::State,
    rule: DampingRule,
    most_iterations: usize,
    converged_sigmas: f64,
    progress: &dyn Progress,
) -> Result<Ended> {
    let cost_initial = problem.cost(state);
    let (mut cost, mut iterations) = (cost_initial, 0);
    let (mut lowest, mut level) = (cost_initial, 0);
    let mut damping = Damping::new(rule);
    let stop = loop {
        if iterations == most_iterations {
            break StopReason::IterationLimit;
        }
        iterations += 1;
        progress.advance(1);
        progress.check()?;
        let undamped = damping.value() == 0.0;
        let trial = problem.step(state, damping.value());
        let trial_cost = trial.as_ref().map_or(f64::NAN, |trial| problem.cost(trial));
        match (damping.judge(cost, trial_cost), trial) {
            (Verdict::Accepted, Some(trial)) => {
                (*state, cost) = (trial, trial_cost);
                if undamped && problem.decrement() < converged_sigmas.powi(2) {
                    break StopReason::Converged;
                }
                level = if rule.is_lower(lowest, cost) {
                    lowest = cost;
                    0
                } else {
                    level + 1
                };
                if level == LEVEL_STEPS {
                    break StopReason::CostFloor;
                }
            }
            (Verdict::GivenUp, _) => break StopReason::NoBetterStep,
            _ => {}
        }
    };
    Ok(Ended {
        stop,
        iterations,
        cost_initial,
        cost,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    /// x²/2 + 1, with steps that are longer than those to the least cost by this factor.
    struct Parabola {
        stretch: f64,
        step: f64,
    }

    impl LeastSquares for Parabola {
        type State = f64;

        fn cost(&self, state: &f64) -> f64 {
            0.5 * state * state + 1.0
        }

        fn step(&mut self, state: &f64, damping: f64) -> Option<f64> {
            self.step = -self.stretch * state / (1.0 + damping);
            Some(state + self.step)
        }

        fn decrement(&self) -> f64 {
            self.step * self.step
        }
    }

    fn ended(stretch: f64) -> Ended {
        let (mut problem, mut x) = (Parabola { stretch, step: 0.0 }, 0.1);
        let rule = DampingRule::UNDAMPED;
        levenberg_marquardt(&mut problem, &mut x, rule, 100, CONVERGED_SIGMAS, &Silent).unwrap()
    }

    #[test]
    fn steps_to_and_fro_about_the_least_cost_end() {
        let right = ended(1.0);
        assert_eq!((right.stop, right.iterations), (StopReason::Converged, 2));
        let to_and_fro = ended(2.0);
        let expected = (StopReason::CostFloor, LEVEL_STEPS);
        assert_eq!((to_and_fro.stop, to_and_fro.iterations), expected);
    }
}
