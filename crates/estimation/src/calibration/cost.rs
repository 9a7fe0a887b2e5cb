//! The cost: thickness of the neighbourhoods, with its gradient and a positive semidefinite normal
//! matrix.
//!
//! With λ₁ ≥ λ₂ ≥ λ₃ the eigenvalues of a neighbourhood's structure tensor C, the paper minimises
//! Σσ² over the omnivariances σ = (λ₁ λ₂ λ₃)^⅓ (its equation (6)). Boresight minimises Σ ln σ
//! without λ₁ and λ₂. Both changes are motivated by simulated drives with known truth:
//!
//! - The squares give most of the weight to rough soil, where σ is large. The appearance of soil
//!   depends on the viewpoint, and with exact poses this alone causes errors of 2 mm and 0.1°. The
//!   logarithm weighs each neighbourhood by its own scatter, as maximum likelihood does for
//!   distances of unknown variance, and errors stay within 0.01 mm and 0.001°.
//! - While a neighbourhood's members stay fixed, λ₁ and λ₂ only measure how far points slide along
//!   the surface, which the next search undoes. They would keep the scanners from moving and pull
//!   the edges of clouds onto each other, so they are held constant: ln σ = ⅓ ln λ₃ + const.
//!
//! The cost is therefore
//!
//!   Σ ln(λ₃ + s²)
//!
//! with s the floor of the thickness: points of a single pass are that flat regardless of the
//! mountings. With the normal n, dλ₃ = nᵀ dC n. With the weight w = 1/(λ₃ + s²) held constant at
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

use crate::cloud::StructureTensor;
use crate::geometry::Vec3;
use crate::surface::{Plane, Row, Surface};

/// Neighbourhoods per parallel task. Sums run over tasks in order, so that results do not
/// depend on the number of threads.
const CHUNK: usize = 2048;

/// The normal equations at given mountings: six parameters (δp, δφ) per scanner.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// g = ∂cost/∂θ.
    pub gradient: DVector<f64>,
    /// H.
    pub matrix: DMatrix<f64>,
    /// Its diagonal before the means are subtracted, 2w/k Σ a_j²: the information on each parameter
    /// if the planes did not move.
    pub uncentred: DVector<f64>,
}

impl NormalEquations {
    /// Those of no observation.
    pub fn zeros(size: usize) -> Self {
        Self {
            gradient: DVector::zeros(size),
            matrix: DMatrix::zeros(size, size),
            uncentred: DVector::zeros(size),
        }
    }

    /// The sum of the `parts`, in order.
    pub fn sum(size: usize, parts: &[Self]) -> Self {
        parts.iter().fold(Self::zeros(size), |mut total, part| {
            total.gradient += &part.gradient;
            total.matrix += &part.matrix;
            total.uncentred += &part.uncentred;
            total
        })
    }
}

/// λ₃ + s² with s = `floor_m`.
fn variance(plane: &Plane, floor_m: f64) -> f64 {
    plane.variance_m2 + floor_m * floor_m
}

/// 2w/k of a plane through `k` points.
pub fn weight(plane: &Plane, floor_m: f64, k: usize) -> f64 {
    2.0 / (variance(plane, floor_m) * k as f64)
}

/// a = ∂(n·x)/∂θ of a point in the order of the parameters, (δp, δφ), from its row by the mounting.
#[inline]
pub fn derivative(row: &Row) -> Vector6<f64> {
    let (shift, turn) = (&row.translation, &row.rotation);
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

/// Σ ln(λ₃ + s²).
pub fn cost(planes: &[Plane], floor_m: f64) -> f64 {
    let partial: Vec<f64> = planes
        .par_chunks(CHUNK)
        .map(|chunk| {
            chunk
                .iter()
                .map(|plane| variance(plane, floor_m).ln())
                .sum()
        })
        .collect();
    partial.iter().sum()
}

/// Gradient and normal matrix of the cost.
pub fn normal_equations(surface: &Surface, floor_m: f64) -> NormalEquations {
    summed(surface, |sums, index| {
        let plane = &surface.planes[index];
        let members = surface.neighbourhoods.members(index).len();
        let weight = weight(plane, floor_m, members);
        sums.add(surface, index, &plane.normal, weight);
    })
}

/// What noise of normals adds to the normal matrix on average.
///
/// Noise of the points turns the normal of a plane through k of them by about σ/√(k λᵢ) along its tangents eᵢ,
/// with σ² = λ₃ k/(k − 3). Along a direction in which points slide over a plane, only this turn makes a_j
/// differ between scanners and passes: H then holds the squares of noise, which say nothing about the
/// mountings (errors in variables). By the linearity of a in the normal their expectation is H with eᵢ in
/// place of n, times σ²/(k λᵢ).
pub fn noise_of_normals(surface: &Surface, floor_m: f64) -> DMatrix<f64> {
    let noise = summed(surface, |sums, index| {
        let plane = &surface.planes[index];
        let members = surface.neighbourhoods.members(index);
        let eigen = StructureTensor::of(&surface.placed.world, members).eigen();
        let share = plane.variance_m2 / (members.len() as f64 - 3.0).max(1.0);
        for i in 0..2 {
            // Points along a line have no plane.
            if eigen.values[i] > plane.variance_m2 {
                let tangent = eigen.vectors.column(i).into();
                let weight = weight(plane, floor_m, members.len()) * share / eigen.values[i];
                sums.add(surface, index, &tangent, weight);
            }
        }
    });
    noise.matrix
}

/// Sums over all neighbourhoods.
fn summed(surface: &Surface, add: impl Fn(&mut Sums, usize) + Sync) -> NormalEquations {
    let start = || Sums::new(surface.cloud.scanners);
    let sums = in_parts(surface, start, add).into_iter().map(Sums::finish);
    NormalEquations::sum(6 * surface.cloud.scanners, &sums.collect::<Vec<_>>())
}

/// Lets every neighbourhood be added to the sums of its task. To add these up in order gives the same for any number of
/// threads.
pub fn in_parts<T: Send>(
    surface: &Surface,
    start: impl Fn() -> T + Sync,
    add: impl Fn(&mut T, usize) + Sync,
) -> Vec<T> {
    let tasks = (0..surface.planes.len().div_ceil(CHUNK)).into_par_iter();
    let parts = tasks.map(|chunk| {
        let mut part = start();
        let end = ((chunk + 1) * CHUNK).min(surface.planes.len());
        (chunk * CHUNK..end).for_each(|index| add(&mut part, index));
        part
    });
    parts.collect()
}

/// A point of a scanner in a neighbourhood.
struct Member {
    scanner: usize,
    /// a, along the axis.
    derivative: Vector6<f64>,
    /// Its distance from the mean of the neighbourhood along the axis, metres.
    distance_m: f64,
}

/// The points of scanners in a neighbourhood, with derivatives and distances along an axis.
fn members(surface: &Surface, index: usize, axis: &Vec3) -> impl Iterator<Item = Member> {
    let mean_m = surface.planes[index].mean_m;
    let members = surface.neighbourhoods.members(index).iter();
    members.filter_map(move |&member| {
        let member = member as usize;
        let point = surface.cloud.movable.get(member)?;
        Some(Member {
            scanner: surface.cloud.profile(point).scanner as usize,
            derivative: derivative(&surface.mounting_row(member, axis)),
            distance_m: axis.dot(&(surface.placed.world[member] - mean_m)),
        })
    })
}

/// Sums over neighbourhoods.
pub struct Sums {
    gradient: Vec<Vector6<f64>>,
    diagonal_blocks: Vec<Matrix6<f64>>,
    matrix: DMatrix<f64>,
    derivative: Vec<Vector6<f64>>,
}

impl Sums {
    /// Those of none.
    pub fn new(scanners: usize) -> Self {
        Self {
            gradient: vec![Vector6::zeros(); scanners],
            diagonal_blocks: vec![Matrix6::zeros(); scanners],
            matrix: DMatrix::zeros(6 * scanners, 6 * scanners),
            derivative: vec![Vector6::zeros(); scanners],
        }
    }

    /// Adds a neighbourhood with distances along `axis`.
    pub fn add(&mut self, surface: &Surface, index: usize, axis: &Vec3, weight: f64) {
        self.derivative.fill(Vector6::zeros());
        for member in members(surface, index, axis) {
            let (scanner, derivative) = (member.scanner, member.derivative);
            let weighted = derivative * weight;
            let block = &mut self.diagonal_blocks[scanner];
            for column in 0..6 {
                for row in 0..=column {
                    block[(row, column)] += weighted[row] * derivative[column];
                }
            }
            self.gradient[scanner] += weighted * member.distance_m;
            self.derivative[scanner] += derivative;
        }
        // −k ā āᵀ · 2w/k, where `derivative` holds k ā of each scanner.
        let factor = weight / surface.neighbourhoods.k() as f64;
        for a in 0..self.gradient.len() {
            let weighted = self.derivative[a] * factor;
            for b in a..self.gradient.len() {
                let mut block = self.matrix.fixed_view_mut::<6, 6>(6 * a, 6 * b);
                block -= weighted * self.derivative[b].transpose();
            }
        }
    }

    /// Their normal equations.
    pub fn finish(mut self) -> NormalEquations {
        let scanners = self.gradient.len();
        let blocks = self.diagonal_blocks.iter();
        let diagonals = blocks.flat_map(|block| block.diagonal().data.0[0]);
        let uncentred = DVector::from_iterator(6 * scanners, diagonals);
        for (scanner, block) in self.diagonal_blocks.iter_mut().enumerate() {
            block.fill_lower_triangle_with_upper_triangle();
            let mut target = self.matrix.fixed_view_mut::<6, 6>(6 * scanner, 6 * scanner);
            target += &*block;
        }
        self.matrix.fill_lower_triangle_with_upper_triangle();
        let entries = self.gradient.iter().flatten().copied();
        NormalEquations {
            gradient: DVector::from_iterator(6 * scanners, entries),
            matrix: self.matrix,
            uncentred,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::parameters::{moved, poses};
    use crate::calibration::small_case::{FLOOR_M, case, ground, surface};
    use crate::cloud::StructureTensor;
    use crate::geometry::so3;

    #[test]
    fn the_gradient_matches_finite_differences() {
        let (cloud, mountings) = case();
        let surface = surface(cloud, &mountings, 1);
        let equations = normal_equations(&surface, FLOOR_M);
        let scale = equations.gradient.amax();
        for parameter in 0..12 {
            // Central differences of 1e-6 on a cost of order 1 are good to about 1e-9.
            let at = |step: f64| {
                let mut delta = DVector::zeros(12);
                delta[parameter] = step;
                let moved = surface.moved(&poses(&moved(&mountings, &delta)));
                cost(&moved.planes, FLOOR_M)
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            let error = (numeric - equations.gradient[parameter]).abs();
            assert!(
                error < 1e-7 * scale,
                "parameter {parameter}: {error:e} of {scale:e}"
            );
        }
    }

    /// On a plane, points slide without a change of thickness: along its tangents, the normal matrix holds noise only.
    #[test]
    fn on_flat_ground_the_information_on_slides_is_that_of_noise() {
        let (cloud, mountings) = ground(0.0);
        let surface = surface(cloud, &mountings, 1);
        let all = normal_equations(&surface, FLOOR_M).matrix;
        let noise = noise_of_normals(&surface, FLOOR_M);
        for slide in [0, 1, 6, 7] {
            let share = noise[(slide, slide)] / all[(slide, slide)];
            println!("{share:.3}");
            // 200 separate neighbourhoods, of which the squares of the slopes scatter by √(2/200).
            assert!((share - 1.0).abs() < 0.3, "{slide}: {share}");
        }
        // Heights are what the planes do show.
        assert!(noise[(2, 2)] < 0.05 * all[(2, 2)]);
    }

    #[test]
    fn the_normal_matrix_is_the_definition_summed_point_by_point() {
        let (cloud, mountings) = case();
        let surface = surface(cloud, &mountings, 3);
        let Surface { cloud, placed, .. } = &surface;
        let fast = normal_equations(&surface, FLOOR_M);
        let mut slow = DMatrix::zeros(12, 12);
        for index in 0..surface.planes.len() {
            let members = surface.neighbourhoods.members(index);
            let tensor = StructureTensor::of(&placed.world, members);
            let eigen = tensor.covariance.symmetric_eigen();
            let smallest = eigen.eigenvalues.imin();
            let normal = eigen.eigenvectors.column(smallest).into_owned();
            let variance = eigen.eigenvalues[smallest];
            let weight = normal * normal.transpose() / (variance + FLOOR_M.powi(2));
            let derivatives: Vec<DMatrix<f64>> = members
                .iter()
                .map(|&member| {
                    let mut full = DMatrix::zeros(3, 12);
                    if let Some(point) = cloud.movable.get(member as usize) {
                        let profile = cloud.profile(point);
                        let scanner = profile.scanner as usize;
                        let mounting = &mountings[scanner].body_from_scanner;
                        let arm = so3::hat(&(mounting.rotation * point.position_m));
                        full.view_mut((0, 6 * scanner), (3, 3))
                            .copy_from(&profile.rotation);
                        full.view_mut((0, 6 * scanner + 3), (3, 3))
                            .copy_from(&-(profile.rotation * arm));
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
        // Two eigenvalue solvers differ by rounding errors times the ratio of the eigenvalues.
        assert!((&fast.matrix - &slow).amax() < 1e-10 * slow.amax());
    }
}
