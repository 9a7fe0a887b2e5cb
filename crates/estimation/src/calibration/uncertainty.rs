//! Covariance of the mountings, including the errors of the poses.
//!
//! At the minimum the gradient g(θ, x) vanishes. Moving a laser point by dx moves the gradient by
//! G_l dx with
//!
//!   G_l = Σ_{i ∋ l} 2w_i/k (a_l − ā_i) n_iᵀ,
//!
//! and the mountings by −N⁻¹ G_l dx. Points have two kinds of errors: scanner noise and surface
//! roughness, independent from point to point, and pose errors, correlated along the drive, which
//! are propagated to the points of a profile by their derivatives by the pose. The smoother
//! propagates pose errors with its full posterior covariance, including correlations in time.
//! Uncertainties that ignore the poses would be too small by an order of magnitude. The reference
//! counts as exact: its noise averages out over thousands of points, and a registration error moves
//! all scanners alike.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, Matrix6x3, Vector6};
use rayon::prelude::*;

use super::cost::{derivative, weight};
use super::input::{Input, PoseUncertainty};
use super::parameters::change;
use super::places;
use super::scale::Solved;
use crate::geometry::Vec3;
use crate::surface::{Memberships, PosedProfile, Surface};
use crate::trajectory::{PoseGradient, Trajectory};

/// Points per parallel task.
const CHUNK: usize = 4096;

/// Number of tasks whose results are held in memory at a time.
const BATCH: usize = 16;

/// Derivative of the gradient g by single points.
struct Sensitivity<'a> {
    surface: &'a Surface,
    /// 2w/k of each neighbourhood.
    weights: Vec<f64>,
    /// ā of each neighbourhood, scanner by scanner.
    means: Vec<Vector6<f64>>,
    memberships: Memberships,
}

impl<'a> Sensitivity<'a> {
    fn new(surface: &'a Surface, floor_m: f64) -> Self {
        let cloud = &surface.cloud;
        let k = surface.neighbourhoods.k();
        let means = (0..surface.planes.len())
            .into_par_iter()
            .flat_map_iter(|index| {
                let mut means = vec![Vector6::zeros(); cloud.scanners];
                for &member in surface.neighbourhoods.members(index) {
                    if let Some(point) = cloud.movable.get(member as usize) {
                        let normal = &surface.planes[index].normal;
                        let row = surface.mounting_row(member as usize, normal);
                        means[cloud.profile(point).scanner as usize] += derivative(&row);
                    }
                }
                means.into_iter().map(move |sum| sum / k as f64)
            });
        Self {
            weights: surface
                .planes
                .iter()
                .map(|plane| weight(plane, floor_m, k))
                .collect(),
            means: means.collect(),
            memberships: surface.neighbourhoods.memberships(cloud.movable.len()),
            surface,
        }
    }

    /// G_l = ∂g/∂x of movable point `l`: the six rows of every scanner.
    fn gradients(&self, l: usize) -> Vec<Matrix6x3<f64>> {
        let cloud = &self.surface.cloud;
        let own_scanner = cloud.profile(&cloud.movable[l]).scanner as usize;
        let mut gradients = vec![Matrix6x3::zeros(); cloud.scanners];
        for &index in self.memberships.neighbourhoods(l) {
            let index = index as usize;
            let normal = &self.surface.planes[index].normal;
            let weighted = (normal * self.weights[index]).transpose();
            let means = &self.means[cloud.scanners * index..];
            for (scanner, (gradient, mean)) in gradients.iter_mut().zip(means).enumerate() {
                let a = if scanner == own_scanner {
                    derivative(&self.surface.mounting_row(l, normal))
                } else {
                    Vector6::zeros()
                };
                *gradient += (a - mean) * weighted;
            }
        }
        gradients
    }
}

/// Contribution of a range of points.
struct Part {
    /// Σ G_l s_l² G_lᵀ.
    scatter: DMatrix<f64>,
    /// ∂g/∂(δφ, δp) of the pose of each profile, row by row.
    by_pose: Vec<(u32, Vec<f64>)>,
}

impl Part {
    /// The contribution of the points of `range`, with their scatter s_l² in `variances`.
    fn new(
        sensitivity: &Sensitivity<'_>,
        variances: &[f64],
        range: std::ops::Range<usize>,
    ) -> Self {
        let surface = sensitivity.surface;
        let size = 6 * surface.cloud.scanners;
        let mut part = Self {
            scatter: DMatrix::zeros(size, size),
            by_pose: Vec::new(),
        };
        let mut l = range.start;
        for points in surface.cloud.movable[range].chunk_by(|a, b| a.profile == b.profile) {
            let mut by_pose = vec![0.0; 6 * size];
            for _ in points {
                let gradients = sensitivity.gradients(l);
                part.add_scatter(&gradients, variances[l]);
                let directions = gradients.iter().flat_map(|rows| rows.row_iter());
                for (sums, direction) in by_pose.chunks_exact_mut(6).zip(directions) {
                    let row = surface.pose_row(l, &direction.transpose());
                    for axis in 0..3 {
                        sums[axis] += row.rotation[axis];
                        sums[3 + axis] += row.translation[axis];
                    }
                }
                l += 1;
            }
            part.by_pose.push((points[0].profile, by_pose));
        }
        part
    }

    fn add_scatter(&mut self, gradients: &[Matrix6x3<f64>], variance: f64) {
        for (a, left) in gradients.iter().enumerate() {
            for (b, right) in gradients.iter().enumerate().skip(a) {
                let mut block = self.scatter.fixed_view_mut::<6, 6>(6 * a, 6 * b);
                block += left * right.transpose() * variance;
            }
        }
    }
}

/// Covariance of the gradient g due to the scatter of the points and the errors of the poses.
fn gradient_covariance(
    surface: &Surface,
    floor_m: f64,
    trajectory: &Trajectory,
    poses: PoseUncertainty<'_>,
) -> DMatrix<f64> {
    let sensitivity = Sensitivity::new(surface, floor_m);
    let variances = scatter(surface);
    let size = 6 * surface.cloud.scanners;
    let points = surface.cloud.movable.len();
    let mut covariance = DMatrix::zeros(size, size);
    let mut errors = PoseErrors::new(size, trajectory, poses);
    for batch in (0..points).step_by(BATCH * CHUNK) {
        let starts = (batch..points.min(batch + BATCH * CHUNK))
            .into_par_iter()
            .step_by(CHUNK);
        let parts: Vec<Part> = starts
            .map(|start| Part::new(&sensitivity, &variances, start..points.min(start + CHUNK)))
            .collect();
        for part in parts {
            covariance += part.scatter;
            for (profile, gradient) in &part.by_pose {
                errors.add(&surface.cloud.profiles[*profile as usize], gradient);
            }
        }
    }
    covariance.fill_lower_triangle_with_upper_triangle();
    covariance + errors.covariance()
}

/// s_l²: the smallest eigenvalue of the neighbourhood around each movable point; points that are
/// not centres get the mean of the others.
fn scatter(surface: &Surface) -> Vec<f64> {
    let planes = &surface.planes;
    let sum: f64 = planes.iter().map(|plane| plane.variance_m2).sum();
    let mut variances = vec![sum / planes.len().max(1) as f64; surface.cloud.movable.len()];
    for (&centre, plane) in surface.neighbourhoods.centres().iter().zip(planes) {
        variances[centre as usize] = plane.variance_m2;
    }
    variances
}

/// Effect of the errors of the poses on the gradient.
struct PoseErrors<'a> {
    trajectory: &'a Trajectory,
    poses: PoseUncertainty<'a>,
    by_node: PoseGradient,
    by_block: BTreeMap<u64, DMatrix<f64>>,
}

impl<'a> PoseErrors<'a> {
    fn new(size: usize, trajectory: &'a Trajectory, poses: PoseUncertainty<'a>) -> Self {
        Self {
            trajectory,
            poses,
            by_node: PoseGradient::new(size, trajectory.poses().len()),
            by_block: BTreeMap::new(),
        }
    }

    /// Adds the derivative of the gradient by the pose of a profile, (δφ, δp) row by row.
    fn add(&mut self, profile: &PosedProfile, gradient: &[f64]) {
        let Some((node, fraction)) = self.trajectory.locate(profile.time_s) else {
            return;
        };
        match self.poses {
            // The error of a pose between two nodes is interpolated linearly in time.
            PoseUncertainty::Smoothed(_) => {
                for (node, share) in [(node, 1.0 - fraction), (node + 1, fraction)] {
                    let sums = self.by_node.block_mut(node);
                    sums.iter_mut()
                        .zip(gradient)
                        .for_each(|(sum, entry)| *sum += entry * share);
                }
            }
            // Errors are constant over a block and independent between blocks and axes.
            PoseUncertainty::Sigmas { correlation_s } => {
                let Some(sigma) = self.trajectory.poses()[node].sigma else {
                    return;
                };
                let block = (profile.time_s - self.trajectory.span_s().0) / correlation_s;
                let size = self.by_node.rows();
                let sums = self.by_block.entry(block as u64);
                let sums = sums.or_insert_with(|| DMatrix::zeros(size, 6));
                for (row, entries) in gradient.chunks_exact(6).enumerate() {
                    // Standard deviations of rotations are about world axes.
                    let turn = profile.rotation * Vec3::from_row_slice(&entries[..3]);
                    for axis in 0..3 {
                        sums[(row, axis)] += turn[axis] * sigma.rotation_rad[axis];
                        sums[(row, 3 + axis)] += entries[3 + axis] * sigma.position_m[axis];
                    }
                }
            }
            PoseUncertainty::None => {}
        }
    }

    fn covariance(&self) -> DMatrix<f64> {
        match self.poses {
            PoseUncertainty::Smoothed(posterior) => posterior.of_functional(&self.by_node),
            _ => {
                let zero = DMatrix::zeros(self.by_node.rows(), self.by_node.rows());
                let blocks = self.by_block.values();
                blocks.fold(zero, |sum, block| sum + block * block.transpose())
            }
        }
    }
}

/// Covariance of the mountings (δp, δφ), zero in fixed and unobservable directions: M S Mᵀ with M =
/// B (BᵀNB)⁻¹ and S the covariance of the gradient Bᵀg. N is the normal matrix without what noise of normals adds to it.
/// `None` if BᵀNB is not positive definite.
pub fn covariance(input: &Input<'_>, solved: &Solved) -> Option<DMatrix<f64>> {
    let state = &solved.state;
    let basis = solved.observability.determined(&state.mountings);
    let without = &state.equations.matrix - &solved.noise_of_normals;
    let spread = &basis * Cholesky::new(basis.transpose() * without * &basis)?.inverse();
    let modelled = gradient_covariance(
        &state.surface,
        solved.floor_m,
        input.trajectory,
        input.poses,
    );
    let modelled = basis.transpose() * modelled * &basis;
    let places = places::equations(&state.surface, solved.floor_m, solved.width_m);
    let change = change(&input.mountings, &state.mountings);
    let contradictions = places::contradictions(&places, &state.equations.matrix, &basis, &change);
    let lacking =
        contradictions.and_then(|all| places::lacking(&modelled, &all, places.len() as f64));
    let mut gradient = modelled;
    for vector in lacking.into_iter().flatten() {
        gradient += &vector * vector.transpose();
    }
    let covariance = &spread * gradient * spread.transpose();
    Some((&covariance + covariance.transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::DVector;

    use super::*;
    use crate::calibration::scale::ScaleProblem;
    use crate::calibration::small_case::{FLOOR_M, case, ground, problem, surface};
    use crate::geometry::{WorldFromBody, so3};
    use crate::sensor::{PoseRecord, PoseSigma};

    /// g with planes, weights and derivatives frozen on `surface` and the points at `world`.
    fn frozen_gradient(surface: &Surface, world: &[Vec3]) -> DVector<f64> {
        let cloud = &surface.cloud;
        let mut gradient = DVector::zeros(6 * cloud.scanners);
        for (index, plane) in surface.planes.iter().enumerate() {
            let members = surface.neighbourhoods.members(index);
            let mean =
                members.iter().map(|&m| world[m as usize]).sum::<Vec3>() / members.len() as f64;
            for &member in members {
                let Some(point) = cloud.movable.get(member as usize) else {
                    continue;
                };
                let a = derivative(&surface.mounting_row(member as usize, &plane.normal));
                let distance = plane.normal.dot(&(world[member as usize] - mean));
                let scanner = cloud.profile(point).scanner as usize;
                let mut rows = gradient.rows_mut(6 * scanner, 6);
                rows += a * (weight(plane, FLOOR_M, members.len()) * distance);
            }
        }
        gradient
    }

    #[test]
    fn moving_a_point_moves_the_gradient_as_the_sensitivity_predicts() {
        let (cloud, mountings) = case();
        let surface = surface(cloud, &mountings, 1);
        let sensitivity = Sensitivity::new(&surface, FLOOR_M);
        let before = frozen_gradient(&surface, &surface.placed.world);
        for l in [0, 7, 250, 399] {
            let step = Vec3::new(0.01, -0.02, 0.03);
            let mut world = surface.placed.world.clone();
            world[l] += step;
            let change = frozen_gradient(&surface, &world) - &before;
            for (scanner, gradient) in sensitivity.gradients(l).iter().enumerate() {
                let predicted = gradient * step;
                let moved = change.rows(6 * scanner, 6);
                // Linear in the points: the only difference is rounding.
                assert!(
                    (predicted - moved).amax() < 1e-9 * before.amax(),
                    "point {l}"
                );
            }
        }
    }

    #[test]
    fn errors_of_a_pose_reach_the_gradient_through_the_points() {
        // A common error of position and rotation moves every point of a block of time. The 0.4 s of
        // the case make one block, or three.
        let (mut cloud, mountings) = case();
        let world_from_body = WorldFromBody::new(
            so3::exp(&Vec3::new(0.1, -0.2, 0.3)),
            Vec3::new(1.0, 2.0, 3.0),
        );
        for profile in Arc::make_mut(&mut cloud.profiles) {
            profile.rotation = *world_from_body.rotation.to_rotation_matrix().matrix();
            profile.translation_m = world_from_body.translation_m;
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
        let surface = surface(cloud, &mountings, 1);
        let covariance_with = |poses| gradient_covariance(&surface, FLOOR_M, &trajectory, poses);
        let before = frozen_gradient(&surface, &surface.placed.world);
        let block_of = |l: usize, correlation_s: f64| {
            let profile = surface.cloud.profile(&surface.cloud.movable[l]);
            (profile.time_s / correlation_s) as usize
        };
        let change_of = |axis: usize, block: usize, correlation_s: f64| {
            let mut world = surface.placed.world.clone();
            for (l, x) in world[..surface.cloud.movable.len()].iter_mut().enumerate() {
                if block_of(l, correlation_s) != block {
                    continue;
                }
                if axis < 3 {
                    x[axis] += sigma.position_m[axis];
                } else {
                    let mut turn = Vec3::zeros();
                    turn[axis - 3] = sigma.rotation_rad[axis - 3];
                    let body_m = surface
                        .cloud
                        .profile(&surface.cloud.movable[l])
                        .translation_m;
                    *x = body_m + so3::exp(&turn) * (*x - body_m);
                }
            }
            frozen_gradient(&surface, &world) - &before
        };
        for (correlation_s, blocks) in [(5.0, 1), (0.15, 3)] {
            let covariance = covariance_with(PoseUncertainty::Sigmas { correlation_s })
                - covariance_with(PoseUncertainty::None);
            let mut expected = DMatrix::zeros(12, 12);
            for (axis, block) in (0..6).flat_map(|axis| (0..blocks).map(move |b| (axis, b))) {
                let change = change_of(axis, block, correlation_s);
                expected += &change * change.transpose();
            }
            // Finite rotations of up to 3e-4 rad differ from their derivative by half of that.
            assert!((&covariance - &expected).amax() < 1e-3 * expected.amax());
        }
    }

    /// The place of the right scanner relative to the left, over ground with hills of this height: the number of
    /// directions that are held, and the covariance.
    fn of_slides(relief_m: f64) -> (usize, DMatrix<f64>) {
        let (cloud, mut mountings) = ground(relief_m);
        mountings[0].fixed = [true; 6];
        mountings[1].fixed = [false, false, true, true, true, true];
        let problem = ScaleProblem {
            floor_m: 1e-3,
            ..problem(cloud)
        };
        let state = problem.at(mountings.clone());
        let nodes = [0.0, 1e4].map(|time_s| PoseRecord {
            time_s,
            world_from_body: WorldFromBody::identity(),
            velocity_m_s: None,
            bias: None,
            sigma: None,
        });
        let trajectory = Trajectory::new(nodes.to_vec()).expect("two nodes");
        let solved = problem.solved(state);
        let covariance = covariance(&Input::new(mountings, &[], &trajectory), &solved);
        let held = solved.observability.unobservable.len();
        (held, covariance.expect("a positive definite matrix"))
    }

    #[test]
    fn slides_over_flat_ground_are_held_and_over_hills_have_standard_deviations() {
        assert_eq!(of_slides(0.0), (2, DMatrix::zeros(12, 12)));
        let (held, covariance) = of_slides(0.1);
        assert_eq!(held, 0);
        // Noise of 6 mm and slopes of about 0.2 at 2,000 points: 6 mm / (0.2 √2000) = 0.7 mm.
        let sigmas_m = [6, 7].map(|i| covariance[(i, i)].sqrt());
        println!("{sigmas_m:?}");
        assert!(
            sigmas_m.iter().all(|s| (0.3e-3..3e-3).contains(s)),
            "{sigmas_m:?}"
        );
    }
}
