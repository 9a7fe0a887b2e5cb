//! How much places on the ground contradict each other, as in [two steps](crate::calibration::places).
//!
//! The normal equations take rows as independent, but what surfels do not follow, such as leaves, edges, relief that passes
//! see differently or a frame that bends, moves neighbouring rows alike. In coordinates in which the normal equations know
//! the mountings to a standard deviation of one, while everything else follows them, the rows of a place have the
//! information I and the gradient g. Without this place the mountings move by
//!
//!   (1 − I)⁻¹ g
//!
//! (jackknife), of which the covariance is at most (1 − I)⁻¹ I (1 − I)⁻¹ if rows are independent.

use nalgebra::{DMatrix, DVector};

use super::followed::Followed;
use super::problem::JointProblem;
use super::state::State;
use crate::calibration::places::{lacking, numbered};
use crate::geometry::Vec3;

/// What the rows of a place say, in the coordinates above.
#[derive(Clone)]
pub(super) struct Place {
    pub information: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

impl JointProblem<'_> {
    /// Changes of all unknowns whose squares the covariance lacks because places contradict each other beyond chance. Along
    /// each direction of the mountings, the variance is at most that of initial values.
    pub fn sides_of_places(&self, state: &State, mountings: &Followed) -> Vec<Vec<f64>> {
        let places = self.places_along(state, &mountings.changes);
        let lacking = contradictions(&places, mountings.changes.ncols());
        let sides = lacking.into_iter().flatten();
        let sides = sides.filter_map(|vector| {
            let length = vector.norm();
            let direction = vector / length;
            let most = mountings.of_initial(&direction).powi(-2);
            mountings.side(&direction, (1.0 + length * length).min(most))
        });
        sides.collect()
    }

    /// What each place says about these changes of all unknowns.
    pub(super) fn places_along(&self, state: &State, changes: &DMatrix<f64>) -> Vec<Place> {
        let surfels = &self.association.surfels;
        let centres_m: Vec<Vec3> = surfels.iter().map(|surfel| surfel.centre_m).collect();
        let sizes_m = surfels.iter().map(|surfel| surfel.size_m);
        let number = numbered(&centres_m, sizes_m.fold(0.0, f64::max));
        let size = changes.ncols();
        let empty = Place {
            information: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
        };
        let mut places = vec![empty; number.iter().max().map_or(0, |last| last + 1)];
        let first = self.offset(self.layout.first_surfel);
        for row in self.rows_of_surfels(state, changes) {
            let place = &mut places[number[row.surfel]];
            let of_surfel = changes.rows(first + 3 * row.surfel, 3);
            let along = row.along + of_surfel.tr_mul(&row.by_shape);
            place.information.ger(row.weight, &along, &along, 1.0);
            let pull = row.weight * row.residual;
            place.gradient.axpy(pull, &along, 1.0);
        }
        places
    }
}

/// Vectors whose squares the covariance of so many coordinates, 1, lacks; `None` if there are none.
pub(super) fn contradictions(places: &[Place], size: usize) -> Option<Vec<DVector<f64>>> {
    let mut expected = DMatrix::zeros(size, size);
    let (mut sum, mut squares) = (0.0, 0.0);
    let mut moved = Vec::with_capacity(places.len());
    for place in places {
        let without = DMatrix::identity(size, size) - &place.information;
        let without = without.cholesky()?.inverse();
        expected += &without * &place.information * &without;
        moved.push(&without * &place.gradient);
        let trace = place.information.trace();
        (sum, squares) = (sum + trace, squares + trace * trace);
    }
    // Where a place alone sees a direction, it moves far without it.
    let mut eigen = expected.symmetric_eigen();
    eigen.eigenvalues.apply(|value| *value = value.max(1.0));
    // So many places that see the same amount vary as much as these.
    lacking(&eigen.recompose(), &moved, sum * sum / squares)
}
