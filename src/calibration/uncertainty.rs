//! Standard deviations of the mountings that include the errors of the poses.
//!
//! At the minimum the gradient g(θ, x) vanishes. Moving a laser point by dx moves the gradient by
//! G_l dx with
//!
//!   G_l = Σ_{i ∋ l} 2w_i/k (a_l − ā_i) n_iᵀ,
//!
//! and the mountings by −N⁻¹ G_l dx. Two things move points: the scanner's noise and roughness,
//! independent from point to point, and the poses, whose errors are correlated along the drive:
//! dx = dp − R_mb (u)× dφ with u = t_bs + R_bs x_s. The smoother propagates the latter with its
//! full posterior covariance, correlations in time included. Uncertainties that ignore the poses
//! would be too small by an order of magnitude. The
//! reference counts as exact: its own noise averages out over thousands of points, and an error of
//! its registration moves all scanners alike.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, Matrix6x3, Vector6};
use rayon::prelude::*;

use super::cost::LocalPlane;
use super::neighbourhoods::{Neighbourhoods, Placed, ScaleCloud};
use super::parameters::Mounting;
use crate::cloud::StructureTensor;
use crate::geometry::{Mat3, Vec3, so3};
use crate::sensor::PoseRecord;
use crate::trajectory::{PoseGradient, PosteriorCovariance, Trajectory};

/// What is known of the errors of the poses.
#[derive(Debug, Clone, Copy)]
pub enum PoseUncertainty<'a> {
    /// The smoother's posterior, correlations included.
    Smoothed(&'a PosteriorCovariance),
    /// Standard deviations beside the poses; errors are taken as constant over [`BLOCK_S`].
    Sigmas,
    /// Nothing is known, or the poses are exact: sigmas hold for exact poses.
    None,
}

/// Time over which errors of poses given with standard deviations alone count as constant,
/// seconds: about the time a total station's position and a filter's attitude keep their error.
pub const BLOCK_S: f64 = 5.0;

/// ∂g/∂x of every movable point for the six rows of one scanner.
fn point_gradients(
    cloud: &ScaleCloud,
    placed: &Placed,
    neighbourhoods: &Neighbourhoods,
    scanner: usize,
) -> Vec<Matrix6x3<f64>> {
    let mut gradients = vec![Matrix6x3::zeros(); cloud.movable.len()];
    let mut derivatives = Vec::new();
    for index in 0..neighbourhoods.len() {
        let members = neighbourhoods.of(index);
        let plane = LocalPlane::of(cloud, placed, neighbourhoods, index);
        derivatives.clear();
        derivatives.extend(members.iter().map(|&member| {
            let own = cloud.movable.get(member as usize);
            let own = own.is_some_and(|point| point.scanner as usize == scanner);
            own.then(|| plane.derivative(cloud, placed, member as usize))
        }));
        if derivatives.iter().all(Option::is_none) {
            continue;
        }
        let sum = derivatives
            .iter()
            .flatten()
            .fold(Vector6::zeros(), |sum, a| sum + a);
        let mean = sum / members.len() as f64;
        let weighted = (plane.normal * plane.weight).transpose();
        for (&member, derivative) in members.iter().zip(&derivatives) {
            if let Some(gradient) = gradients.get_mut(member as usize) {
                *gradient += (derivative.unwrap_or_default() - mean) * weighted;
            }
        }
    }
    gradients
}

/// Covariance of the gradient g: what scatter of the points and errors of the poses do to it.
pub fn gradient_covariance(
    cloud: &ScaleCloud,
    placed: &Placed,
    neighbourhoods: &Neighbourhoods,
    mountings: &[Mounting],
    trajectory: &Trajectory,
    poses: PoseUncertainty<'_>,
) -> DMatrix<f64> {
    let gradients: Vec<Vec<Matrix6x3<f64>>> = (0..cloud.scanners)
        .into_par_iter()
        .map(|scanner| point_gradients(cloud, placed, neighbourhoods, scanner))
        .collect();
    let mut covariance = scatter_part(cloud, placed, neighbourhoods, &gradients);
    covariance += match poses {
        PoseUncertainty::Smoothed(posterior) => {
            smoothed_part(cloud, placed, &gradients, mountings, trajectory, posterior)
        }
        PoseUncertainty::Sigmas => sigmas_part(cloud, placed, &gradients, trajectory),
        PoseUncertainty::None => DMatrix::zeros(covariance.nrows(), covariance.ncols()),
    };
    covariance
}

/// Σ_l G_l s_l² G_lᵀ with s_l² the smallest eigenvalue of the neighbourhood around point l: its
/// scatter about the local plane. Points that are no centre take the mean of the others.
fn scatter_part(
    cloud: &ScaleCloud,
    placed: &Placed,
    neighbourhoods: &Neighbourhoods,
    gradients: &[Vec<Matrix6x3<f64>>],
) -> DMatrix<f64> {
    let variances: Vec<f64> = (0..neighbourhoods.len())
        .into_par_iter()
        .map(|index| {
            let members = neighbourhoods.of(index);
            StructureTensor::of(&placed.world, members).eigen().values.z
        })
        .collect();
    let mean = variances.iter().sum::<f64>() / variances.len().max(1) as f64;
    let mut of_point = vec![mean; cloud.movable.len()];
    for (&centre, &variance) in neighbourhoods.centres.iter().zip(&variances) {
        of_point[centre as usize] = variance;
    }
    let size = 6 * cloud.scanners;
    let mut covariance = DMatrix::zeros(size, size);
    for a in 0..cloud.scanners {
        for b in a..cloud.scanners {
            let mut block = nalgebra::Matrix6::zeros();
            for (l, variance) in of_point.iter().enumerate() {
                block += gradients[a][l] * gradients[b][l].transpose() * *variance;
            }
            covariance
                .fixed_view_mut::<6, 6>(6 * a, 6 * b)
                .copy_from(&block);
            covariance
                .fixed_view_mut::<6, 6>(6 * b, 6 * a)
                .copy_from(&block.transpose());
        }
    }
    covariance
}

/// G_x Cov(nodes) G_xᵀ by the smoother, poses between nodes shared between both by time.
fn smoothed_part(
    cloud: &ScaleCloud,
    placed: &Placed,
    gradients: &[Vec<Matrix6x3<f64>>],
    mountings: &[Mounting],
    trajectory: &Trajectory,
    posterior: &PosteriorCovariance,
) -> DMatrix<f64> {
    let size = 6 * cloud.scanners;
    let mut functional = PoseGradient::new(size, trajectory.nodes().len());
    for (l, point) in cloud.movable.iter().enumerate() {
        let Some((node, fraction)) = trajectory.locate(point.time_s) else {
            continue;
        };
        let lever = mountings[point.scanner as usize]
            .body_from_scanner
            .translation
            .vector
            + placed.arm[l];
        let turning = -(point.world_from_body * so3::hat(&lever));
        for (node, share) in [(node, 1.0 - fraction), (node + 1, fraction)] {
            let block = functional.block_mut(node);
            for (scanner, rows) in gradients.iter().enumerate() {
                let rotation = rows[l] * turning;
                for row in 0..6 {
                    let entries = &mut block[6 * (6 * scanner + row)..][..6];
                    for axis in 0..3 {
                        entries[axis] += rotation[(row, axis)] * share;
                        entries[3 + axis] += rows[l][(row, axis)] * share;
                    }
                }
            }
        }
    }
    posterior.of_functional(&functional)
}

/// The same from standard deviations alone: errors constant over blocks of [`BLOCK_S`],
/// independent between blocks and axes.
fn sigmas_part(
    cloud: &ScaleCloud,
    placed: &Placed,
    gradients: &[Vec<Matrix6x3<f64>>],
    trajectory: &Trajectory,
) -> DMatrix<f64> {
    let size = 6 * cloud.scanners;
    let mut covariance = DMatrix::zeros(size, size);
    let (start_s, _) = trajectory.span_s();
    // Only blocks in which there are points: a trajectory may span years.
    let mut sums: BTreeMap<u64, DMatrix<f64>> = BTreeMap::new();
    for (l, point) in cloud.movable.iter().enumerate() {
        let Some((node, _)) = trajectory.locate(point.time_s) else {
            continue;
        };
        let Some((position, rotation)) = sigma_matrices(&trajectory.nodes()[node]) else {
            continue;
        };
        let block = ((point.time_s - start_s) / BLOCK_S) as u64;
        let sums = sums.entry(block).or_insert_with(|| DMatrix::zeros(size, 6));
        // Rotations are about world axes through the body's origin: dx = dω × (x − t_mb).
        let turning = -so3::hat(&(placed.world[l] - point.body_m)) * rotation;
        for (scanner, rows) in gradients.iter().enumerate() {
            let mut sum = sums.fixed_view_mut::<6, 6>(6 * scanner, 0);
            let mut both = nalgebra::Matrix6::zeros();
            both.fixed_view_mut::<6, 3>(0, 0)
                .copy_from(&(rows[l] * position));
            both.fixed_view_mut::<6, 3>(0, 3)
                .copy_from(&(rows[l] * turning));
            sum += both;
        }
    }
    for sum in sums.values() {
        covariance += sum * sum.transpose();
    }
    covariance
}

fn sigma_matrices(node: &PoseRecord) -> Option<(Mat3, Mat3)> {
    let diagonal = |v: &Vec3| Mat3::from_diagonal(v);
    node.sigma
        .as_ref()
        .map(|s| (diagonal(&s.position_m), diagonal(&s.rotation_rad)))
}

/// Covariance of the mountings (δt, δψ), zero in directions outside `basis`:
/// M S Mᵀ with M = B (BᵀNB)⁻¹ Bᵀ and S the covariance of the gradient.
pub fn mounting_covariance(
    normal_matrix: &DMatrix<f64>,
    basis: &DMatrix<f64>,
    gradient_covariance: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let reduced = basis.transpose() * normal_matrix * basis;
    let inverse = nalgebra::Cholesky::new(reduced)?.inverse();
    let spread = basis * inverse * basis.transpose();
    let covariance = &spread * gradient_covariance * spread.transpose();
    Some((&covariance + covariance.transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::calibration::neighbourhoods::find;
    use crate::calibration::small_case::case;
    use crate::geometry::{Pose, so3};
    use crate::sensor::{PoseRecord, PoseSigma};

    /// g with planes, weights and derivatives frozen at `placed` and the points at `world`.
    fn frozen_gradient(
        cloud: &ScaleCloud,
        placed: &Placed,
        neighbourhoods: &Neighbourhoods,
        world: &[Vec3],
    ) -> DVector<f64> {
        let mut gradient = DVector::zeros(6 * cloud.scanners);
        for index in 0..neighbourhoods.len() {
            let members = neighbourhoods.of(index);
            let plane = LocalPlane::of(cloud, placed, neighbourhoods, index);
            let mean =
                members.iter().map(|&m| world[m as usize]).sum::<Vec3>() / members.len() as f64;
            for &member in members {
                let Some(point) = cloud.movable.get(member as usize) else {
                    continue;
                };
                let a = plane.derivative(cloud, placed, member as usize);
                let distance = plane.normal.dot(&(world[member as usize] - mean));
                let mut rows = gradient.rows_mut(6 * point.scanner as usize, 6);
                rows += a * (plane.weight * distance);
            }
        }
        gradient
    }

    #[test]
    fn moving_a_point_moves_the_gradient_as_the_sensitivity_says() {
        let (cloud, mountings) = case();
        let placed = cloud.place(&mountings);
        let neighbourhoods = find(&cloud, &placed, 20, 1);
        let sensitivities: Vec<_> = (0..2)
            .map(|scanner| point_gradients(&cloud, &placed, &neighbourhoods, scanner))
            .collect();
        let before = frozen_gradient(&cloud, &placed, &neighbourhoods, &placed.world);
        for l in [0, 7, 150, 399] {
            let step = Vec3::new(0.01, -0.02, 0.03);
            let mut world = placed.world.clone();
            world[l] += step;
            let change = frozen_gradient(&cloud, &placed, &neighbourhoods, &world) - &before;
            for (scanner, sensitivity) in sensitivities.iter().enumerate() {
                let predicted = sensitivity[l] * step;
                let found = change.rows(6 * scanner, 6);
                // Linear in the points: only rounding is left.
                assert!(
                    (predicted - found).amax() < 1e-9 * before.amax(),
                    "point {l}"
                );
            }
        }
    }

    #[test]
    fn errors_of_a_pose_reach_the_gradient_through_the_points() {
        // One block of time: a common error of position and rotation moves every point.
        let (mut cloud, mountings) = case();
        let world_from_body = Pose::new(Vec3::new(1.0, 2.0, 3.0), Vec3::new(0.1, -0.2, 0.3));
        for (l, point) in cloud.movable.iter_mut().enumerate() {
            point.time_s = l as f64 * 1e-3;
            point.world_from_body = *world_from_body.rotation.to_rotation_matrix().matrix();
            point.body_m = world_from_body.translation.vector;
        }
        let sigma = PoseSigma {
            position_m: Vec3::new(1e-3, 2e-3, 3e-3),
            rotation_rad: Vec3::new(1e-4, 2e-4, 3e-4),
        };
        let node = |time_s| PoseRecord {
            time_s,
            world_from_body,
            velocity_m_s: None,
            bias: None,
            sigma: Some(sigma),
        };
        let trajectory = Trajectory::new(vec![node(0.0), node(1.0)]).expect("two nodes");
        let placed = cloud.place(&mountings);
        let neighbourhoods = find(&cloud, &placed, 20, 1);
        let covariance_with = |poses| {
            gradient_covariance(
                &cloud,
                &placed,
                &neighbourhoods,
                &mountings,
                &trajectory,
                poses,
            )
        };
        let found =
            covariance_with(PoseUncertainty::Sigmas) - covariance_with(PoseUncertainty::None);
        let before = frozen_gradient(&cloud, &placed, &neighbourhoods, &placed.world);
        let mut expected = DMatrix::zeros(12, 12);
        for axis in 0..6 {
            let mut world = placed.world.clone();
            for (x, point) in world.iter_mut().zip(&cloud.movable) {
                if axis < 3 {
                    x[axis] += sigma.position_m[axis];
                } else {
                    let mut turn = Vec3::zeros();
                    turn[axis - 3] = sigma.rotation_rad[axis - 3];
                    *x = point.body_m + so3::exp(&turn) * (*x - point.body_m);
                }
            }
            let change = frozen_gradient(&cloud, &placed, &neighbourhoods, &world) - &before;
            expected += &change * change.transpose();
        }
        // Finite rotations of up to 3e-4 rad differ from their derivative by half of that.
        assert!((&found - &expected).amax() < 1e-3 * expected.amax());
    }
}
