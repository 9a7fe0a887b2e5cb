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
use crate::cloud::StructureTensor;
use crate::geometry::{Mat3, so3};

/// Neighbourhoods a parallel task works on; sums run over tasks in order, so that results do not
/// depend on the number of threads.
const CHUNK: usize = 2048;

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

/// σ² and W = ⅔ σ² C⁻¹ of a neighbourhood; `None` where its points lie in a plane, on a line or in
/// one place, so that it has neither weight nor cost.
pub fn weight(tensor: &StructureTensor) -> Option<(f64, Mat3)> {
    let squared = tensor.omnivariance().powi(2);
    if squared == 0.0 {
        return None;
    }
    Some((
        squared,
        tensor.covariance.try_inverse()? * (2.0 / 3.0 * squared),
    ))
}

/// Σσ² alone.
pub fn cost(placed: &Placed, neighbourhoods: &Neighbourhoods) -> f64 {
    let partial: Vec<f64> = (0..neighbourhoods.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            chunk_range(chunk, neighbourhoods.len())
                .map(|index| {
                    let members = neighbourhoods.of(index);
                    StructureTensor::of(&placed.world, members)
                        .omnivariance()
                        .powi(2)
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
        let shape = StructureTensor::of(&placed.world, members);
        let Some((squared_omnivariance, weight)) = weight(&shape) else {
            return;
        };
        self.cost += squared_omnivariance;
        let factor = 2.0 / members.len() as f64;
        self.mean_derivative.fill(Matrix3x6::zeros());
        self.present.fill(false);
        for &member in members {
            let index = member as usize;
            let Some(point) = cloud.movable.get(index) else {
                continue;
            };
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
        let gradient = DVector::from_iterator(
            6 * scanners,
            self.gradient.iter().flat_map(|g| g.iter().copied()),
        );
        NormalEquations {
            cost: self.cost,
            gradient,
            matrix: self.matrix,
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::neighbourhoods::{MovablePoint, find};
    use crate::calibration::parameters::{Mounting, moved};
    use crate::geometry::{EulerConvention, Pose, Rotation, Vec3};

    /// Numbers in [-1, 1) from a linear congruential generator: the same everywhere.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 1u64;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    /// Two scanners over a bumpy surface, each point with a pose of its own, and a reference.
    fn case() -> (ScaleCloud, Vec<Mounting>) {
        let mut next = numbers();
        let movable = (0..400)
            .map(|i| {
                let turn = Rotation::from_scaled_axis(Vec3::new(next(), next(), next()) * 0.3);
                MovablePoint {
                    scanner: i % 2,
                    time_s: f64::from(i),
                    position_m: Vec3::new(next(), 0.1 * next(), -1.0 + 0.05 * next()),
                    world_from_body: *turn.to_rotation_matrix().matrix(),
                    body_m: Vec3::new(next(), next(), 2.0),
                }
            })
            .collect();
        let fixed = (0..100)
            .map(|_| Vec3::new(next(), next(), 1.0 + 0.3 * next()))
            .collect();
        let mountings = ["left", "right"]
            .map(|name| Mounting {
                name: name.into(),
                body_from_scanner: Pose::new(
                    Vec3::new(0.3 * next(), 0.3 * next(), 0.1 * next()),
                    Vec3::new(next(), next(), next()),
                ),
                convention: EulerConvention::Zyx,
                fixed: [false; 6],
            })
            .to_vec();
        (
            ScaleCloud {
                movable,
                fixed,
                scanners: 2,
            },
            mountings,
        )
    }

    #[test]
    fn the_gradient_meets_finite_differences() {
        let (cloud, mountings) = case();
        let placed = cloud.place(&mountings);
        let neighbourhoods = find(&cloud, &placed, 20, 1);
        let equations = normal_equations(&cloud, &placed, &neighbourhoods);
        assert!((equations.cost - cost(&placed, &neighbourhoods)).abs() < 1e-12 * equations.cost);
        let scale = equations.gradient.amax();
        for parameter in 0..12 {
            // Central differences of 1e-6 on a cost of order 1 are good to about 1e-9.
            let at = |step: f64| {
                let mut delta = DVector::zeros(12);
                delta[parameter] = step;
                cost(&cloud.place(&moved(&mountings, &delta)), &neighbourhoods)
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
            let (_, weight) = weight(&tensor).expect("points in space");
            let derivatives: Vec<DMatrix<f64>> = members
                .iter()
                .map(|&member| {
                    let mut full = DMatrix::zeros(3, 12);
                    if let Some(point) = cloud.movable.get(member as usize) {
                        let own = cloud.derivative(&placed, member as usize);
                        full.view_mut((0, 6 * point.scanner as usize), (3, 6))
                            .copy_from(&own);
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
        assert!((&fast.matrix - &slow).amax() < 1e-11 * slow.amax());
    }
}
