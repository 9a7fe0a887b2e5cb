//! Uncertainties with moving mountings, against dense algebra and finite differences.

use std::f64::consts::{PI, SQRT_2};

use super::case::Case;
use super::rows::Dense;
use super::rows::inverse;
use crate::geometry::Vec3;
use crate::joint::covariance::Covariance;
use crate::joint::held::MODES;
use crate::joint::known::{known_points, prior_shares};
use crate::joint::problem::JointProblem;
use crate::joint::row::RowBatch;
use crate::joint::scan::StepScans;
use crate::joint::slow::SlowMotions;
use crate::joint::state::State;
use crate::joint::surfel::RowPoint;

/// Position of a point of a scanner in the world.
fn place(
    problem: &JointProblem<'_>,
    state: &State,
    (scanner, step): (usize, usize),
    point: &RowPoint,
) -> Vec3 {
    let context = problem.scan_context(0, state);
    let poses = state.motions[0].poses(step);
    let scans = StepScans::new(&context, &poses, context.rows.of_step(step));
    let (place, ..) = scans.along(scanner, &Vec3::x(), &Vec3::zeros(), &[*point]);
    place
}

#[test]
fn standard_deviations_of_points_are_those_of_finite_differences() {
    for (name, case) in [
        ("rigid", Case::plain()),
        ("moving", Case::moving()),
        ("slow", Case::plain()),
    ] {
        let input = case.input();
        let (mut problem, state) = case.problem(&input);
        problem.factorise(&state).expect("positive definite");
        let factor = problem.factor().expect("factorised");
        let mut slow = SlowMotions::default();
        if name == "slow" {
            slow = SlowMotions::of(&problem, &state);
            // Of different sizes, which move points about as much as everything else does.
            let variances = slow.drives[0].variance.iter_mut().enumerate();
            variances.for_each(|(i, variance)| *variance = 1e-11 * (i + 1) as f64);
        }
        let all = Covariance {
            problem: &problem,
            inverse: factor.selected_inverse(|_| true),
            changes: Vec::new(),
            slow: &slow,
        };
        let known = known_points(&all, &state, 0);
        let covariance = inverse(&Dense::new(&problem, &state).h());
        let rows = &problem.association.drives[0];
        for (scanner, known) in known.iter().enumerate() {
            let known = &known[known.len() / 2];
            let of_step = |step: usize| rows.of_step(step).iter().map(move |row| (step, row));
            let mut all = (0..state.motions[0].steps()).flat_map(of_step);
            let containing = all.find(|(_, row)| {
                row.scanner as usize == scanner
                    && rows.points_of(row)[0].position_m == known.in_scanner_m
            });
            let (step, row) = containing.expect("a point of a row");
            let point = rows.points_of(row)[0];
            let sigmas = covariance.diagonal().map(f64::sqrt);
            let mut jacobian = nalgebra::DMatrix::zeros(3, problem.unknowns());
            for unknown in 0..problem.unknowns() {
                // A thousandth of a standard deviation; held values move by less than rounding.
                let h = (1e-3 * sigmas[unknown]).max(1e-9);
                let at = |h: f64| {
                    let mut moved = vec![0.0; problem.unknowns()];
                    moved[unknown] = h;
                    place(
                        &problem,
                        &problem.retracted(&state, &moved),
                        (scanner, step),
                        &point,
                    )
                };
                jacobian.set_column(unknown, &((at(h) - at(-h)) / (2.0 * h)));
            }
            let mut variance = &jacobian * &covariance * jacobian.transpose();
            for drive in &slow.drives {
                // A coefficient moves the mounting at the time of the point, and all unknowns follow.
                let mounting = problem.offset(problem.layout.mountings[scanner]);
                for (value, of_value) in drive.variance.iter().enumerate() {
                    let motion = &drive.motions[value / (6 * MODES)];
                    let mut change = drive.held.follow.row(value).transpose();
                    if motion.scanner == scanner {
                        let share = (known.time_s - motion.from_s) / motion.duration_s;
                        let mode = (value / 6 % MODES + 1) as f64;
                        change[mounting + value % 6] += SQRT_2 * (mode * PI * share).cos();
                    }
                    let moved = &jacobian * change;
                    variance += &moved * moved.transpose() * *of_value;
                }
            }
            for axis in 0..3 {
                let ratio = known.sigma_m[axis] / variance[(axis, axis)].sqrt();
                println!(
                    "{name}, scanner {scanner}: {} m, ratio {ratio}",
                    known.sigma_m[axis]
                );
                // Derivatives of poses between nodes are accurate to a hundredth.
                assert!((ratio - 1.0).abs() < 0.02);
            }
        }
    }
}

#[test]
fn shares_of_the_prior_are_those_of_dense_algebra() {
    let case = Case::moving();
    let input = case.input();
    let (mut problem, state) = case.problem(&input);
    problem.factorise(&state).expect("positive definite");
    let covariance = inverse(&Dense::new(&problem, &state).h());
    let mut batch = RowBatch::default();
    problem.bending(&state, &mut batch);
    let mut places = Vec::new();
    let shares = prior_shares(&problem, &state);
    assert_eq!(shares.len(), 12);
    for (parameter, share) in shares.iter().enumerate() {
        let block = problem.layout.mountings[parameter / 6];
        let unknown = problem.offset(block) + (parameter + 3) % 6;
        let mut expected = 0.0;
        for row in batch.rows() {
            problem.places(&row, &mut places);
            let terms = places
                .iter()
                .zip(row.by)
                .map(|(place, by)| by * covariance[(*place, unknown)]);
            expected += terms.sum::<f64>().powi(2);
        }
        expected /= covariance[(unknown, unknown)];
        println!("{parameter}: {share} of {expected}");
        assert!((share - expected).abs() < 1e-4);
        assert!((0.0..=1.0).contains(share));
    }
    let rigid = Case::plain();
    let input = rigid.input();
    let (mut problem, state) = rigid.problem(&input);
    problem.factorise(&state).expect("positive definite");
    assert!(prior_shares(&problem, &state).is_empty());
}
