//! What noise of slopes adds to the normal matrix, against differences of dense matrices.

use nalgebra::{DMatrix, DVector};

use super::case::Case;
use super::rows::Dense;
use super::rows::inverse;
use crate::calibration::INITIAL_SIGMA;
use crate::geometry::Vec3;
use crate::geometry::so3::exp;
use crate::joint::followed::Followed;
use crate::joint::problem::JointProblem;
use crate::joint::state::State;

/// The normal matrix along `changes` before and after the surfels are eliminated, with the weights of rows and the inverse
/// of the surfels' own normal matrix held.
fn eliminated(
    problem: &JointProblem<'_>,
    state: &State,
    changes: &DMatrix<f64>,
    weights: &DVector<f64>,
    own: &DMatrix<f64>,
) -> [DMatrix<f64>; 2] {
    let mut jacobian = Dense::new(problem, state).jacobian;
    let surfels = of_surfels(problem);
    let a = jacobian.columns_range(surfels.clone()).into_owned();
    jacobian.columns_range_mut(surfels).fill(0.0);
    let along = jacobian * changes;
    let weighted = DMatrix::from_diagonal(weights) * &along;
    let mixed = a.tr_mul(&weighted);
    let before = along.tr_mul(&weighted);
    let after = &before - mixed.tr_mul(&(own * &mixed));
    [before, after]
}

fn of_surfels(problem: &JointProblem<'_>) -> std::ops::Range<usize> {
    let layout = &problem.layout;
    problem.offset(layout.first_surfel)..problem.offset(layout.first_patch)
}

#[test]
fn noise_of_slopes_is_what_noise_adds_to_the_normal_matrix() {
    for (name, case) in Case::all() {
        let input = case.input();
        let (problem, state) = case.problem_with_plane(&input);
        let dense = Dense::new(&problem, &state);
        // What follows changes of three parameters of the mountings.
        let covariance = inverse(&dense.h());
        let first = problem.offset(problem.layout.mountings[0]);
        let mut changes = covariance.columns(first + 2, 3).into_owned();
        for mut change in changes.column_iter_mut() {
            change /= change.amax();
        }
        let a = dense.jacobian.columns_range(of_surfels(&problem));
        let normal = a.tr_mul(&(DMatrix::from_diagonal(&dense.weights) * a));
        let own = inverse(&normal);
        let surfels = &problem.association.surfels;
        // What is assumed has no noise, unless it is a plane.
        let is_noisy = |row: usize| {
            let surfel = a.row(row).transpose().iamax() / 3;
            dense.groups[row] != problem.groups.assumed || surfels[surfel].assumed.plane.is_some()
        };
        let noisy = (0..a.nrows()).map(|row| f64::from(is_noisy(row)) * dense.weights[row]);
        let noisy = DMatrix::from_diagonal(&DVector::from_iterator(a.nrows(), noisy));
        let of_noise = &own * a.tr_mul(&(noisy * a)) * &own;
        // The matrix is a sum over surfels and quadratic in their slopes, so second differences are exact, and may be
        // those of all surfels at once.
        let at = |shapes: &dyn Fn(usize) -> [f64; 2]| {
            let mut state = state.clone();
            for (surfel, shape) in state.shapes.iter_mut().enumerate() {
                let [b, c] = shapes(surfel);
                shape.y += b;
                shape.z += c;
            }
            eliminated(&problem, &state, &changes, &dense.weights, &own)
        };
        let [before, here] = at(&|_| [0.0; 2]);
        let mut expected = DMatrix::zeros(3, 3);
        for column in 0..2 {
            let step = |surfel: usize| {
                let e = of_noise.fixed_view::<2, 2>(3 * surfel + 1, 3 * surfel + 1);
                let root = e.into_owned().cholesky().expect("positive definite").l();
                [root[(0, column)], root[(1, column)]]
            };
            let [_, up] = at(&step);
            let [_, down] = at(&|surfel| step(surfel).map(|x| -x));
            expected += (up + down) * 0.5 - &here;
        }
        let computed = problem.noise_of_slopes(&state, &changes);
        let off = (computed - &expected).amax() / expected.amax();
        // Differences of larger sums lose digits, and so does the inverse where a strip of points hardly holds a slope.
        let lost = normal.diagonal().component_mul(&own.diagonal()).max();
        let allowed = 100.0 * f64::EPSILON * lost * before.amax() / expected.amax();
        println!("{name}: off {off:e} of 1, allowed {allowed:e}");
        assert!(off < allowed && allowed < 1e-4, "{name}: {off:e}");
    }
}

/// Points are sorted with poses and mountings that are not yet right, and so are the normals of planes.
#[test]
fn nothing_depends_on_the_normal_that_a_plane_had_when_points_were_sorted() {
    let case = Case::plain();
    let input = case.input();
    let (mut problem, state) = case.problem_with_plane(&input);
    let step = |problem: &JointProblem<'_>| {
        let dense = Dense::new(problem, &state);
        let covariance = inverse(&dense.h());
        (
            &covariance * dense.g(),
            covariance.diagonal().map(f64::sqrt),
        )
    };
    let (before, sigma) = step(&problem);
    let turn = exp(&Vec3::new(1e-3, -2e-3, 0.0));
    let [plane] = &mut problem.association.planes[..] else {
        panic!("one plane");
    };
    plane.axes = plane.axes.map(|axis| turn * axis);
    let (after, _) = step(&problem);
    let moved = (after - before).component_div(&sigma);
    let place = problem.offset(problem.layout.first_plane);
    for (unknown, moved) in moved.iter().enumerate() {
        let is_plane = (place..place + 2).contains(&unknown);
        // To first order in a turn of 2 mrad.
        assert!(is_plane || moved.abs() < 1e-3, "{unknown}: {moved}");
    }
    assert!(moved.rows(place, 2).amax() > 0.1, "the plane turned");
}

/// Variances of the mountings over those of the normal equations, and over those of initial values; noise of scans is
/// multiplied by `factor`.
fn variances(factor: f64) -> (f64, f64) {
    let case = Case::plain();
    let input = case.input();
    let (mut problem, mut state) = case.problem(&input);
    problem.fit_shapes(&mut state);
    problem
        .groups
        .scale
        .iter_mut()
        .for_each(|scale| *scale *= factor);
    problem.factorise(&state).expect("positive definite");
    let layout = &problem.layout;
    let first = problem.offset(layout.mountings[0]);
    let size = problem.unknowns() - first;
    let covariance = inverse(&Dense::new(&problem, &state).h());
    let covariance = covariance.view((first, first), (size, size)).into_owned();
    let mut with_noise = covariance.clone();
    let mountings = Followed::of(&problem, &state).expect("positive definite");
    for side in problem.sides_of_slopes(&state, &mountings) {
        let side = DVector::from_column_slice(&side[first..]);
        with_noise += &side * side.transpose();
    }
    let larger = with_noise.diagonal().component_div(&covariance.diagonal());
    let [shift_m, turn_rad] = INITIAL_SIGMA;
    let initial = [turn_rad, turn_rad, turn_rad, shift_m, shift_m, shift_m];
    let sigmas = with_noise.diagonal().map(f64::sqrt);
    let of_initial = sigmas.iter().zip(initial.iter().cycle());
    let of_initial = of_initial.map(|(sigma, initial)| sigma / initial);
    (larger.max(), of_initial.fold(0.0, f64::max))
}

#[test]
fn slopes_of_precise_scans_add_nothing_and_those_of_noise_leave_the_initial_values() {
    let (larger, of_initial) = variances(0.1);
    assert!(larger < 1.01 && of_initial < 0.1, "{larger}, {of_initial}");
    // Noise of 30 times as much makes slopes of several tenths out of those of a tenth.
    let (larger, of_initial) = variances(30.0);
    assert!(larger > 2.0, "{larger}");
    // The limit holds along each direction; a parameter has parts of several.
    assert!((0.9..1.2).contains(&of_initial), "{of_initial}");
}
