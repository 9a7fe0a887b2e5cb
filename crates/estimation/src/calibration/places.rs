//! How much places on the ground contradict each other.
//!
//! The [covariance](super::uncertainty) of the gradient takes the scatter of points as independent from point to point.
//! But leaves, edges and relief that passes see differently, and a frame that bends, move the points of whole
//! neighbourhoods alike, so that places contradict each other. At the minimum the gradients g_b of places b cancel. If
//! places err independently, the covariance of their sum is
//!
//!   S = Σ_b g_b g_bᵀ,
//!
//! whatever the errors are (White 1980; by clusters: Liang and Zeger 1986). A place that alone sees a direction cancels
//! there by itself, as if it were sure. So in place of g_b stands what it amounts to for the estimate without this place
//! (jackknife), which initial values with the information P hold where no other place sees:
//!
//!   H [(H − H_b + P)⁻¹ (g_b − P δ) + (H + P)⁻¹ P δ]
//!
//! with the normal matrices H of all and H_b of the place, and the change δ from initial values. S does not see what all
//! places have in common, such as errors of the poses that last; the modelled covariance C does. So along each direction
//! the larger of the two holds. By chance alone, the eigenvalues of C⁻¹ S for p parameters and n places reach
//! (1 + √(p/n))² (Marchenko and Pastur 1967): only larger ones count.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Cholesky, DMatrix, DVector};

use super::cost::{NormalEquations, Sums, in_parts, weight};
use super::settings::initial_sigma;
use crate::geometry::Vec3;
use crate::surface::Surface;

/// Fewest places: several for each of the 24 parameters of four scanners.
const PLACES: usize = 64;

/// A cell of a cubic grid.
type Cell = [i64; 3];

/// The place of each point, by number: cubes as large as leaves at least [`PLACES`] of them, and at least `edge_m` wide.
pub(crate) fn numbered(points_m: &[Vec3], edge_m: f64) -> Vec<usize> {
    let cell =
        |point: &Vec3| -> Cell { [point.x, point.y, point.z].map(|x| (x / edge_m).floor() as i64) };
    let numbers = |cells: &[Cell]| -> BTreeMap<Cell, usize> {
        let distinct: BTreeSet<Cell> = cells.iter().copied().collect();
        distinct.into_iter().zip(0..).collect()
    };
    let mut cells: Vec<Cell> = points_m.iter().map(cell).collect();
    let mut number = numbers(&cells);
    loop {
        let wider = cells.iter().map(|cell| cell.map(|x| x.div_euclid(2)));
        let wider: Vec<Cell> = wider.collect();
        let number_of_wider = numbers(&wider);
        if number_of_wider.len() < PLACES || number_of_wider.len() == number.len() {
            return cells.iter().map(|cell| number[cell]).collect();
        }
        (cells, number) = (wider, number_of_wider);
    }
}

/// The normal equations of places at least `edge_m` wide.
pub fn equations(surface: &Surface, floor_m: f64, edge_m: f64) -> Vec<NormalEquations> {
    let means_m: Vec<Vec3> = surface.planes.iter().map(|plane| plane.mean_m).collect();
    let place = numbered(&means_m, edge_m);
    let add = |places: &mut BTreeMap<usize, Sums>, index: usize| {
        let place = places.entry(place[index]);
        let plane = &surface.planes[index];
        let weight = weight(plane, floor_m, surface.neighbourhoods.k());
        let place = place.or_insert_with(|| Sums::new(surface.cloud.scanners));
        place.add(surface, index, &plane.normal, weight);
    };
    let mut places = BTreeMap::<usize, Vec<NormalEquations>>::new();
    for part in in_parts(surface, BTreeMap::new, add) {
        for (place, sums) in part {
            places.entry(place).or_default().push(sums.finish());
        }
    }
    let size = 6 * surface.cloud.scanners;
    let places = places.values();
    places
        .map(|parts| NormalEquations::sum(size, parts))
        .collect()
}

/// What each place contradicts the estimate without it, as a gradient in coordinates of `basis`, given the normal matrix
/// of all and the change (δp, δφ) from initial values; `None` if that matrix is not positive definite.
pub fn contradictions(
    places: &[NormalEquations],
    matrix: &DMatrix<f64>,
    basis: &DMatrix<f64>,
    change: &DVector<f64>,
) -> Option<Vec<DVector<f64>>> {
    // The cost is twice the negative logarithm of a likelihood.
    let initial = DVector::from_fn(matrix.nrows(), |row, _| 2.0 / initial_sigma(row).powi(2));
    let reduced = |matrix: &DMatrix<f64>| basis.transpose() * matrix * basis;
    let prior = DMatrix::from_diagonal(&initial);
    let back = initial.component_mul(change);
    let all = reduced(matrix);
    let count = places.len() as f64;
    let with_prior = |matrix: &DMatrix<f64>| Cholesky::new(reduced(&(matrix + &prior)));
    let pulled = with_prior(matrix)?.solve(&(basis.transpose() * &back));
    let contradiction = |place: &NormalEquations| {
        let others = with_prior(&(matrix - &place.matrix))?;
        let without = others.solve(&(basis.transpose() * (&place.gradient - &back)));
        Some(&all * (without + &pulled) * ((count - 1.0) / count).sqrt())
    };
    places.iter().map(contradiction).collect()
}

/// Vectors whose squares a modelled covariance lacks, since those of these vectors, one of each place, sum up to more along
/// some directions, beyond what chance makes of so many places that see alike; `None` without places or if the modelled
/// one is not positive definite.
pub(crate) fn lacking(
    modelled: &DMatrix<f64>,
    of_places: &[DVector<f64>],
    places: f64,
) -> Option<Vec<DVector<f64>>> {
    let size = modelled.nrows();
    if size == 0 || of_places.is_empty() {
        return None;
    }
    let factor = Cholesky::new(modelled.clone())?.unpack();
    let mut ratio = DMatrix::zeros(size, size);
    for vector in of_places {
        let whitened = factor.solve_lower_triangular(vector)?;
        ratio.ger(1.0, &whitened, &whitened, 1.0);
    }
    let chance = (1.0 + (size as f64 / places).sqrt()).powi(2);
    let eigen = ratio.symmetric_eigen();
    let directions = eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter());
    let beyond = directions.filter(|(value, _)| **value > chance);
    Some(
        beyond
            .map(|(value, q)| &factor * q * (value - 1.0).sqrt())
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::cost::normal_equations;
    use crate::calibration::small_case::{FLOOR_M, case, surface};

    #[test]
    fn the_equations_of_places_sum_to_those_of_all() {
        let (cloud, mountings) = case();
        let surface = surface(cloud, &mountings, 1);
        let all = normal_equations(&surface, FLOOR_M);
        let places = equations(&surface, FLOOR_M, 0.1);
        let sum = NormalEquations::sum(12, &places);
        assert!((sum.gradient - &all.gradient).amax() < 1e-9 * all.gradient.amax());
        assert!((sum.matrix - &all.matrix).amax() < 1e-9 * all.matrix.amax());
        // The case is 2 m wide: cells of 0.2 m are 100 and more, of 0.4 m fewer than 64.
        assert!(
            (PLACES..4 * PLACES).contains(&places.len()),
            "{}",
            places.len()
        );
    }

    /// A hundred places of which one alone sees that a scanner is 0.1 m off its initial value along x, and each, beside noise,
    /// that it is not off along y.
    #[test]
    fn a_place_that_no_other_confirms_counts_as_far_as_it_moved_the_mounting() {
        let place = |index: usize| {
            let mut equations = NormalEquations::zeros(6);
            equations.matrix.fill_with_identity();
            equations.matrix *= 1e6;
            equations.matrix[(0, 0)] *= f64::from(u8::from(index == 0));
            equations.gradient[1] = if index.is_multiple_of(2) { 30.0 } else { -30.0 };
            equations
        };
        let places: Vec<NormalEquations> = (0..100).map(place).collect();
        let matrix = NormalEquations::sum(6, &places).matrix;
        let change = DVector::from_fn(6, |row, _| if row == 0 { 0.1 } else { 0.0 });
        let basis = DMatrix::identity(6, 6);
        let all = contradictions(&places, &matrix, &basis, &change).unwrap();
        // In metres, and in the square root of the sum of squares of all places.
        let estimate = |axis: usize| {
            let each = all.iter().map(|c| (c[axis] / matrix[(axis, axis)]).powi(2));
            each.sum::<f64>().sqrt()
        };
        let jackknife = 0.99_f64.sqrt();
        assert!(
            (estimate(0) - 0.1 * jackknife).abs() < 1e-3,
            "{}",
            estimate(0)
        );
        // Ten times 30 by 99 millions.
        let expected = 10.0 * 30.0 / 99e6 * jackknife;
        assert!(
            (estimate(1) / expected - 1.0).abs() < 1e-3,
            "{}",
            estimate(1)
        );
    }

    /// Gradients of `count` places along two axes, of which the sums of squares are given.
    fn places(count: usize, sums: [f64; 2]) -> Vec<DVector<f64>> {
        let each = (0..count).map(|place| {
            let sign = if place % 2 == 0 { 1.0 } else { -1.0 };
            let mut gradient = DVector::zeros(2);
            // Half of the places along each axis.
            let axis = usize::from(place % 4 > 1);
            gradient[axis] = sign * (2.0 * sums[axis] / count as f64).sqrt();
            gradient
        });
        each.collect()
    }

    #[test]
    fn contradictions_count_where_they_exceed_the_model_beyond_chance() {
        let modelled = DMatrix::from_diagonal(&DVector::from_vec(vec![4.0, 9.0]));
        // Two parameters and 128 places: eigenvalues up to 1.27 are chance.
        let with = |sums| -> DMatrix<f64> {
            let lacking = lacking(&modelled, &places(128, sums), 128.0).unwrap();
            let squares = lacking.iter().map(|vector| vector * vector.transpose());
            squares.fold(modelled.clone(), |sum, square| sum + square)
        };
        assert!((with([4.0 * 1.2, 0.1]) - &modelled).amax() < 1e-12);
        let larger = with([4.0 * 1.5, 0.1]);
        assert!((larger[(0, 0)] - 6.0).abs() < 1e-12 && (larger[(1, 1)] - 9.0).abs() < 1e-12);
        assert_eq!(
            lacking(&DMatrix::zeros(2, 2), &places(128, [1.0, 1.0]), 128.0),
            None
        );
    }
}
