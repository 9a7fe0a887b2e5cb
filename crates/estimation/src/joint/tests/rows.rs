//! All rows of a problem as dense matrices, and estimates from these.

use crate::joint::problem::JointProblem;
use crate::joint::score::Score;
use crate::joint::state::State;
use nalgebra::{DMatrix, DVector};

/// All rows of a problem at a state.
#[derive(Clone)]
pub struct Dense {
    pub groups: Vec<usize>,
    pub weights: DVector<f64>,
    pub residuals: DVector<f64>,
    pub jacobian: DMatrix<f64>,
}

impl Dense {
    pub fn new(problem: &JointProblem<'_>, state: &State) -> Self {
        let (mut groups, mut weights, mut residuals) = (Vec::new(), Vec::new(), Vec::new());
        let mut entries = Vec::new();
        problem.visit(state, |batch| {
            for row in batch.rows() {
                let mut by = row.by.iter();
                for &block in row.blocks {
                    let first = problem.offset(block as usize);
                    for place in first..first + problem.layout.sizes[block as usize] {
                        let value = by.next().expect("a derivative for each unknown");
                        entries.push((groups.len(), place, *value));
                    }
                }
                assert!(by.next().is_none(), "an unknown for each derivative");
                groups.push(row.group);
                weights.push(row.weight);
                residuals.push(row.residual);
            }
        });
        let mut jacobian = DMatrix::zeros(groups.len(), problem.unknowns());
        for (row, place, value) in entries {
            jacobian[(row, place)] += value;
        }
        Self {
            groups,
            weights: DVector::from_vec(weights),
            residuals: DVector::from_vec(residuals),
            jacobian,
        }
    }

    /// Jᵀ W J.
    pub fn h(&self) -> DMatrix<f64> {
        let mut whitened = self.jacobian.clone();
        for (mut row, weight) in whitened.row_iter_mut().zip(&self.weights) {
            row *= weight.sqrt();
        }
        whitened.tr_mul(&whitened)
    }

    /// −Jᵀ W r.
    pub fn g(&self) -> DVector<f64> {
        -self
            .jacobian
            .tr_mul(&self.weights.component_mul(&self.residuals))
    }
}

/// Residuals of all rows.
pub fn residuals(problem: &JointProblem<'_>, state: &State) -> DVector<f64> {
    let mut all = Vec::new();
    problem.visit_residuals(state, |batch| {
        all.extend(batch.rows().map(|row| row.residual))
    });
    DVector::from_vec(all)
}

/// H⁻¹. Unknowns are scaled to a diagonal of ones, because held values have weights of 10¹⁶.
pub fn inverse(h: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = h.diagonal().map(|x| 1.0 / x.sqrt());
    let by_scale = |m: &DMatrix<f64>| {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * scale[i] * scale[j])
    };
    let scaled = by_scale(h).cholesky().expect("positive definite");
    by_scale(&scaled.inverse())
}

/// The best value of an unknown and its standard deviation, without the row that only holds it.
pub fn freed(dense: &Dense, place: usize) -> (f64, f64) {
    let mut weights = dense.weights.clone();
    for (weight, row) in weights.iter_mut().zip(dense.jacobian.row_iter()) {
        let holds = row[place] != 0.0 && row.iter().filter(|x| **x != 0.0).count() == 1;
        *weight *= if holds { 0.0 } else { 1.0 };
    }
    let weighted = DMatrix::from_diagonal(&weights) * &dense.jacobian;
    let covariance = inverse(&weighted.tr_mul(&dense.jacobian));
    let step = -&covariance * weighted.tr_mul(&dense.residuals);
    (step[place], covariance[(place, place)].sqrt())
}

/// Checks an estimate of a held value against the value and its standard deviation among the unknowns.
pub fn assert_near(name: &str, score: Score, (value, sigma): (f64, f64)) {
    println!("{name}: {score:?}, freed {value:e} ± {sigma:e}");
    assert!((score.sigma / sigma - 1.0).abs() < 1e-3, "{name}");
    assert!((score.value - value).abs() < 1e-2 * sigma, "{name}");
}

/// Checks that a matrix is the identity up to rounding in a factorisation.
pub fn assert_identity(name: &str, matrix: &DMatrix<f64>) {
    let off = matrix - DMatrix::identity(matrix.nrows(), matrix.ncols());
    assert!(off.amax() < 1e-6, "{name}: {:e}", off.amax());
}
