//! The sparse problem against dense algebra, and against the chain of the trajectory.

use super::case::{Case, estimated};
use super::rows::{Dense, assert_near, freed, inverse};
use crate::adjustment::{CONVERGED_SIGMAS, LeastSquares, StopReason, levenberg_marquardt};
use crate::calibration::ScannerSample;
use crate::joint::components::{components, rescale};
use crate::joint::layout::UP;
use crate::joint::motion::ChainMotion;
use crate::joint::problem::JointProblem;
use crate::joint::rounds::DAMPING;
use crate::joint::state::State;
use crate::progress::Silent;
use nalgebra::{DMatrix, DVector};

/// Rounding error of covariances, in standard deviations. A pivot is the remainder of its Hᵢᵢ after
/// cancellation, which loses as many digits as Hᵢᵢ (H⁻¹)ᵢᵢ has. Each is a sum of some hundred products.
fn rounding(h: &DMatrix<f64>, covariance: &DMatrix<f64>) -> f64 {
    let lost = h.diagonal().component_mul(&covariance.diagonal()).max();
    100.0 * f64::EPSILON * lost
}

/// Largest difference of covariances, in the standard deviations of both.
fn difference(computed: &DMatrix<f64>, dense: &DMatrix<f64>, (row, column): (usize, usize)) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..computed.nrows() {
        for j in 0..computed.ncols() {
            let (a, b) = (row + i, column + j);
            let unit = (dense[(a, a)] * dense[(b, b)]).sqrt();
            worst = worst.max((computed[(i, j)] - dense[(a, b)]).abs() / unit);
        }
    }
    worst
}

fn each(mut test: impl FnMut(&str, JointProblem<'_>, State)) {
    for (name, case) in Case::all() {
        let input = case.input();
        let (problem, state) = case.problem(&input);
        test(name, problem, state);
    }
}

#[test]
fn step_and_covariances_are_those_of_dense_algebra() {
    each(|name, mut problem, state| {
        problem.factorise(&state).expect("positive definite");
        let dense = Dense::new(&problem, &state);
        let (h, g) = (dense.h(), dense.g());
        let gradient = DVector::from_column_slice(problem.gradient());
        let unit = h.diagonal().map(f64::sqrt);
        let off = (&gradient - &g).component_div(&unit).amax() / g.component_div(&unit).amax();
        assert!(off < 1e-12, "{name}: gradient {off:e}");

        let covariance = inverse(&h);
        let allowed = rounding(&h, &covariance);
        assert!(allowed < 1e-3, "{name}: {allowed:e}");
        let expected = &covariance * &g;
        let factor = problem.factor().expect("factorised");
        let mut step = problem.gradient().to_vec();
        factor.solve(&mut step, 1);
        let sigma = covariance.diagonal().map(f64::sqrt);
        let off = (DVector::from_vec(step) - &expected).component_div(&sigma);
        let length = expected.component_div(&sigma).amax();
        println!(
            "{name}: step off {:e} of {length}, allowed {allowed:e}",
            off.amax()
        );
        assert!(
            off.amax() < allowed * length.max(1.0),
            "{name}: step {:e}",
            off.amax()
        );

        let selected = factor.selected_inverse(|_| true);
        let layout = &problem.layout;
        let place = |block: usize| problem.offset(block);
        let mut worst = 0.0_f64;
        let mut compare = |a: usize, b: usize| {
            let part = selected.block(a, b).expect("kept");
            worst = worst.max(difference(&part, &covariance, (place(a), place(b))));
        };
        for &a in &layout.mountings {
            layout.mountings.iter().for_each(|&b| compare(a, b));
        }
        // Nodes and their neighbours, or knots; surfels.
        let steps = state.motions[0].steps();
        for step in 0..steps {
            compare(step, step);
            compare(step, step + 1);
        }
        compare(steps, steps);
        (0..problem.association.surfels.len())
            .for_each(|s| compare(layout.first_surfel + s, layout.first_surfel + s));
        println!("{name}: covariances off {worst:e}");
        assert!(worst < allowed, "{name}: covariances {worst:e}");
    });
}

/// The mean over all unknowns hides a mounting that moves by many standard deviations.
#[test]
fn the_first_step_is_as_long_as_that_of_the_mountings() {
    each(|name, mut problem, state| {
        let dense = Dense::new(&problem, &state);
        let (covariance, first) = (inverse(&dense.h()), problem.offset(problem.layout.last()));
        let step = &covariance * dense.g();
        let shared = covariance.view_range(first.., first..).into_owned();
        let part = step.rows_range(first..).into_owned();
        let of_shared = part.dot(&(inverse(&shared) * &part));
        let mean = step.dot(&dense.g()) / step.len() as f64;
        problem.step(&state, 0.0).expect("positive definite");
        let (length, expected) = (problem.decrement().sqrt(), of_shared.max(mean).sqrt());
        println!("{name}: {length} of {expected} sigma");
        assert!((length / expected - 1.0).abs() < 1e-3, "{name}: {length}");
    });
}

/// With the damping of the adjustment.
pub fn solve(problem: &mut JointProblem<'_>, state: &mut State) {
    let ended = levenberg_marquardt(problem, state, DAMPING, 30, CONVERGED_SIGMAS, &Silent)
        .expect("not cancelled");
    assert_eq!(ended.stop, StopReason::Converged);
}

/// A gradient is zero if its terms cancel to this share: a hundred-millionth of a residual.
const ZERO: f64 = 1e-8;
/// The same with latencies. Velocities between samples of the IMU are straight lines, so the derivative by time
/// jumps at a sample; if a profile ends up at a sample, steps alternate across it by a hundred-thousandth of a
/// standard deviation.
const ZERO_WITH_LATENCY: f64 = 1e-3;

#[test]
fn at_the_solution_the_gradient_is_zero() {
    each(|name, mut problem, mut state| {
        solve(&mut problem, &mut state);
        // A step keeps Huber's weights. If few rows beyond 2.5 standard deviations determine a direction, as
        // without a reference, the next step is still four fifths as long.
        let zero = if problem.layout.of_scanners.late.iter().any(Option::is_some) {
            ZERO_WITH_LATENCY
        } else {
            ZERO
        };
        let mut off = f64::INFINITY;
        let mut steps = 0;
        while off > zero && steps < 150 {
            state = problem.step(&state, 0.0).expect("positive definite");
            let dense = Dense::new(&problem, &state);
            let terms = dense.jacobian.abs().tr_mul(&dense.residuals.abs());
            off = dense.g().component_div(&terms).amax();
            steps += 1;
        }
        println!("{name}: gradient {off:e} of its terms after {steps} steps");
        assert!(off < zero, "{name}: {off:e}");
    });
}

#[test]
fn redundancies_by_probes_are_those_of_the_projection() {
    each(|name, mut problem, mut state| {
        solve(&mut problem, &mut state);
        problem.factorise(&state).expect("positive definite");
        let dense = Dense::new(&problem, &state);
        let covariance = inverse(&dense.h());
        let mut exact = vec![0.0; problem.groups.names.len()];
        let (mut fitted, mut squares) = (exact.clone(), exact.clone());
        for (i, row) in dense.jacobian.row_iter().enumerate() {
            let share = dense.weights[i] * (row * &covariance).dot(&row);
            exact[dense.groups[i]] += 1.0 - share;
            fitted[dense.groups[i]] += share;
            squares[dense.groups[i]] += (1.0 - share).powi(2);
        }
        let estimated = components(&problem, &state);
        for (group, component) in estimated.iter().enumerate() {
            // A projection has Σⱼ Aᵢⱼ² = Aᵢᵢ, so that a probe's trace of a group has at most twice the
            // group's trace as variance; 8 probes, four standard deviations.
            let allowed = 4.0 * (2.0 * fitted[group] / 8.0).sqrt() + 1e-6;
            let off = component.redundancy - exact[group];
            // Of Σ rᵢ², by two halves of the probes: at most 5/8 of that.
            let allowed_squares = 4.0 * (1.25 * fitted[group]).sqrt() + 1e-6;
            let off_squares = component.squares - squares[group];
            let group = &problem.groups.names[group];
            assert!(off.abs() <= allowed, "{name}, {group}: {off} of {allowed}");
            assert!(
                off_squares.abs() <= allowed_squares,
                "{name}, {group}: {off_squares} of {allowed_squares}"
            );
        }
        let all: f64 = exact.iter().sum();
        let rows = dense.groups.len() as f64;
        assert!(
            (all - (rows - problem.unknowns() as f64)).abs() < 1e-4,
            "{all}"
        );
    });
}

#[test]
fn scores_of_held_values_are_the_estimates_of_freed_ones() {
    for (name, mut case) in Case::all() {
        case.estimate_latency = vec![false, false];
        let input = case.input();
        let (mut problem, mut state) = case.problem(&input);
        solve(&mut problem, &mut state);
        problem.factorise(&state).expect("positive definite");
        // Only moves of mountings are relative to it.
        let covariance = DMatrix::identity(12, 12);
        let scores = problem.scores(&state, &covariance);
        if let Some(reference) = problem.layout.reference {
            let dense = Dense::new(&problem, &state);
            let (down, sigma) = freed(&dense, problem.offset(reference) + UP);
            let score = scores.height.expect("factorised");
            assert_near(name, score, (-down, sigma));
        }
        for scanner in 0..2 {
            let score = scores.late[scanner].expect("factorised");
            let mut free = case.input();
            free.estimate_latency[scanner] = true;
            let (free, _) = case.problem(&free);
            let block = free.layout.of_scanners.late[scanner].expect("estimated");
            let dense = Dense::new(&free, &state);
            assert_near(name, score, freed(&dense, free.offset(block)));
        }
    }
}

#[test]
fn without_scans_the_result_is_that_of_the_trajectory_alone() {
    let estimate = estimated(&[]);
    let names = vec!["prism".into()];
    let case = Case {
        samples: vec![ScannerSample::default(); 2],
        motion: Box::new(ChainMotion::new(&estimate.covariance, names, &[])),
        ..Case::plain()
    };
    let input = case.input();
    let (mut problem, start) = case.problem(&input);
    assert!(problem.association.surfels.is_empty());
    // A start away from the chain's solution.
    let step: Vec<f64> = (0..problem.unknowns())
        .map(|i| 1e-4 * (2.3 * i as f64).sin())
        .collect();
    let mut state = problem.retracted(&start, &step);
    solve(&mut problem, &mut state);
    problem.factorise(&state).expect("positive definite");
    let inverse = problem
        .factor()
        .expect("factorised")
        .selected_inverse(|_| true);
    let covariance = |a: usize, b: usize| inverse.block(a, b);
    let records = state.motions[0].records(Some(&covariance));
    let expected = estimate.trajectory.poses();
    assert_eq!(records.len(), expected.len());
    for (record, expected) in records.iter().zip(expected) {
        let (turn, shift) = record
            .world_from_body
            .perturbation_from(&expected.world_from_body);
        let (a, b) = (record.sigma.expect("given"), expected.sigma.expect("given"));
        // Both stop where a further step is a fraction of a thousandth of a standard deviation.
        assert!(shift.amax() < 1e-3 * b.position_m.min(), "{shift}");
        assert!(turn.amax() < 1e-3 * b.rotation_rad.min(), "{turn}");
        // The chain's covariances are those before its last step, which moves attitudes by up to 5 % of some
        // milliradians.
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-4;
        for i in 0..3 {
            assert!(near(a.position_m[i], b.position_m[i]));
            assert!(near(a.rotation_rad[i], b.rotation_rad[i]));
        }
    }
}

#[test]
fn residuals_and_costs_are_the_same_without_derivatives() {
    each(|name, problem, mut state| {
        state.mountings[0].body_from_scanner.translation_m.x += 1e-3;
        let (mut with, mut without) = (Vec::new(), Vec::new());
        let (mut cost_with, mut cost_without) = (0.0, 0.0);
        problem.visit(&state, |batch| {
            with.extend(
                batch
                    .rows()
                    .map(|row| (row.group, row.weight, row.residual)),
            );
            cost_with += batch.cost();
        });
        problem.visit_residuals(&state, |batch| {
            assert!(batch.rows().all(|row| row.by.is_empty()));
            without.extend(
                batch
                    .rows()
                    .map(|row| (row.group, row.weight, row.residual)),
            );
            cost_without += batch.cost();
        });
        assert!(with == without, "{name}");
        assert_eq!(cost_with, cost_without, "{name}");
    });
}

#[test]
fn a_guess_of_the_noise_of_scans_is_near_its_variance_component() {
    let case = Case::from_file();
    let input = case.input();
    let (mut problem, mut state) = case.problem(&input);
    for _ in 0..5 {
        solve(&mut problem, &mut state);
        problem.factorise(&state).expect("positive definite");
        let components = components(&problem, &state);
        rescale(&mut problem, &components);
    }
    let estimated = problem.groups.scale.clone();
    let scans = problem.groups.first_scan..problem.groups.first_reference;
    let far = &mut problem.groups.scale[scans.clone()];
    far.iter_mut().for_each(|scale| *scale *= 5.0);
    let start = problem.groups.scale.clone();
    assert!(problem.guess_noise(&state));
    let guessed: Vec<f64> = scans
        .filter(|&group| problem.groups.scale[group] != start[group])
        .map(|group| problem.groups.scale[group] / estimated[group])
        .collect();
    println!("{guessed:?}");
    assert!(guessed.len() > 2);
    assert!(guessed.iter().all(|ratio| (0.67..1.5).contains(ratio)));
}
