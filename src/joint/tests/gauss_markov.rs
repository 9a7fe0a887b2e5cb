//! Correlated errors are the process that they are called.

use crate::joint::motion::GaussMarkov;
use crate::joint::row::RowBatch;
use nalgebra::DMatrix;

/// J of the rows of all knots.
fn jacobian(process: &GaussMarkov) -> DMatrix<f64> {
    let (knots, d) = (process.knot_s.len(), process.dimension());
    let mut batch = RowBatch::default();
    (0..knots).for_each(|knot| process.rows(knot, 0, 0, &mut batch));
    let mut jacobian = DMatrix::zeros(batch.len(), knots * d);
    for (i, row) in batch.rows().enumerate() {
        for (block, by) in row.blocks.iter().zip(row.by.chunks_exact(d)) {
            for (component, value) in by.iter().enumerate() {
                jacobian[(i, *block as usize * d + component)] += value;
            }
        }
    }
    jacobian
}

#[test]
fn the_covariance_at_knots_is_that_of_the_process() {
    let sigma = vec![0.003, 0.001];
    let tau_s = 2.0;
    let even = GaussMarkov::new((10.0, 14.0), sigma.clone(), tau_s);
    let uneven = vec![0.0, 0.1, 0.15, 1.3, 1.4, 9.0];
    let uneven = GaussMarkov::at_knots(uneven, sigma.clone(), tau_s);
    assert_eq!(even.knot_s.len(), 11);
    for process in [even, uneven] {
        let j = jacobian(&process);
        let covariance = j.tr_mul(&j).try_inverse().expect("as many rows as values");
        for (i, a) in process.knot_s.iter().enumerate() {
            for (k, b) in process.knot_s.iter().enumerate() {
                for component in 0..2 {
                    let square = sigma[component].powi(2);
                    let expected = square * (-(a - b).abs() / tau_s).exp();
                    let found = covariance[(2 * i + component, 2 * k + component)];
                    // Rounding alone.
                    assert!((found - expected).abs() < 1e-12 * square, "{a} s, {b} s");
                    assert_eq!(covariance[(2 * i, 2 * k + 1)], 0.0);
                }
            }
        }
    }
}

#[test]
fn residuals_are_those_of_the_values() {
    let mut process = GaussMarkov::at_knots(vec![0.0, 0.3, 1.0], vec![0.5, 2.0], 0.7);
    process.value = vec![0.1, -0.2, 0.4, 0.3, -0.6, 1.0];
    let mut batch = RowBatch::default();
    (0..3).for_each(|knot| process.rows(knot, 0, 0, &mut batch));
    let found: Vec<f64> = batch.rows().map(|row| row.residual).collect();
    let expected = jacobian(&process) * nalgebra::DVector::from_vec(process.value.clone());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-12);
    }
    // Halfway between two knots, and beyond the last.
    assert!((process.at(0.15, 1) - 0.05).abs() < 1e-12);
    assert_eq!(process.at(5.0, 0), -0.6);
}
