//! Thickness of the neighbourhoods, its gradient and a positive semidefinite normal matrix.
//!
//! With λ₁ ≥ λ₂ ≥ λ₃ the eigenvalues of a neighbourhood's structure tensor C, the paper minimises
//! Σσ² over the omnivariances σ = (λ₁ λ₂ λ₃)^⅓ (its equation (6)). What is minimised here is Σ ln σ,
//! changed in two ways that simulated drives with known truth demand:
//!
//! - The squares give the rough soil, where σ is large, most of the weight; what soil looks like
//!   depends on where it is seen from, and with exact poses this alone costs 2 mm and 0.1°. The
//!   logarithm weighs each neighbourhood by its own scatter, as maximum likelihood does for
//!   distances of unknown variance, and ends within 0.01 mm and 0.001°.
//! - While a neighbourhood's members stay fixed, λ₁ and λ₂ only say how far points slide along the
//!   surface, which the next search undoes. They would hold the scanners where they are and draw the
//!   edges of clouds onto each other, so they are left out: ln σ = ⅓ ln λ₃ + what is held.
//!
//! So the cost is
//!
//!   Σ ln(λ₃ + s²)
//!
//! with s the thickness below which flatness says nothing about alignment, since points of one pass
//! alone are that flat. With the normal n, dλ₃ = nᵀ dC n, and the weight w = 1/(λ₃ + s²) frozen at
//! the current parameters, the weighted scatter w/k Σ (n·(x_j − x̄))² has the same gradient
//!
//!   g = 2w/k Σ_j a_j n·(x_j − x̄)
//!
//! and the Gauss-Newton matrix
//!
//!   H = 2w/k (Σ_j a_j a_jᵀ − k ā āᵀ),
//!
//! with a_j = ∂(n·x_j)/∂θ (zero for reference points) and ā their mean: reweighted least squares of
//! distances to local planes.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};
use rayon::prelude::*;

use super::neighbourhoods::{Neighbourhoods, Placed, ScaleCloud};
use crate::cloud::StructureTensor;
use crate::geometry::Vec3;

/// Neighbourhoods a parallel task works on; sums run over tasks in order, so that results do not
/// depend on the number of threads.
const CHUNK: usize = 2048;

/// The normal equations at given mountings.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// Σ ln(λ₃ + s²), lengths in metres.
    pub cost: f64,
    /// ∂cost/∂θ, 6 a scanner: (δt, δψ) in body axes.
    pub gradient: DVector<f64>,
    /// Gauss-Newton matrix, 6 s × 6 s.
    pub matrix: DMatrix<f64>,
    /// Its diagonal before the means are taken off, 2w/k Σ a_j²: what the points would say of each
    /// parameter if the planes stood still.
    pub uncentred: DVector<f64>,
}

/// The plane of a neighbourhood and its weight.
#[derive(Debug, Clone, Copy)]
pub struct LocalPlane {
    /// x̄, metres.
    pub mean: Vec3,
    /// Unit normal, of either sign.
    pub normal: Vec3,
    /// λ₃ + s², m².
    pub variance: f64,
    /// 2w/k.
    pub weight: f64,
}

impl LocalPlane {
    /// The plane of neighbourhood `index`.
    pub fn of(
        cloud: &ScaleCloud,
        placed: &Placed,
        neighbourhoods: &Neighbourhoods,
        index: usize,
    ) -> Self {
        let members = neighbourhoods.of(index);
        let tensor = StructureTensor::of(&placed.world, members);
        let eigen = tensor.eigen();
        let variance = eigen.values.z + cloud.floor_m * cloud.floor_m;
        Self {
            mean: tensor.mean,
            normal: eigen.vectors.column(2).into(),
            variance,
            weight: 2.0 / (variance * members.len() as f64),
        }
    }

    /// a = ∂(n·x)/∂(δt, δψ) of the movable point `index`: (Rᵀn, v × Rᵀn) with R = R_mb, v = R_bs x_s.
    #[inline]
    pub fn derivative(&self, cloud: &ScaleCloud, placed: &Placed, index: usize) -> Vector6<f64> {
        let body = cloud.movable[index].world_from_body.tr_mul(&self.normal);
        let moment = placed.arm[index].cross(&body);
        Vector6::new(body.x, body.y, body.z, moment.x, moment.y, moment.z)
    }
}

/// Σ ln(λ₃ + s²) alone.
pub fn cost(cloud: &ScaleCloud, placed: &Placed, neighbourhoods: &Neighbourhoods) -> f64 {
    let partial: Vec<f64> = (0..neighbourhoods.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            chunk_range(chunk, neighbourhoods.len())
                .map(|index| {
                    let members = neighbourhoods.of(index);
                    let smallest = StructureTensor::of(&placed.world, members).eigen().values.z;
                    (smallest + cloud.floor_m * cloud.floor_m).ln()
                })
                .sum()
        })
        .collect();
    partial.iter().sum()
}

/// The cost, its gradient and the normal matrix.
pub fn normal_equations(
    cloud: &ScaleCloud,
    placed: &Placed,
    neighbourhoods: &Neighbourhoods,
) -> NormalEquations {
    let partial: Vec<NormalEquations> = (0..neighbourhoods.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut sums = Sums::new(cloud.scanners);
            for index in chunk_range(chunk, neighbourhoods.len()) {
                sums.add(cloud, placed, neighbourhoods, index);
            }
            sums.finish()
        })
        .collect();
    let size = 6 * cloud.scanners;
    let zero = NormalEquations {
        cost: 0.0,
        gradient: DVector::zeros(size),
        matrix: DMatrix::zeros(size, size),
        uncentred: DVector::zeros(size),
    };
    partial.into_iter().fold(zero, |mut total, part| {
        total.cost += part.cost;
        total.gradient += part.gradient;
        total.matrix += part.matrix;
        total.uncentred += part.uncentred;
        total
    })
}

fn chunk_range(chunk: usize, len: usize) -> std::ops::Range<usize> {
    chunk * CHUNK..((chunk + 1) * CHUNK).min(len)
}

/// Sums over the neighbourhoods of one task.
struct Sums {
    cost: f64,
    gradient: Vec<Vector6<f64>>,
    own: Vec<Matrix6<f64>>,
    matrix: DMatrix<f64>,
    derivative: Vec<Vector6<f64>>,
}

impl Sums {
    fn new(scanners: usize) -> Self {
        Self {
            cost: 0.0,
            gradient: vec![Vector6::zeros(); scanners],
            own: vec![Matrix6::zeros(); scanners],
            matrix: DMatrix::zeros(6 * scanners, 6 * scanners),
            derivative: vec![Vector6::zeros(); scanners],
        }
    }

    fn add(
        &mut self,
        cloud: &ScaleCloud,
        placed: &Placed,
        neighbourhoods: &Neighbourhoods,
        index: usize,
    ) {
        let plane = LocalPlane::of(cloud, placed, neighbourhoods, index);
        self.cost += plane.variance.ln();
        self.derivative.fill(Vector6::zeros());
        let members = neighbourhoods.of(index);
        for &member in members {
            let member = member as usize;
            let Some(point) = cloud.movable.get(member) else {
                continue;
            };
            let scanner = point.scanner as usize;
            let derivative = plane.derivative(cloud, placed, member);
            let weighted = derivative * plane.weight;
            let own = &mut self.own[scanner];
            for column in 0..6 {
                for row in 0..=column {
                    own[(row, column)] += weighted[row] * derivative[column];
                }
            }
            let residual = plane.normal.dot(&(placed.world[member] - plane.mean));
            self.gradient[scanner] += weighted * residual;
            self.derivative[scanner] += derivative;
        }
        // −k ā āᵀ · 2w/k, where `derivative` holds k ā of each scanner.
        let factor = plane.weight / members.len() as f64;
        for a in 0..cloud.scanners {
            let weighted = self.derivative[a] * factor;
            for b in a..cloud.scanners {
                let mut block = self.matrix.fixed_view_mut::<6, 6>(6 * a, 6 * b);
                block -= weighted * self.derivative[b].transpose();
            }
        }
    }

    fn finish(mut self) -> NormalEquations {
        let scanners = self.gradient.len();
        let diagonals = self.own.iter().flat_map(|own| own.diagonal().data.0[0]);
        let uncentred = DVector::from_iterator(6 * scanners, diagonals);
        for (scanner, own) in self.own.iter_mut().enumerate() {
            own.fill_lower_triangle_with_upper_triangle();
            let mut block = self.matrix.fixed_view_mut::<6, 6>(6 * scanner, 6 * scanner);
            block += &*own;
        }
        for row in 0..6 * scanners {
            for column in 0..row {
                self.matrix[(row, column)] = self.matrix[(column, row)];
            }
        }
        let entries = self
            .gradient
            .iter()
            .flat_map(|gradient| gradient.iter().copied());
        let gradient = DVector::from_iterator(6 * scanners, entries);
        NormalEquations {
            cost: self.cost,
            gradient,
            matrix: self.matrix,
            uncentred,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::neighbourhoods::find;
    use crate::calibration::parameters::moved;
    use crate::calibration::small_case::case;
    use crate::geometry::so3;

    #[test]
    fn the_gradient_meets_finite_differences() {
        let (cloud, mountings) = case();
        let placed = cloud.place(&mountings);
        let neighbourhoods = find(&cloud, &placed, 20, 1);
        let equations = normal_equations(&cloud, &placed, &neighbourhoods);
        assert!(
            (equations.cost - cost(&cloud, &placed, &neighbourhoods)).abs()
                < 1e-12 * equations.cost.abs()
        );
        let scale = equations.gradient.amax();
        for parameter in 0..12 {
            // Central differences of 1e-6 on a cost of order 1 are good to about 1e-9.
            let at = |step: f64| {
                let mut delta = DVector::zeros(12);
                delta[parameter] = step;
                cost(
                    &cloud,
                    &cloud.place(&moved(&mountings, &delta)),
                    &neighbourhoods,
                )
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            let error = (numeric - equations.gradient[parameter]).abs();
            assert!(
                error < 1e-7 * scale,
                "parameter {parameter}: {error:e} of {scale:e}"
            );
        }
    }

    #[test]
    fn the_normal_matrix_is_the_definition_summed_point_by_point() {
        let (cloud, mountings) = case();
        let placed = cloud.place(&mountings);
        let neighbourhoods = find(&cloud, &placed, 20, 3);
        let fast = normal_equations(&cloud, &placed, &neighbourhoods);
        let mut slow = DMatrix::zeros(12, 12);
        for index in 0..neighbourhoods.len() {
            let members = neighbourhoods.of(index);
            let tensor = StructureTensor::of(&placed.world, members);
            let eigen = tensor.covariance.symmetric_eigen();
            let smallest = eigen.eigenvalues.imin();
            let normal = eigen.eigenvectors.column(smallest).into_owned();
            let variance = eigen.eigenvalues[smallest];
            let weight = normal * normal.transpose() / (variance + cloud.floor_m.powi(2));
            let derivatives: Vec<DMatrix<f64>> = members
                .iter()
                .map(|&member| {
                    let mut full = DMatrix::zeros(3, 12);
                    if let Some(point) = cloud.movable.get(member as usize) {
                        let at = 6 * point.scanner as usize;
                        let arm = so3::hat(&placed.arm[member as usize]);
                        full.view_mut((0, at), (3, 3))
                            .copy_from(&point.world_from_body);
                        let turned = -(point.world_from_body * arm);
                        full.view_mut((0, at + 3), (3, 3)).copy_from(&turned);
                    }
                    full
                })
                .collect();
            let mean = derivatives
                .iter()
                .fold(DMatrix::zeros(3, 12), |sum, d| sum + d)
                / members.len() as f64;
            for derivative in &derivatives {
                let centred = derivative - &mean;
                slow += centred.transpose() * weight * &centred * (2.0 / members.len() as f64);
            }
        }
        // Two eigenvalue solvers differ by some roundings times the eigenvalues' ratio.
        assert!((&fast.matrix - &slow).amax() < 1e-10 * slow.amax());
    }
}
