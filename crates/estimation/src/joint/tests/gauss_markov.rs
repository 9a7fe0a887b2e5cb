//! Correlated errors follow a Gauss-Markov process.

use crate::joint::motion::{GaussMarkov, rows_together};
use crate::joint::row::RowBatch;
use nalgebra::DMatrix;

/// J and the residuals of rows by blocks of this size.
fn dense(batch: &RowBatch, blocks: usize, size: usize) -> (DMatrix<f64>, Vec<f64>) {
    let mut jacobian = DMatrix::zeros(batch.len(), blocks * size);
    for (i, row) in batch.rows().enumerate() {
        for (block, by) in row.blocks.iter().zip(row.by.chunks_exact(size)) {
            for (component, value) in by.iter().enumerate() {
                jacobian[(i, *block as usize * size + component)] += value;
            }
        }
    }
    (jacobian, batch.rows().map(|row| row.residual).collect())
}

/// J of the rows of all knots.
fn jacobian(process: &GaussMarkov) -> DMatrix<f64> {
    let knots = process.knot_s.len();
    let mut batch = RowBatch::default();
    (0..knots).for_each(|knot| process.rows(knot, 0, 0, &mut batch));
    dense(&batch, knots, process.dimension()).0
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
                    let computed = covariance[(2 * i + component, 2 * k + component)];
                    // Only rounding.
                    assert!((computed - expected).abs() < 1e-12 * square, "{a} s, {b} s");
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
    let residuals: Vec<f64> = batch.rows().map(|row| row.residual).collect();
    let expected = jacobian(&process) * nalgebra::DVector::from_vec(process.value.clone());
    for (residual, expected) in residuals.iter().zip(&expected) {
        assert!((residual - expected).abs() < 1e-12);
    }
    // Halfway between two knots, and beyond the last.
    assert!((process.at(0.15, 1) - 0.05).abs() < 1e-12);
    assert_eq!(process.at(5.0, 0), -0.6);
}

/// 200 knots with steps of up to 0.4 mm, evenly spread.
fn walk(stride: usize) -> GaussMarkov {
    let knot_s: Vec<f64> = (0..200).map(f64::from).collect();
    let mut process = GaussMarkov::at_knots(knot_s, vec![1e-3], 5.0);
    let steps = (0..200).map(|k| 4e-4 * (((k * stride) % 199) as f64 / 99.0 - 1.0));
    process.value = steps
        .scan(0.0, |sum, step| {
            *sum += step;
            Some(*sum)
        })
        .collect();
    process
}

#[test]
fn a_jump_is_told_from_a_walk() {
    let mut process = walk(77);
    assert_eq!(process.jump(&[]), None);
    process.value[120..].iter_mut().for_each(|x| *x += 3e-3);
    let (sigmas, knot) = process.jump(&[]).expect("a step of 3 mm");
    // The median of evenly spread steps is half of the largest, and 1.48 times the median a standard deviation.
    assert!((sigmas - 3e-3 / 2.97e-4).abs() < 1.4, "{sigmas}");
    assert_eq!(knot, 120);
    process.restarts.push(knot);
    assert_eq!(process.jump(&[]), None);
    // Values after a jump are not tied to those before.
    let j = jacobian(&process);
    let covariance = j.tr_mul(&j).try_inverse().expect("as many rows as values");
    assert!(covariance[(119, 120)].abs() < 1e-15);
    assert!(covariance[(120, 121)] > 1e-6);
}

#[test]
fn a_small_jump_shows_in_the_difference_to_a_process_that_moves_alike() {
    let (mut left, mut right) = (walk(77), walk(77));
    // The individual motion of each is a tenth of the common motion.
    for (value, individual) in right.value.iter_mut().zip(walk(31).value) {
        *value += 0.1 * individual;
    }
    assert_eq!(left.jump(&[&right]), None);
    // Poses take a third of the jump from both.
    left.value[120..].iter_mut().for_each(|x| *x += 8e-4);
    right.value[120..].iter_mut().for_each(|x| *x -= 4e-4);
    assert_eq!(left.jump(&[]), None);
    assert_eq!(right.jump(&[&left]), None);
    let jump = left
        .jump(&[&right])
        .expect("a step of 1.2 mm in the difference");
    assert_eq!(jump.1, 120);
    left.restarts.push(120);
    assert_eq!(left.jump(&[&right]), None);
    assert_eq!(right.jump(&[&left]), None);
}

#[test]
fn processes_together_have_the_correlation_that_they_are_given() {
    let (knots, tau_s, rho) = (6, 2.0, [0.9, 0.0]);
    let sigmas = [vec![0.003, 0.001], vec![0.002, 0.004], vec![0.001, 0.001]];
    let knot_s: Vec<f64> = (0..knots).map(|k| 0.3 * f64::from(k)).collect();
    let knots = knot_s.len();
    let mut processes: Vec<GaussMarkov> = sigmas
        .iter()
        .map(|sigma| GaussMarkov::at_knots(knot_s.clone(), sigma.clone(), tau_s))
        .collect();
    processes[1].restarts.push(4);
    for (i, process) in processes.iter_mut().enumerate() {
        process.value = (0..2 * knots)
            .map(|k| 1e-3 * ((7 * k + i) % 5) as f64)
            .collect();
    }
    let placed: Vec<(&GaussMarkov, usize)> = processes.iter().zip([0, knots, 2 * knots]).collect();
    let mut batch = RowBatch::default();
    (0..knots).for_each(|knot| rows_together(&placed, &|c| rho[c], knot, 0, &mut batch));
    let (j, residuals) = dense(&batch, 3 * knots, 2);
    // Rows are linear.
    let values: Vec<f64> = processes.iter().flat_map(|p| p.value.clone()).collect();
    let expected = &j * nalgebra::DVector::from_vec(values);
    for (residual, expected) in residuals.iter().zip(&expected) {
        assert!((residual - expected).abs() < 1e-9);
    }
    let covariance = j.tr_mul(&j).try_inverse().expect("as many rows as values");
    let at = |s: usize, k: usize, component: usize| 2 * (s * knots + k) + component;
    for (s, a) in sigmas.iter().enumerate() {
        for (t, b) in sigmas.iter().enumerate() {
            for (k, m) in (0..4).flat_map(|k| (0..4).map(move |m| (k, m))) {
                for c in 0..2 {
                    let alike = if s == t { 1.0 } else { rho[c] };
                    let elapsed_s: f64 = knot_s[k] - knot_s[m];
                    let expected = alike * a[c] * b[c] * (-elapsed_s.abs() / tau_s).exp();
                    let computed = covariance[(at(s, k, c), at(t, m, c))];
                    // Rounding alone.
                    assert!((computed - expected).abs() < 1e-12, "{s} {t} {k} {m} {c}");
                }
            }
        }
    }
    // A process that jumps is independent.
    assert!(covariance[(at(1, 4, 0), at(0, 4, 0))].abs() < 1e-12);
    assert!(covariance[(at(2, 4, 0), at(0, 4, 0))] > 1e-7);
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
    // Mean variance over the interval of x(t) minus the line through x(0) and x(h).
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
        (process.left_out_share(0) / mean - 1.0).abs() < 0.02,
        "{mean}"
    );
}
