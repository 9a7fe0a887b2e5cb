//! Directions of the mountings and what drives know of them, compared with what initial values say.

use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

use crate::calibration::INITIAL_SIGMA;

/// Directions of all mountings in units of the standard deviations of initial values, with the variances along them.
pub struct Directions {
    eigen: SymmetricEigen<f64, Dyn>,
}

impl Directions {
    /// The principal directions of a covariance (δp, δφ) of all mountings, metres and radians.
    pub fn of(covariance: &DMatrix<f64>) -> Self {
        let scaled = DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
            covariance[(i, j)] / (sigma(i) * sigma(j))
        });
        Self {
            eigen: SymmetricEigen::new(scaled),
        }
    }

    /// The variances along the directions; 1 is that of initial values.
    pub fn variances(&self) -> &DVector<f64> {
        &self.eigen.eigenvalues
    }

    /// The part along direction `k` of a change (δp, δφ) of all mountings.
    pub fn along(&self, k: usize, change: &DVector<f64>) -> f64 {
        let direction = self.eigen.eigenvectors.column(k);
        let parts = direction.iter().zip(change.iter()).enumerate();
        parts.map(|(i, (q, change))| q * change / sigma(i)).sum()
    }

    /// A change (δp, δφ) of all mountings from its parts along the directions.
    pub fn change(&self, parts: &DVector<f64>) -> DVector<f64> {
        let scaled = &self.eigen.eigenvectors * parts;
        DVector::from_fn(scaled.len(), |i, _| scaled[i] * sigma(i))
    }

    /// The covariance (δp, δφ) of all mountings with these variances along the directions.
    pub fn covariance(&self, variances: &DVector<f64>) -> DMatrix<f64> {
        let q = &self.eigen.eigenvectors;
        in_units(&(q * DMatrix::from_diagonal(variances) * q.transpose()))
    }

    /// Directions (δp, δφ) along which the drives say less about a parameter than its initial value does, the least
    /// determined first.
    pub fn undetermined(&self) -> Vec<DVector<f64>> {
        let count = self.eigen.eigenvalues.len();
        let mut directions: Vec<(f64, DVector<f64>)> = (0..count)
            .filter_map(|k| {
                let direction = self.eigen.eigenvectors.column(k);
                let variance = self.eigen.eigenvalues[k].max(0.0);
                // Without the prior.
                let of_drives = variance / (1.0 - variance).max(f64::EPSILON);
                (of_drives.sqrt() * direction.amax() > 1.0).then(|| {
                    let direction = DVector::from_fn(count, |i, _| direction[i] * sigma(i));
                    (of_drives, direction)
                })
            })
            .collect();
        directions.sort_by(|a, b| b.0.total_cmp(&a.0));
        directions
            .into_iter()
            .map(|(_, direction)| direction)
            .collect()
    }
}

/// Standard deviation of the initial value of a parameter, (δp, δφ) of all mountings.
fn sigma(parameter: usize) -> f64 {
    INITIAL_SIGMA[parameter % 6 / 3]
}

/// A covariance in metres and radians from one in units of the standard deviations of initial values.
pub fn in_units(scaled: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(scaled.nrows(), scaled.ncols(), |i, j| {
        scaled[(i, j)] * sigma(i) * sigma(j)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Covariance of two mountings that drives know to this standard deviation along a direction of unit length, in
    /// standard deviations of initial values, and to a thousandth of these across it.
    fn covariance(direction: &DVector<f64>, of_drives: f64) -> DMatrix<f64> {
        let along = 1.0 / (1.0 + of_drives.powi(-2));
        let outer = direction * direction.transpose();
        let across = (DMatrix::identity(12, 12) - &outer) * 1e-6;
        let scaled = across + outer * along;
        in_units(&scaled)
    }

    #[test]
    fn a_direction_of_which_initial_values_say_more_is_not_determined() {
        let height = DVector::from_fn(12, |i, _| if i % 6 == 2 { 0.5_f64.sqrt() } else { 0.0 });
        let [known, unknown] = [1.3, 1.5]
            .map(|of_drives| Directions::of(&covariance(&height, of_drives)).undetermined());
        // Each of the two heights moves by 0.71 times the direction.
        assert!(known.is_empty());
        assert_eq!(unknown.len(), 1);
        assert!((unknown[0][2] / unknown[0][8] - 1.0).abs() < 1e-9);
        assert!(unknown[0][2].abs() > 100.0 * unknown[0][0].abs());
    }
}
