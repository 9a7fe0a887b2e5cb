//! What noise of the surfels' slopes pretends to know of the mountings.
//!
//! The slopes (b, c) of a surfel are estimated from the same noisy rows. Along a direction in which points slide over
//! the ground, the derivatives of rows, −b ∂ū/∂x − c ∂v̄/∂x, differ from zero by this noise alone: the normal matrix then
//! holds the squares of noise, which say nothing about the mounting (errors in variables).

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::followed::Followed;
use super::problem::JointProblem;
use super::state::State;
use crate::geometry::{Mat3, Vec3};

/// A row of a surfel, of scans or of the reference.
pub(super) struct SurfelRow {
    pub surfel: usize,
    pub weight: f64,
    /// Standard deviations.
    pub residual: f64,
    /// Derivatives by (a, b, c).
    pub by_shape: Vec3,
    /// Derivatives along changes of all unknowns but the surfel's.
    pub along: DVector<f64>,
}

impl JointProblem<'_> {
    /// Changes of all unknowns whose squares the covariance lacks because slopes are noisy.
    ///
    /// With the covariance L Lᵀ of the mountings (δφ, δp), everything else follows a change L y of them as it fits best.
    /// The normal equations then hold the information I about y. Of it N = Q diag(μ) Qᵀ is noise
    /// ([`Self::noise_of_slopes`]), which does not hold the mountings, but moves them: with the information 1 − μ and a
    /// gradient of variance 1, the variance is 1/(1 − μ)² times that of the normal equations (Fuller 1987, Measurement
    /// Error Models, section 1.3). Along each direction it is at most that of the initial values.
    pub fn sides_of_slopes(&self, state: &State, mountings: &Followed) -> Vec<Vec<f64>> {
        let eigen = SymmetricEigen::new(self.noise_of_slopes(state, &mountings.changes));
        let directions = eigen.eigenvectors.column_iter();
        let shares = eigen.eigenvalues.iter().zip(directions);
        let sides = shares.filter_map(|(share, q)| {
            let left = (1.0 - share).max(mountings.of_initial(&q.into_owned()));
            mountings.side(&q.into_owned(), left.powi(-2))
        });
        sides.collect()
    }

    /// The expectation of what noise of slopes adds to the normal matrix along these changes of all unknowns: the sum over
    /// surfels of Σ E_st D_sᵀ (1 − A C Aᵀ) D_t over both slopes s and t, with the derivatives A of rows by (a, b, c), C =
    /// (AᵀA + P)⁻¹ with what is assumed about them, the covariance E = C AᵀA C of their noise (C if what is assumed is a
    /// plane, whose slopes have noise themselves), and the derivatives D_s of the rows along the changes, differentiated by s.
    pub(super) fn noise_of_slopes(&self, state: &State, changes: &DMatrix<f64>) -> DMatrix<f64> {
        let rows = self.rows_of_surfels(state, changes);
        // Derivatives are linear in the slopes.
        let by_slopes = [Vec3::y(), Vec3::z()].map(|slope| {
            let mut sloped = state.clone();
            sloped.shapes.iter_mut().for_each(|shape| *shape += slope);
            let sloped = self.rows_of_surfels(&sloped, changes).into_iter();
            let by_slope = sloped
                .zip(&rows)
                .map(|(sloped, row)| sloped.along - &row.along);
            by_slope.collect::<Vec<_>>()
        });
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by_key(|&row| rows[row].surfel);
        let count = changes.ncols();
        let mut noise = DMatrix::zeros(count, count);
        for of_surfel in order.chunk_by(|&a, &b| rows[a].surfel == rows[b].surfel) {
            let squares = of_surfel.iter().map(|&row| {
                let by = rows[row].by_shape;
                rows[row].weight * by * by.transpose()
            });
            let squares: Mat3 = squares.sum();
            let surfel = &self.association.surfels[rows[of_surfel[0]].surfel];
            let assumed = match surfel.prior {
                None => surfel.assumed.information(),
                Some(_) => Vec3::zeros(),
            };
            let Some(c) = (squares + Mat3::from_diagonal(&assumed)).try_inverse() else {
                continue;
            };
            let e = if surfel.assumed.plane.is_some() {
                c
            } else {
                c * squares * c
            };
            let e = e.fixed_view::<2, 2>(1, 1).into_owned();
            let Some(e) = e.cholesky() else {
                continue;
            };
            for of_noise in e.l().column_iter() {
                let mut mixed = DMatrix::zeros(count, 3);
                for &row in of_surfel {
                    let weight = rows[row].weight;
                    let d = &by_slopes[0][row] * of_noise[0] + &by_slopes[1][row] * of_noise[1];
                    noise.ger(weight, &d, &d, 1.0);
                    mixed.ger(weight, &d, &rows[row].by_shape, 1.0);
                }
                noise -= &mixed * c * mixed.transpose();
            }
        }
        noise
    }

    /// The rows that touch a surfel, but for what is assumed about it.
    pub(super) fn rows_of_surfels(&self, state: &State, changes: &DMatrix<f64>) -> Vec<SurfelRow> {
        let first = self.offset(self.layout.first_surfel);
        let surfels = first..first + 3 * self.association.surfels.len();
        let (mut rows, mut places) = (Vec::new(), Vec::new());
        self.visit(state, |batch| {
            for row in batch.rows().filter(|row| row.group != self.groups.assumed) {
                let mut surfel = None;
                let mut by_shape = Vec3::zeros();
                let mut along = DVector::zeros(changes.ncols());
                self.places(&row, &mut places);
                for (&place, &by) in places.iter().zip(row.by) {
                    if surfels.contains(&place) {
                        surfel = Some((place - first) / 3);
                        by_shape[(place - first) % 3] = by;
                    } else {
                        let changes = changes.row(place);
                        along
                            .iter_mut()
                            .zip(&changes)
                            .for_each(|(x, c)| *x += by * c);
                    }
                }
                rows.extend(surfel.map(|surfel| SurfelRow {
                    surfel,
                    weight: row.weight,
                    residual: row.residual,
                    by_shape,
                    along,
                }));
            }
        });
        rows
    }
}
