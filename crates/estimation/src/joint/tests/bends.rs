//! Motions in time: the variance that knots leave out, and the recovery of standard deviations, correlation time and
//! correlation between scanners from drawn processes.

use super::case::noise;
use crate::joint::bend::{BENDING, Bends, LOADS, Rung};
use crate::joint::learn::learn_from;
use crate::joint::motion::{GaussMarkov, rows_together};
use crate::joint::row::RowBatch;
use crate::joint::surfel::ScanRow;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

const SCANNERS: usize = 2;
/// σ of rotations and shifts, τ in knots, and ρ of rotations and shifts.
type Motion = ([f64; 2], f64, [f64; 2]);

/// Two scanners of one drive with knots a second apart, at rest.
fn at_rest(knots: usize, (sigma, tau_s, together): Motion) -> Bends {
    let knot_s: Vec<f64> = (0..knots).map(|k| k as f64).collect();
    let sigma = (0..6).map(|i| sigma[i / 3]).collect();
    let process = GaussMarkov::at_knots(knot_s, sigma, tau_s);
    Bends {
        rung: Rung::DenseKnots,
        mean_load: [0.0; LOADS],
        causes: Arc::new(Vec::new()),
        causes_used: 0,
        compliance: vec![[0.0; BENDING]; SCANNERS],
        prior: vec![[[0.0; BENDING]; 2]; SCANNERS],
        knots: vec![vec![process; SCANNERS]],
        together,
    }
}

/// Draws the motion of both scanners.
fn drawn(knots: usize, motion: Motion, seed: u64) -> Bends {
    let (sigma, tau_s, together) = motion;
    let mut bends = at_rest(knots, motion);
    let mut normal = noise(seed);
    let keep = (-1.0 / tau_s).exp();
    for k in 0..knots {
        for i in 0..6 {
            let (sigma, rho) = (sigma[i / 3], together[i / 3]);
            let both = normal();
            for process in &mut bends.knots[0] {
                let new = rho.sqrt() * both + (1.0 - rho).sqrt() * normal();
                process.value[6 * k + i] = match k {
                    0 => sigma * new,
                    _ => {
                        let before = process.value[6 * (k - 1) + i];
                        keep * before + sigma * (1.0 - keep * keep).sqrt() * new
                    }
                };
            }
        }
    }
    bends
}

/// The values of σ, τ and ρ.
fn learned(bends: &Bends) -> Motion {
    let process = &bends.knots[0][0];
    let sigma = [process.sigma[0], process.sigma[3]];
    (sigma, process.correlation_s[0], bends.together)
}

fn assert_near(learned: f64, expected: f64, share: f64, what: &str) {
    let is_near = (learned / expected).ln().abs() < share;
    assert!(is_near, "{what}: {learned} instead of {expected}");
}

#[test]
fn parameters_are_recovered_from_known_values() {
    let knots = 4000;
    let motion = ([1e-3, 2e-3], 4.0, [0.8, 0.3]);
    let mut bends = drawn(knots, motion, 1);
    let start = at_rest(knots, ([2e-3, 1e-3], 10.0, [0.0; 2]));
    for (process, start) in bends.knots[0].iter_mut().zip(&start.knots[0]) {
        (process.sigma, process.correlation_s) = (start.sigma.clone(), start.correlation_s.clone());
    }
    bends.together = start.together;
    let offsets = [vec![0, 6 * knots]];
    assert!(learn_from(&mut bends, &offsets, &|_, _| 0.0) > 0.1);
    for _ in 0..5 {
        learn_from(&mut bends, &offsets, &|_, _| 0.0);
    }
    assert!(learn_from(&mut bends, &offsets, &|_, _| 0.0) < 1e-3);
    let (sigma, tau_s, together) = learned(&bends);
    // With 24,000 steps, σ and ρ are known to a hundredth, τ to two: tolerances of 2.5 or more standard deviations.
    for class in 0..2 {
        assert_near(sigma[class], motion.0[class], 0.04, "σ");
        assert!(
            (together[class] - motion.2[class]).abs() < 0.03,
            "{together:?}"
        );
    }
    assert_near(tau_s, motion.1, 0.06, "τ");
}

/// The covariance of a component at all knots of both scanners, observed with this noise: by scanner and knot.
fn covariance(bends: &Bends, component: usize, noise: f64) -> DMatrix<f64> {
    let processes: Vec<GaussMarkov> = bends.knots[0]
        .iter()
        .map(|p| {
            GaussMarkov::at_knots(
                p.knot_s.clone(),
                vec![p.sigma[component]],
                p.correlation_s[0],
            )
        })
        .collect();
    let knots = processes[0].knot_s.len();
    let placed: Vec<(&GaussMarkov, usize)> = processes.iter().zip([0, knots]).collect();
    let mut batch = RowBatch::default();
    let rho = bends.together[component / 3];
    (0..knots).for_each(|knot| rows_together(&placed, &|_| rho, knot, 0, &mut batch));
    let mut h = DMatrix::identity(SCANNERS * knots, SCANNERS * knots) / (noise * noise);
    for row in batch.rows() {
        for (a, by_a) in row.blocks.iter().zip(row.by) {
            for (b, by_b) in row.blocks.iter().zip(row.by) {
                h[(*a as usize, *b as usize)] += by_a * by_b;
            }
        }
    }
    h.cholesky().expect("positive").inverse()
}

#[test]
fn parameters_are_recovered_from_values_observed_with_noise() {
    let knots = 200;
    // Independent scanners, and scanners on one rigid frame.
    for (rho, seed) in [(0.0, 3), (0.998, 4)] {
        let truth = ([1.4e-3, 1.5e-3], 8.0, [rho; 2]);
        let motion = drawn(knots, truth, seed);
        // As large as the changes of the processes from knot to knot.
        let noise_size = 7e-4;
        let mut normal = noise(10 + seed);
        let observed: Vec<Vec<f64>> = motion.knots[0]
            .iter()
            .map(|p| p.value.iter().map(|x| x + noise_size * normal()).collect())
            .collect();
        let mut bends = at_rest(knots, ([1.5e-3, 2e-3], 5.0, [0.0; 2]));
        let mut change = f64::NAN;
        for _ in 0..12 {
            let of_class = [0, 3].map(|component| covariance(&bends, component, noise_size));
            for i in 0..6 {
                let by_scanner = (0..SCANNERS).flat_map(|s| (0..knots).map(move |k| (s, k)));
                let sides = by_scanner.map(|(s, k)| observed[s][6 * k + i] / noise_size.powi(2));
                let sides = DVector::from_iterator(SCANNERS * knots, sides);
                let values = &of_class[i / 3] * sides;
                for (s, process) in bends.knots[0].iter_mut().enumerate() {
                    (0..knots).for_each(|k| process.value[6 * k + i] = values[s * knots + k]);
                }
            }
            change = learn_from(&mut bends, &[vec![0, 6 * knots]], &|a, b| {
                if a % 6 == b % 6 {
                    of_class[a % 6 / 3][(a / 6, b / 6)]
                } else {
                    0.0
                }
            });
        }
        let (sigma, tau_s, together) = learned(&bends);
        println!("ρ {rho}: {sigma:?} {tau_s} {together:?}, {change}");
        // 25 correlation times of three components: σ is known to a tenth, τ to a fifth; two standard deviations.
        for class in 0..2 {
            assert_near(sigma[class], truth.0[class], 0.2, "σ");
            assert!(
                (together[class] - rho).abs() < 0.2 - 0.18 * rho,
                "{together:?}"
            );
        }
        assert_near(tau_s, truth.1, 0.4, "τ");
    }
}

#[test]
fn the_variance_that_knots_leave_out_makes_many_rows_worth_six() {
    let (sigma, tau_s) = ([1e-3, 2e-3], 5.0);
    let row = |rows_in_step: u32| ScanRow {
        surfel: 0,
        scanner: 1,
        first: 0,
        count: 1,
        effective: 1.0,
        coverage: 0,
        scatter_m: 0.0,
        distance_m: 0.0,
        depth_m: 0.8,
        by_motion: [0.5, 1.0],
        rows_in_step,
        trust: 1.0,
    };
    let left_out = |together: [f64; 2], rows_in_step: u32| {
        at_rest(9, (sigma, tau_s, together)).left_out(0, &row(rows_in_step))
    };
    // Knots are a second apart: h/(3τ) of each variance.
    let alone = (0.5 * 1e-6 + 4e-6) / (3.0 * tau_s);
    assert_near(left_out([0.0; 2], 1), alone, 1e-12, "alone");
    assert_near(left_out([0.0; 2], 6), alone, 1e-12, "six");
    // The information of 24 rows is that of six.
    assert_near(left_out([0.0; 2], 24) / 24.0, alone / 6.0, 1e-12, "24");
    let together = (0.5 * 1e-6 * 1.5 + 4e-6 * 2.0) / (3.0 * tau_s);
    assert_near(left_out([0.5, 1.0], 6), together, 1e-12, "together");
}
