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

    /// Derivative of the cost along the last step, where the step begins: by the share of it that is taken. `None` if
    /// steps are taken whole.
    fn slope(&self) -> Option<f64> {
        None
    }

    /// The state after a share of the last step, taken from `state`.
    fn part_of_step(&self, _state: &Self::State, _share: f64) -> Option<Self::State> {
        None
    }
}

/// The least cost along a step is looked for if the parabola through the costs has it outside of these shares of the step.
/// It is at the end of the step if the cost is as curved as the normal equations say: rows with derivatives that change
/// along the step make it more curved, rows under a robust loss less.
const USUAL_SHARES: [f64; 2] = [0.75, 1.5];
/// Shares of a step to which the parabola is trusted.
const TRUSTED_SHARES: [f64; 2] = [0.1, 8.0];

/// Share of a step at which the cost is least, by the parabola through both costs with the slope at the beginning; `None`
/// if that is about at its end.
fn least_at(cost: f64, trial_cost: f64, slope: f64) -> Option<f64> {
    let bend = trial_cost - cost - slope;
    let [shortest, longest] = TRUSTED_SHARES;
    let share = if bend > 0.0 {
        (-slope / (2.0 * bend)).clamp(shortest, longest)
    } else {
        longest
    };
    let [from, to] = USUAL_SHARES;
    (slope < 0.0 && bend.is_finite() && (share < from || share > to)).then_some(share)
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
        let mut trial = problem.step(state, damping.value());
        let mut trial_cost = trial.as_ref().map_or(f64::NAN, |trial| problem.cost(trial));
        let mut decrement = problem.decrement();
        let slope = problem.slope();
        if let Some(share) = slope.and_then(|slope| least_at(cost, trial_cost, slope))
            && let Some(part) = problem.part_of_step(state, share)
        {
            let part_cost = problem.cost(&part);
            if part_cost < trial_cost {
                (trial, trial_cost) = (Some(part), part_cost);
                decrement *= share * share;
            }
        }
        match (damping.judge(cost, trial_cost), trial) {
            (Verdict::Accepted, Some(trial)) => {
                (*state, cost) = (trial, trial_cost);
                if undamped && decrement < converged_sigmas.powi(2) {
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

    #[test]
    fn the_least_cost_along_a_step_is_found() {
        // c(x) = (x − 0.5)² + 1 along steps to 1 and to 0.1.
        assert_eq!(least_at(1.25, 1.25, -1.0), Some(0.5));
        let short = least_at(1.25, 1.16, -0.1).unwrap();
        assert!((short - 5.0).abs() < 1e-9, "{short}");
        // Far too long, and a cost that falls ever faster.
        assert_eq!(least_at(1.25, 100.0, -1.0), Some(0.1));
        assert_eq!(least_at(1.25, 0.1, -1.0), Some(8.0));
        // As long as it should be, upwards, and not computed.
        assert_eq!(least_at(1.5, 1.0, -1.0), None);
        assert_eq!(least_at(1.25, 1.25, 1.0), None);
        assert_eq!(least_at(1.25, f64::NAN, -1.0), None);
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
