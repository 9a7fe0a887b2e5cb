//! How much places on the ground contradict each other.
//!
//! The [covariance](super::uncertainty) of the gradient takes the scatter of points as independent from point to point.
//! But leaves, edges and relief that passes see differently, and a frame that bends, move the points of whole
//! neighbourhoods alike, so that places contradict each other. At the minimum the gradients g_b of places b cancel. If
//! places err independently, the covariance of their sum is
//!
//!   S = Σ_b g_b g_bᵀ,
//!
//! whatever the errors are (White 1980; by clusters: Liang and Zeger 1986). S does not see what all places have in
//! common, such as errors of the poses that last; the modelled covariance C does. So along each direction the larger of
//! the two holds. By chance alone, the eigenvalues of C⁻¹ S for p parameters and n places reach (1 + √(p/n))² (Marchenko
//! and Pastur 1967): only larger ones count.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector};

use super::cost::{add_gradient, in_parts};
use crate::surface::Surface;

/// Fewest places: several for each of the 24 parameters of four scanners.
const PLACES: usize = 64;

/// A cell of a cubic grid.
type Cell = [i64; 3];

/// The gradients of cells.
type Cells = BTreeMap<Cell, DVector<f64>>;

/// The gradients of places as large as leaves at least [`PLACES`] of them, and at least `edge_m` wide.
pub fn gradients(surface: &Surface, floor_m: f64, edge_m: f64) -> Vec<DVector<f64>> {
    let zero = || DVector::zeros(6 * surface.cloud.scanners);
    let parts = in_parts(surface, Cells::new, |cells: &mut Cells, index| {
        let mean_m = surface.planes[index].mean_m;
        let cell = [mean_m.x, mean_m.y, mean_m.z].map(|x| (x / edge_m).floor() as i64);
        let gradient = cells.entry(cell).or_insert_with(zero);
        add_gradient(surface, floor_m, index, gradient);
    });
    let mut cells = merged(parts.into_iter().flatten());
    loop {
        let doubled = cells.iter();
        let doubled = doubled.map(|(cell, g)| (cell.map(|x| x.div_euclid(2)), g.clone()));
        let wider = merged(doubled);
        if wider.len() < PLACES || wider.len() == cells.len() {
            return cells.into_values().collect();
        }
        cells = wider;
    }
}

/// Sums the gradients of equal cells.
fn merged(all: impl Iterator<Item = (Cell, DVector<f64>)>) -> Cells {
    let mut cells = Cells::new();
    for (cell, gradient) in all {
        match cells.get_mut(&cell) {
            Some(sum) => *sum += gradient,
            None => {
                cells.insert(cell, gradient);
            }
        }
    }
    cells
}

/// The modelled covariance of the gradient, or along each direction what the `gradients` of places say if it is larger
/// beyond chance; `None` without places or if the modelled one is not positive definite.
pub fn at_least(modelled: &DMatrix<f64>, gradients: &[DVector<f64>]) -> Option<DMatrix<f64>> {
    let size = modelled.nrows();
    if size == 0 || gradients.is_empty() {
        return None;
    }
    let factor = Cholesky::new(modelled.clone())?.unpack();
    let mut ratio = DMatrix::zeros(size, size);
    for gradient in gradients {
        let whitened = factor.solve_lower_triangular(gradient)?;
        ratio.ger(1.0, &whitened, &whitened, 1.0);
    }
    let chance = (1.0 + (size as f64 / gradients.len() as f64).sqrt()).powi(2);
    let mut eigen = ratio.symmetric_eigen();
    for value in eigen.eigenvalues.iter_mut() {
        *value = if *value > chance { *value } else { 1.0 };
    }
    Some(&factor * eigen.recompose() * factor.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::cost::normal_equations;
    use crate::calibration::small_case::{FLOOR_M, case, surface};

    #[test]
    fn the_gradients_of_places_sum_to_that_of_all() {
        let (cloud, mountings) = case();
        let surface = surface(cloud, &mountings, 1);
        let all = normal_equations(&surface, FLOOR_M).gradient;
        let places = gradients(&surface, FLOOR_M, 0.1);
        let sum = places
            .iter()
            .fold(DVector::zeros(12), |sum, gradient| sum + gradient);
        assert!((sum - &all).amax() < 1e-9 * all.amax());
        // The case is 2 m wide: cells of 0.2 m are 100 and more, of 0.4 m fewer than 64.
        assert!(
            (PLACES..4 * PLACES).contains(&places.len()),
            "{}",
            places.len()
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
        let with = |sums| at_least(&modelled, &places(128, sums)).unwrap();
        assert!((with([4.0 * 1.2, 0.1]) - &modelled).amax() < 1e-12);
        let larger = with([4.0 * 1.5, 0.1]);
        assert!((larger[(0, 0)] - 6.0).abs() < 1e-12 && (larger[(1, 1)] - 9.0).abs() < 1e-12);
        assert_eq!(
            at_least(&DMatrix::zeros(2, 2), &places(128, [1.0, 1.0])),
            None
        );
    }
}
