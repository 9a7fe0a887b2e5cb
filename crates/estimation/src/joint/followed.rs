//! Changes of the mountings that all other unknowns follow.

use nalgebra::{DMatrix, DVector};

use super::problem::JointProblem;
use super::state::State;
use crate::calibration::INITIAL_SIGMA;

/// Changes of all unknowns, one for each parameter of the mountings, of which the normal equations know nothing from each
/// other and each to a standard deviation of one: with the covariance L Lᵀ of the mountings (δφ, δp) they change by the
/// columns of L, and everything else as fits best.
pub struct Followed {
    /// Unknowns × parameters.
    pub changes: DMatrix<f64>,
    /// L.
    root: DMatrix<f64>,
}

impl Followed {
    /// Those with the factor that the problem holds; `None` without it.
    pub fn of(problem: &JointProblem<'_>, state: &State) -> Option<Self> {
        let factor = problem.factor()?;
        // The mountings are the last unknowns.
        let first = problem.offset(problem.layout.mountings[0]);
        let size = 6 * state.mountings.len();
        let mut changes = DMatrix::zeros(problem.unknowns(), size);
        changes.rows_mut(first, size).fill_with_identity();
        factor.solve(changes.as_mut_slice(), size);
        let root = changes.rows(first, size).into_owned().cholesky()?.l();
        let whitened = root.tr_solve_lower_triangular(&DMatrix::identity(size, size))?;
        Some(Self {
            changes: changes * whitened,
            root,
        })
    }

    /// The standard deviation along a combination of the changes of unit length, in those of initial values.
    pub fn of_initial(&self, combination: &DVector<f64>) -> f64 {
        let [shift_m, turn_rad] = INITIAL_SIGMA;
        let sigmas = [[turn_rad; 3], [shift_m; 3]].concat();
        let along = &self.root * combination;
        let initial = along.iter().zip(sigmas.iter().cycle());
        let initial: f64 = initial.map(|(x, sigma)| (x / sigma).powi(2)).sum();
        initial.sqrt()
    }

    /// The change of all unknowns whose squares make the variance along a combination `factor` times as large; `None` if it
    /// is not larger.
    pub fn side(&self, combination: &DVector<f64>, factor: f64) -> Option<Vec<f64>> {
        let lacking = factor - 1.0;
        let side = || {
            (&self.changes * (combination * lacking.sqrt()))
                .as_slice()
                .to_vec()
        };
        (lacking > 0.0).then(side)
    }
}
