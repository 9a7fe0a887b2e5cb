//! Least-squares adjustment on a chain of unknowns: factors' rows in, solution and covariances out.
//!
//! This module knows no sensors. A `ChainProblem` defines what the unknowns mean and which factors tie
//! them; its rows serve other solvers as well.

mod border;
mod chain;
mod damping;
mod front;
mod functional;
mod information;
mod layout;
mod levenberg_marquardt;
mod loss;
mod marginals;
mod prior;
mod problem;
mod rows;
mod sparse;
mod system;
#[cfg(test)]
mod tests;
mod unknown;

pub use levenberg_marquardt::StopReason;
pub use loss::Loss;

pub(crate) use chain::{ChainFactor, ChainStep, NotPositive};
pub(crate) use damping::{Damping, DampingRule, Verdict};
pub(crate) use front::{Carry, solve_rows};
pub(crate) use functional::ChainGradient;
pub(crate) use information::residual_information;
pub(crate) use layout::{CHANGE, ChainLayout, NODE, SEGMENT, STEP, TAIL};
pub(crate) use levenberg_marquardt::{CONVERGED_SIGMAS, Ended, LeastSquares, levenberg_marquardt};
pub(crate) use loss::{
    Graduation, LossGroup, cautious_weight, rejection_limit, square_scale, weigh,
};
pub(crate) use marginals::{StepCovariance, tail_covariance};
pub(crate) use prior::{BorderPrior, Prior};
pub(crate) use problem::ChainProblem;
pub(crate) use rows::{FactorRows, Rows};
pub(crate) use sparse::{BlockPattern, SelectedInverse, SparseFactor, SparseSystem};
pub(crate) use system::{BorderSystem, StepSystem, assemble};
pub(crate) use unknown::{Columns, Parameter, Retract, Unknown};
