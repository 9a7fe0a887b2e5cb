//! The rounds of an adjustment: how points are sorted in each, and the steps until values and noise have settled.

use super::bend::{Bends, Rung};
use super::components::{Component, components, rescale};
use super::conclude::not_determined;
use super::learn::learn;
use super::pose_errors::learn_pose_errors;
use super::problem::JointProblem;
use super::state::State;
use crate::adjustment::{CONVERGED_SIGMAS, DampingRule, StopReason, levenberg_marquardt};
use crate::error::Result;
use crate::progress::Progress;

/// The scales of noise have settled if they change by less than this share.
const SETTLED_SCALE: f64 = 0.1;
/// The parameters of the motion in time have settled if they change by less than this; see [`learn`].
pub const SETTLED_MOTION: f64 = 0.3;
/// Size of the surfels with dense knots, as a share of the usual size: a random motion along the ground shows only at
/// slopes, and small surfels have steeper slopes.
const DENSE_SHARE: f64 = 0.72;
/// Most times that the noise is estimated in the last round.
const MAX_SCALINGS: usize = 3;
/// The same where the errors of poses are estimated too, from standard deviations that may be ten times too large or small.
const MAX_SCALINGS_OF_POSES: usize = 15;
/// The errors of poses have settled if no σ changes by more than this, as a logarithm.
const SETTLED_POSES: f64 = 0.1;
/// Share of all steps that is kept for the end, and that may be taken before points are sorted or the noise is estimated
/// again, which makes more of the steps that follow.
const STEPS_SHARE: f64 = 0.2;
/// Length of the last step, standard deviations, before the noise is estimated again.
pub const SCALING_SIGMAS: f64 = 0.5;
/// The same with knots, whose standard deviations are then estimated again too: this moves mountings much and
/// residuals little.
const LEARNING_SIGMAS: f64 = 2.0;
/// Length of the last step at the end, standard deviations. Because steps become shorter by a factor of two or more,
/// no unknown is then off by more than this.
pub const SETTLED_SIGMAS: f64 = 2.0 * CONVERGED_SIGMAS;
/// As for the trajectory alone, except for the allowed rise of the cost: derivatives of poses between nodes
/// are accurate to a hundredth, so the gradient does not vanish exactly at the least cost. A rise of 1e-5 is
/// a step of a fraction of a standard deviation.
pub const DAMPING: DampingRule = DampingRule {
    rounding: 1e-5,
    ..DampingRule::UNDAMPED
};

/// A round sorts the points into surfels and adjusts all unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Round {
    /// Starts from the start values, such as the result of two steps.
    Coarse,
    /// Starts from the result of an adjustment; the noise is estimated.
    Fine,
}

impl Round {
    /// Sizes of its surfels, the larger first, metres.
    pub fn sizes_m(self, rung: Rung, surfel_m: f64, is_given: bool) -> Vec<f64> {
        let largest_m = match (self, rung) {
            (Self::Fine, Rung::DenseKnots) => DENSE_SHARE * surfel_m,
            _ => surfel_m,
        };
        match self {
            Self::Fine if !is_given => vec![largest_m, 0.5 * largest_m],
            _ => vec![largest_m],
        }
    }

    /// Largest distance between scans and reference, as a share of a surfel's size: that of a plane turned by 7°, larger
    /// than initial values leave, and then by 1°.
    pub fn misfit_share(self) -> f64 {
        match self {
            Self::Coarse => 0.12,
            Self::Fine => 0.02,
        }
    }

    /// Length of the last step, standard deviations, before points are sorted again, or the noise is estimated
    /// again. Sorting changes more than the last five.
    pub fn settled_sigmas(self) -> f64 {
        match self {
            Self::Coarse => 5.0,
            Self::Fine => SCALING_SIGMAS,
        }
    }

    /// Largest displacement of points, as a share of the usual size of a surfel. A round that moves them by more is
    /// repeated, because so many of them then belong to other surfels.
    pub fn move_share(self) -> f64 {
        match self {
            Self::Coarse => 0.1,
            Self::Fine => 0.02,
        }
    }
}

/// Whether rounds no longer advance, and points move only because they are sorted anew, by the displacements of points in
/// the last round and in the last two, metres. Rounds that scatter about one state move them in two rounds as far as in
/// one, rounds that advance evenly twice as far; a random walk moves them √2 times as far.
pub fn only_scatters(in_one_m: f64, in_two_m: f64) -> bool {
    in_two_m < std::f64::consts::SQRT_2 * in_one_m
}

/// The steps of all rounds.
pub struct Steps<'a> {
    pub max_iterations: usize,
    pub iterations: usize,
    pub progress: &'a dyn Progress,
}

impl Steps<'_> {
    /// Takes one step.
    pub fn step(&mut self, problem: &mut JointProblem<'_>, state: &mut State) -> Result<()> {
        self.take(problem, state, 1, SCALING_SIGMAS)?;
        Ok(())
    }

    /// Takes steps until one is shorter than `sigmas` standard deviations.
    pub fn settle(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
        sigmas: f64,
    ) -> Result<StopReason> {
        let left = self.max_iterations.saturating_sub(self.iterations).max(1);
        let share = (STEPS_SHARE * self.max_iterations as f64) as usize;
        let most = if sigmas > SETTLED_SIGMAS {
            left.min(share)
        } else {
            left.max(share)
        };
        self.take(problem, state, most, sigmas)
    }

    /// Takes at most so many steps, until one is shorter than `sigmas` standard deviations.
    fn take(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
        most: usize,
        sigmas: f64,
    ) -> Result<StopReason> {
        let ended = levenberg_marquardt(problem, state, DAMPING, most, sigmas, self.progress)?;
        self.iterations += ended.iterations;
        Ok(ended.stop)
    }

    /// Alternates steps with estimates of the noise, of the motion of mountings, and of the trust in rows, until steps are
    /// shorter than [`SCALING_SIGMAS`].
    pub fn weigh(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
        is_first: bool,
    ) -> Result<()> {
        let sigmas = if problem.layout.knots.is_empty() {
            SCALING_SIGMAS
        } else {
            LEARNING_SIGMAS
        };
        if is_first && problem.guess_noise(state) {
            problem.find_trust(state);
            self.settle(problem, state, sigmas)?;
        }
        let follows_scans = state.motions.iter().any(|motion| motion.errors().is_some());
        let most = if follows_scans {
            MAX_SCALINGS_OF_POSES
        } else {
            MAX_SCALINGS
        };
        for scaling in 1.. {
            let components = components_at(problem, state)?;
            self.progress.advance(1);
            let learned = learn(problem, state);
            let of_poses = learn_pose_errors(problem, state);
            // Dense knots follow a jump, which cannot be told from their own motion.
            let slow = state.bends.as_mut().filter(|b| b.rung == Rung::SlowKnots);
            let jumped = slow.is_some_and(Bends::restart);
            let change = rescale(problem, &components);
            problem.find_trust(state);
            let is_settled = change < SETTLED_SCALE
                && learned < SETTLED_MOTION
                && of_poses < SETTLED_POSES
                && !jumped;
            if scaling == most || is_settled {
                break;
            }
            self.settle(problem, state, sigmas)?;
        }
        self.settle(problem, state, SCALING_SIGMAS)?;
        Ok(())
    }
}

/// The variance components of all groups at a state; the problem then holds the factor at this state or at one
/// nearby.
pub fn components_at(problem: &mut JointProblem<'_>, state: &State) -> Result<Vec<Component>> {
    problem.factorise_near(state).ok_or_else(not_determined)?;
    Ok(components(problem, state))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_that_advance_are_told_from_those_that_scatter() {
        // x, x + q and x + q + q²: evenly, and ever more slowly.
        for q in [1.0, 0.9, 0.5, 0.1] {
            assert!(!only_scatters(q * q, q + q * q), "{q}");
        }
        // Three of the states that scatter about one lie equally far apart; to and fro, the first and third are the same.
        assert!(only_scatters(1.0, 1.0));
        assert!(only_scatters(1.0, 0.0));
    }
}
