//! What places say of the mountings, against dense matrices.

use nalgebra::{DMatrix, DVector};

use super::case::Case;
use super::rows::{Dense, assert_identity};
use crate::joint::followed::Followed;
use crate::joint::places::{Place, contradictions};

#[test]
fn places_say_what_the_rows_of_their_surfels_say() {
    for (name, case) in Case::all() {
        let input = case.input();
        let (mut problem, state) = case.problem_with_plane(&input);
        problem.factorise(&state).expect("positive definite");
        let followed = Followed::of(&problem, &state).expect("positive definite");
        let dense = Dense::new(&problem, &state);
        let along = &dense.jacobian * &followed.changes;
        let weighted = DMatrix::from_diagonal(&dense.weights) * &along;
        // All rows together know the changes to a standard deviation of one each.
        assert_identity(name, &along.tr_mul(&weighted));

        let layout = &problem.layout;
        let surfels = problem.offset(layout.first_surfel)..problem.offset(layout.first_patch);
        let of_surfels = dense.jacobian.columns_range(surfels);
        let rows = (0..of_surfels.nrows()).filter(|&row| {
            dense.groups[row] != problem.groups.assumed && of_surfels.row(row).amax() > 0.0
        });
        let rows: Vec<usize> = rows.collect();
        let information = along
            .select_rows(&rows)
            .tr_mul(&weighted.select_rows(&rows));
        let gradient = weighted
            .select_rows(&rows)
            .tr_mul(&dense.residuals.select_rows(&rows));
        let places = problem.places_along(&state, &followed.changes);
        assert!(places.len() > 20, "{name}: {} places", places.len());
        let size = gradient.len();
        let sum = places
            .iter()
            .fold(DMatrix::zeros(size, size), |sum, p| sum + &p.information);
        assert!(
            (sum - &information).amax() < 1e-9 * information.amax(),
            "{name}"
        );
        let sum = places
            .iter()
            .fold(DVector::zeros(size), |sum, p| sum + &p.gradient);
        let terms = weighted.abs().tr_mul(&dense.residuals.abs());
        assert!((sum - gradient).amax() < 1e-9 * terms.amax(), "{name}");
    }
}

/// A hundred places that each know a hundredth of two coordinates, of which the first pull by this many standard deviations
/// of their gradients.
fn places(pulls: impl Fn(usize) -> [f64; 2]) -> Vec<Place> {
    let place = |index| Place {
        information: DMatrix::identity(2, 2) * 0.01,
        gradient: DVector::from_row_slice(&pulls(index)) * 0.1,
    };
    (0..100).map(place).collect()
}

fn alternating(index: usize) -> f64 {
    if index.is_multiple_of(2) { 1.0 } else { -1.0 }
}

#[test]
fn variances_grow_by_what_places_contradict_each_other_beyond_chance() {
    let lacking = |pulls: &dyn Fn(usize) -> [f64; 2]| contradictions(&places(pulls), 2).unwrap();
    // Two coordinates and a hundred places: up to 1.3 is chance.
    assert!(lacking(&|i| [1.1 * alternating(i), 0.0]).is_empty());
    let of_first = lacking(&|i| [2.0 * alternating(i), 0.9 * alternating(i / 2)]);
    assert_eq!(of_first.len(), 1);
    // Without each place, there are 0.99 of the information: both the estimate and what is expected of it are larger.
    let expected = 3.0 / 0.99_f64.powi(2);
    let found = of_first[0].map(|x| x * x);
    assert!(
        (found[0] - expected).abs() < 0.05 && found[1] < 1e-3,
        "{found}"
    );
}

#[test]
fn a_place_that_alone_sees_a_direction_does_not_contradict_others_by_chance() {
    let mut all = places(|_| [0.0, 0.0]);
    for place in &mut all {
        place.information[(0, 0)] = 1e-6;
    }
    all[0].information[(0, 0)] = 0.9;
    // One standard deviation of its gradient, and without it ten of the estimate.
    all[0].gradient[0] = 0.9_f64.sqrt();
    assert!(contradictions(&all, 2).unwrap().is_empty());
}
