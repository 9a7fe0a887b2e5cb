//! Slow motions of a mounting, which are estimated without being among the unknowns.

use std::f64::consts::{PI, SQRT_2};

use super::case::{Case, SPAN_S, samples_with, truth};
use super::dense::solve;
use super::rows::{Dense, assert_near, freed};
use super::whole::on_exact_reference;
use crate::geometry::Vec3;
use crate::joint::held::MODES;
use crate::joint::slow::{slow_contradiction, slow_motions};
use nalgebra::DVector;

#[test]
fn estimates_are_those_with_the_motion_among_the_unknowns() {
    let case = Case::plain();
    let input = case.input();
    let (mut problem, mut state) = case.problem(&input);
    solve(&mut problem, &mut state);
    problem.factorise(&state).expect("positive definite");
    let motions = slow_motions(&problem, &state);
    assert_eq!(motions.len(), 2 * 6 * MODES);

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
        let motion = &motions[6 * MODES * scanner + place];
        let (mode, component) = (place / 6 + 1, place % 6);
        assert_eq!((motion.scanner, motion.component), (scanner, component));
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
        assert_near(&name, motion.score, freed(&among_unknowns, 0));
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
        let estimate = slow_motions(&problem, &state)[0].score;
        (estimate, slow_contradiction(&problem, &state))
    };
    let (clean, text) = turning(0.0);
    assert!(clean.sigmas() < 3.0 && text.is_none());
    let size_rad = 1e-3;
    let (estimate, text) = turning(size_rad);
    assert!((estimate.value - size_rad).abs() < 3.0 * estimate.sigma);
    let text = text.expect("a motion");
    println!("{text}");
    assert!(text.contains("rigid mounting") && text.contains("`left` turned slowly about x"));
}
