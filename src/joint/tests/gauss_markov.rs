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

#[test]
fn a_jump_is_told_from_a_walk() {
    let knot_s: Vec<f64> = (0..200).map(f64::from).collect();
    let mut process = GaussMarkov::at_knots(knot_s, vec![1e-3], 5.0);
    // Steps of up to 0.4 mm, evenly spread.
    let steps = (0..200).map(|k| 4e-4 * (((k * 77) % 199) as f64 / 99.0 - 1.0));
    process.value = steps
        .scan(0.0, |sum, step| {
            *sum += step;
            Some(*sum)
        })
        .collect();
    assert!(!process.restart());
    process.value[120..].iter_mut().for_each(|x| *x += 3e-3);
    assert!(process.restart());
    assert_eq!(process.restarts, [120]);
    assert!(!process.restart());
    // What is after a jump is not tied to what was before.
    let j = jacobian(&process);
    let covariance = j.tr_mul(&j).try_inverse().expect("as many rows as values");
    assert!(covariance[(119, 120)].abs() < 1e-15);
    assert!(covariance[(120, 121)] > 1e-6);
}

#[test]
fn lines_between_knots_leave_out_a_third_of_an_interval() {
    let (tau_s, h_s) = (5.0, 0.25);
    let process = GaussMarkov::at_knots(
        (0..9).map(|k| h_s * f64::from(k)).collect(),
        vec![1.0],
        tau_s,
    );
    let r = |t: f64| (-t.abs() / tau_s).exp();
    // Variance of x(t) less the line through x(0) and x(h), over the interval.
    let at = |u: f64| {
        let (a, b) = (1.0 - u, u);
        1.0 + a * a + b * b - 2.0 * (a * r(u * h_s) + b * r(h_s - u * h_s)) + 2.0 * a * b * r(h_s)
    };
    let mean = (0..1000)
        .map(|i| at((f64::from(i) + 0.5) / 1000.0))
        .sum::<f64>()
        / 1000.0;
    // To first order of h/τ.
    assert!(
        (process.left_out_share() / mean - 1.0).abs() < 0.02,
        "{mean}"
    );
}
