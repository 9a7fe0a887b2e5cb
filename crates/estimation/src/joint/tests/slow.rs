//! Slow motions of a mounting, which are estimated without being among the unknowns.

use std::f64::consts::{PI, SQRT_2};

use super::case::{Case, SPAN_S, samples_with, truth};
use super::dense::solve;
use super::rows::{Dense, assert_near, freed};
use super::whole::on_exact_reference;
use crate::geometry::Vec3;
use crate::joint::bend::Rung;
use crate::joint::held::MODES;
use crate::joint::score::HeldValues;
use crate::joint::slow::{SlowMotions, weigh};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

#[test]
fn estimates_are_those_with_the_motion_among_the_unknowns() {
    let case = Case::plain();
    let input = case.input();
    let (mut problem, mut state) = case.problem(&input);
    solve(&mut problem, &mut state);
    problem.factorise(&state).expect("positive definite");
    let all = SlowMotions::of(&problem, &state);
    let [of_drive] = &all.drives[..] else {
        panic!("{} drives", all.drives.len());
    };
    assert_eq!(of_drive.variance.len(), 2 * 6 * MODES);

    let dense = Dense::new(&problem, &state);
    // In the order of the rows.
    let mut scans = problem
        .each_mean(&state, |_, row, mean| (row.scanner as usize, mean.time_s))
        .into_iter();
    let of_rows: Vec<Option<(usize, f64)>> = (dense.groups.iter())
        .map(|group| {
            if *group >= problem.groups.first_scan {
                scans.next()
            } else {
                None
            }
        })
        .collect();
    assert!(scans.next().is_none());
    for (scanner, place) in [(0, 0), (0, 17), (0, 35), (1, 8)] {
        assert_eq!(of_drive.motions[scanner].scanner, scanner);
        let score = of_drive.held.score(6 * MODES * scanner + place);
        let score = score.expect("information");
        let (mode, component) = (place / 6 + 1, place % 6);
        let profiles = &case.samples[scanner].profiles;
        let [from_s, to_s] = [0, profiles.len() - 1].map(|i| profiles[i].time_s);
        let mounting = problem.offset(problem.layout.mountings[scanner]);
        let by = DVector::from_fn(of_rows.len(), |row, _| match of_rows[row] {
            Some((of_scanner, time_s)) if of_scanner == scanner => {
                let angle = mode as f64 * PI * (time_s - from_s) / (to_s - from_s);
                SQRT_2 * angle.cos() * dense.jacobian[(row, mounting + component)]
            }
            _ => 0.0,
        });
        let mut jacobian = dense.jacobian.clone().insert_column(0, 0.0);
        jacobian.set_column(0, &by);
        let among_unknowns = Dense {
            jacobian,
            ..dense.clone()
        };
        let name = format!("scanner {scanner}, {place}");
        assert_near(&name, score, freed(&among_unknowns, 0));
    }
}

#[test]
fn a_scanner_that_turns_slowly_is_named() {
    let left = truth()[0].body_from_scanner;
    let turning = |size_rad: f64| {
        let mut case = on_exact_reference();
        case.samples = samples_with(|time_s| {
            let turn_rad = SQRT_2 * size_rad * (PI * time_s / SPAN_S).cos();
            left.perturbed(&(Vec3::x() * turn_rad), &Vec3::zeros())
        });
        let input = case.input();
        let (mut problem, mut state) = case.problem(&input);
        solve(&mut problem, &mut state);
        problem.factorise(&state).expect("positive definite");
        let all = SlowMotions::of(&problem, &state);
        let text = all.contradiction(&problem, Rung::Rigid);
        let estimate = all.drives[0].held.score(0).expect("information");
        (estimate, text)
    };
    let (clean, text) = turning(0.0);
    assert!(clean.sigmas() < 3.0 && text.is_none());
    let size_rad = 1e-3;
    let (estimate, text) = turning(size_rad);
    assert!((estimate.value - size_rad).abs() < 3.0 * estimate.sigma);
    let text = text.expect("a motion");
    println!("{text}");
    assert!(text.contains("rigid mounting") && text.contains("`left` turns about x"));
}

/// Coefficients of two scanners whose information is that of `rows` random rows: held values without motion, or with one of
/// this size.
fn drawn(rng: &mut ChaCha8Rng, rows: usize, size: f64) -> HeldValues {
    let count = 2 * 6 * MODES;
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let by = DMatrix::from_fn(rows, count, |_, _| 1e3 * normal());
    let value = DVector::from_fn(count, |i, _| size / (1 + i / 6 % MODES) as f64 * normal());
    let residuals = DVector::from_fn(rows, |_, _| normal()) - &by * value;
    HeldValues {
        information: by.tr_mul(&by),
        gradient: -by.tr_mul(&residuals),
        follow: DMatrix::zeros(count, 0),
    }
}

#[test]
fn evidence_for_motions_is_rare_without_any_and_their_size_is_found() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let is_free = [true; 2 * 6 * MODES];
    // The expectation of the likelihood ratio is one, and so it exceeds 1/α with a probability below α.
    let ratios = (0..200).map(|_| weigh(&drawn(&mut rng, 80, 0.0), &is_free).0.exp());
    let ratios: Vec<f64> = ratios.collect();
    let above = |limit: f64| ratios.iter().filter(|ratio| **ratio > limit).count();
    println!("{} above 1, {} above 10", above(1.0), above(10.0));
    assert!(above(10.0) < 20);
    // A size of 1 mm or 1 mrad, where rows show 0.1.
    let modes: f64 = (1..=MODES).map(|k| (k as f64).powi(-2)).sum();
    let variances = (0..20).map(|_| {
        let (evidence, variance) = weigh(&drawn(&mut rng, 80, 1e-3 / modes.sqrt()), &is_free);
        assert!(evidence > (1e3_f64).ln());
        let of_motion: f64 = variance.iter().skip(3).step_by(6).take(MODES).sum();
        of_motion
    });
    let root = (variances.sum::<f64>() / 20.0).sqrt();
    println!("{root}");
    // Sizes are a factor of 1.8 apart, and 36 coefficients show one to 12 %.
    assert!((root / 1e-3 - 1.0).abs() < 0.3);
}

#[test]
fn fixed_components_do_not_move() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let is_free: Vec<bool> = (0..2 * 6 * MODES).map(|i| i % 6 < 3).collect();
    let (_, variance) = weigh(&drawn(&mut rng, 80, 1e-3), &is_free);
    for (variance, is_free) in variance.iter().zip(is_free) {
        assert_eq!(*variance > 0.0, is_free);
    }
}
