//! Errors of poses: size and duration are recovered from drawn processes.

use nalgebra::{DMatrix, DVector};

use super::case::noise;
use crate::joint::motion::GaussMarkov;
use crate::joint::pose_errors::learn_from;

const COMPONENTS: usize = 6;
const KNOTS: usize = 200;
const INTERVAL_S: f64 = 1.0;

/// The precision of a process from its innovations, one component.
fn precision(sigma: f64, tau_s: f64) -> DMatrix<f64> {
    let a = (-INTERVAL_S / tau_s).exp();
    let variance = sigma * sigma * (1.0 - a * a);
    let mut h = DMatrix::zeros(KNOTS, KNOTS);
    h[(0, 0)] = 1.0 / (sigma * sigma);
    for k in 1..KNOTS {
        for (i, by_i) in [(k, 1.0), (k - 1, -a)] {
            for (j, by_j) in [(k, 1.0), (k - 1, -a)] {
                h[(i, j)] += by_i * by_j / variance;
            }
        }
    }
    h
}

/// Sets the values of the process to their estimates from observations with this noise, and returns the covariance of
/// each component.
fn estimate(process: &mut GaussMarkov, observed: &[DVector<f64>], noise: f64) -> Vec<DMatrix<f64>> {
    let components = observed.iter().enumerate();
    let covariances = components.map(|(i, y)| {
        let h = precision(process.sigma[i], process.correlation_s[i])
            + DMatrix::identity(KNOTS, KNOTS) / (noise * noise);
        let covariance = h.cholesky().expect("positive").inverse();
        let x = &covariance * y / (noise * noise);
        (0..KNOTS).for_each(|k| process.value[COMPONENTS * k + i] = x[k]);
        covariance
    });
    covariances.collect()
}

/// Processes with this σ and τ, and their observations.
fn observations(sigma: f64, tau_s: f64, noise_sigma: f64) -> Vec<DVector<f64>> {
    let mut normal = noise(11);
    let a = (-INTERVAL_S / tau_s).exp();
    let component = |_| {
        let mut x = sigma * normal();
        DVector::from_fn(KNOTS, |k, _| {
            if k > 0 {
                x = a * x + sigma * (1.0 - a * a).sqrt() * normal();
            }
            x + noise_sigma * normal()
        })
    };
    (0..COMPONENTS).map(component).collect()
}

/// σ and τ of each component, learned from a start that is wrong by a lot.
fn learned(observed: &[DVector<f64>], noise_sigma: f64) -> GaussMarkov {
    let knot_s = (0..KNOTS).map(|k| k as f64 * INTERVAL_S).collect();
    let mut process = GaussMarkov::at_knots(knot_s, vec![0.05; COMPONENTS], 30.0);
    for _ in 0..40 {
        let covariances = estimate(&mut process, observed, noise_sigma);
        learn_from(&mut process, &[0.05; COMPONENTS], &|a, b| {
            let block = |i: usize, j: usize| {
                if i == j { covariances[i][(a, b)] } else { 0.0 }
            };
            Some(DMatrix::from_fn(COMPONENTS, COMPONENTS, block))
        });
    }
    process
}

#[test]
fn size_and_duration_of_errors_are_recovered() {
    let (sigma, tau_s) = (0.01, 4.0);
    let noise_sigma = 0.002;
    let process = learned(&observations(sigma, tau_s, noise_sigma), noise_sigma);
    // 200 s hold some 25 independent values of a component with τ = 4 s: σ is known to 14 %, τ to 28 % (1/√(T/2τ)).
    for component in 0..COMPONENTS {
        let (found, found_s) = (process.sigma[component], process.correlation_s[component]);
        println!("σ {found:.5} of {sigma}, τ {found_s:.2} s of {tau_s} s");
        assert!((found / sigma).ln().abs() < 3.0 * 0.14);
        assert!((found_s / tau_s).ln().abs() < 3.0 * 0.28);
    }
}

#[test]
fn what_nothing_observes_stays_as_it_was() {
    // Noise a thousand times larger than the errors.
    let process = learned(&observations(0.01, 4.0, 50.0), 50.0);
    let is_near = |value: &f64, start: f64| (value / start).ln().abs() < 0.01;
    assert!(process.sigma.iter().all(|sigma| is_near(sigma, 0.05)));
    assert!(
        process
            .correlation_s
            .iter()
            .all(|tau_s| is_near(tau_s, 30.0))
    );
}
