//! Σσ² over the neighbourhoods, its gradient and a positive semidefinite normal matrix.
//!
//! With C the structure tensor of a neighbourhood and σ² = det(C)^⅔ its squared omnivariance
//! (equation (6) of the paper), d(σ²) = ⅔ σ² tr(C⁻¹ dC). Freezing W = ⅔ σ² C⁻¹ at the current
//! parameters, the weighted scatter 1/k Σ (x_j − x̄)ᵀ W (x_j − x̄) has the same gradient
//!
//!   g = 2/k Σ_j A_jᵀ W (x_j − x̄)
//!
//! and the Gauss-Newton matrix
//!
//!   H = 2/k (Σ_j A_jᵀ W A_j − k Āᵀ W Ā),
//!
//! with A_j = ∂x_j/∂θ (zero for reference points) and Ā their mean.

use nalgebra::{DMatrix, DVector, Matrix3x6, Matrix6, Vector6};
use rayon::prelude::*;

use super::neighbourhoods::{Neighbourhoods, Placed, ScaleCloud};
use crate::geometry::{Mat3, Vec3, so3};

/// Neighbourhoods a parallel task works on; sums run over tasks in order, so that results do not
/// depend on the number of threads.
const CHUNK: usize = 2048;

/// Flatness below which a neighbourhood has no usable inverse: det(C) < (10⁻¹⁵ tr C)·(tr C)².
/// Such points lie on a line or plane to f64 precision and carry no weight.
const DEGENERATE: f64 = 1e-15;

/// The normal equations at given mountings.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// Σσ², m⁴.
    pub cost: f64,
    /// ∂cost/∂θ, 6 a scanner: (δt, δψ) in body axes.
    pub gradient: DVector<f64>,
    /// Gauss-Newton matrix, 6 s × 6 s.
    pub matrix: DMatrix<f64>,
}

/// Mean, structure tensor and squared omnivariance of a neighbourhood.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    /// x̄, metres.
    pub mean: Vec3,
    /// C, m².
    pub tensor: Mat3,
    /// det(C)^⅔, m⁴; 0 where degenerate.
    pub squared_omnivariance: f64,
}

impl Shape {
    /// The shape of these members.
    pub fn of(world: &[Vec3], members: &[u32]) -> Self {
        let scale = 1.0 / members.len() as f64;
        let origin = world[members[0] as usize];
        let mut sum = Vec3::zeros();
        for &member in members {
            sum += world[member as usize] - origin;
        }
        let mean = origin + sum * scale;
        let [mut xx, mut xy, mut xz, mut yy, mut yz, mut zz] = [0.0; 6];
        for &member in members {
            let r = world[member as usize] - mean;
            xx += r.x * r.x;
            xy += r.x * r.y;
            xz += r.x * r.z;
            yy += r.y * r.y;
            yz += r.y * r.z;
            zz += r.z * r.z;
        }
        let tensor = Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * scale;
        let determinant = tensor.determinant();
        let trace = tensor.trace();
        let squared_omnivariance = if determinant > DEGENERATE * trace * trace * trace {
            let root = determinant.cbrt();
            root * root
        } else {
            0.0
        };
        Self { mean, tensor, squared_omnivariance }
    }

    /// W = ⅔ σ² C⁻¹; `None` where degenerate.
    pub fn weight(&self) -> Option<Mat3> {
        if self.squared_omnivariance == 0.0 {
            return None;
        }
        Some(self.tensor.try_inverse()? * (2.0 / 3.0 * self.squared_omnivariance))
    }
}

/// Σσ² alone.
pub fn cost(placed: &Placed, neighbourhoods: &Neighbourhoods) -> f64 {
    let partial: Vec<f64> = (0..neighbourhoods.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            chunk_range(chunk, neighbourhoods.len())
                .map(|index| {
                    Shape::of(&placed.world, neighbourhoods.of(index)).squared_omnivariance
                })
                .sum()
        })
        .collect();
    partial.iter().sum()
}

/// Σσ², its gradient and the normal matrix.
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
                sums.add(cloud, placed, neighbourhoods.of(index));
            }
            sums.finish()
        })
        .collect();
    let size = 6 * cloud.scanners;
    let zero = NormalEquations {
        cost: 0.0,
        gradient: DVector::zeros(size),
        matrix: DMatrix::zeros(size, size),
    };
    partial.into_iter().fold(zero, |mut total, part| {
        total.cost += part.cost;
        total.gradient += part.gradient;
        total.matrix += part.matrix;
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
    mean_derivative: Vec<Matrix3x6<f64>>,
    present: Vec<bool>,
}

impl Sums {
    fn new(scanners: usize) -> Self {
        Self {
            cost: 0.0,
            gradient: vec![Vector6::zeros(); scanners],
            own: vec![Matrix6::zeros(); scanners],
            matrix: DMatrix::zeros(6 * scanners, 6 * scanners),
            mean_derivative: vec![Matrix3x6::zeros(); scanners],
            present: vec![false; scanners],
        }
    }

    fn add(&mut self, cloud: &ScaleCloud, placed: &Placed, members: &[u32]) {
        let shape = Shape::of(&placed.world, members);
        self.cost += shape.squared_omnivariance;
        let Some(weight) = shape.weight() else { return };
        let factor = 2.0 / members.len() as f64;
        self.mean_derivative.fill(Matrix3x6::zeros());
        self.present.fill(false);
        for &member in members {
            let index = member as usize;
            let Some(point) = cloud.movable.get(index) else { continue };
            let scanner = point.scanner as usize;
            let rotation = &point.world_from_body;
            let arm = &placed.arm[index];
            let arm_hat = so3::hat(arm);
            // AᵀWA in body axes: M = RᵀWR, then [M, −M v×; ·, (v×)ᵀ M v×].
            let weight_rotation = weight * rotation;
            let body_weight = rotation.tr_mul(&weight_rotation) * factor;
            let turned = body_weight * arm_hat;
            let own = &mut self.own[scanner];
            add_block(own, 0, 0, &body_weight);
            add_block(own, 0, 3, &-turned);
            add_block(own, 3, 3, &arm_hat.tr_mul(&turned));
            let pull = weight_rotation.tr_mul(&(placed.world[index] - shape.mean)) * factor;
            let gradient = &mut self.gradient[scanner];
            let moment = arm.cross(&pull);
            for axis in 0..3 {
                gradient[axis] += pull[axis];
                gradient[3 + axis] += moment[axis];
            }
            self.present[scanner] = true;
            let mean = &mut self.mean_derivative[scanner];
            let turning = rotation * arm_hat;
            for row in 0..3 {
                for column in 0..3 {
                    mean[(row, column)] += rotation[(row, column)];
                    mean[(row, 3 + column)] -= turning[(row, column)];
                }
            }
        }
        // −k Āᵀ W Ā · 2/k, where `mean_derivative` holds k Ā.
        let scale = factor / members.len() as f64;
        for a in (0..cloud.scanners).filter(|&a| self.present[a]) {
            let weighted = weight * self.mean_derivative[a] * scale;
            for b in (a..cloud.scanners).filter(|&b| self.present[b]) {
                let product = weighted.tr_mul(&self.mean_derivative[b]);
                let mut block = self.matrix.fixed_view_mut::<6, 6>(6 * a, 6 * b);
                block -= product;
            }
        }
    }

    fn finish(mut self) -> NormalEquations {
        let scanners = self.gradient.len();
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
        let gradient =
            DVector::from_iterator(6 * scanners, self.gradient.iter().flat_map(|g| g.iter().copied()));
        NormalEquations { cost: self.cost, gradient, matrix: self.matrix }
    }
}

#[inline]
fn add_block(matrix: &mut Matrix6<f64>, row: usize, column: usize, block: &Mat3) {
    for j in 0..3 {
        for i in 0..3 {
            matrix[(row + i, column + j)] += block[(i, j)];
        }
    }
}
