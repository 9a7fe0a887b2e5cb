//! Planes in which several surfels lie.
//!
//! Few noisy points determine the slopes of a surfel poorly. On a floor or a board all slopes are the same, and noise that
//! is taken for slopes would tell where points that only slide along it belong. The slopes of the plane are unknowns: they
//! follow the poses and mountings, which are not yet right when points are sorted.

use rayon::prelude::*;

use super::{SharedPlane, Surfel};
use crate::cloud::voxel::{VoxelKey, VoxelMap};
use crate::geometry::Vec3;

/// Fewest surfels of a plane.
const MIN_SURFELS: usize = 6;
/// Most surfels of a region of which each is asked how many others are like it. One of them is likely to lie in every plane
/// that holds a tenth of the surfels.
const CANDIDATES: usize = 32;
/// Normals in one plane differ by at most this many standard deviations of their noise.
const PLANE_SIGMAS: f64 = 4.0;
/// Square of the sine of 45°, beyond which slopes are no longer small however noisy they are.
const STEEPEST: f64 = 0.5;
/// Least variance of slopes that are estimated one by one, in variances of their noise: if they truly differ by less than
/// their noise, their mean is nearer to each of them than its own estimate.
const OWN_SLOPES: f64 = 2.0;

/// Assumes that surfels without a reference which may lie in one plane with others of their region have the slopes of this
/// plane, as well as the mean of their normals is known. Returns the planes.
pub fn share_slopes(
    surfels: &mut [Surfel],
    region: impl Fn(&Surfel) -> VoxelKey,
) -> Vec<SharedPlane> {
    let mut regions: VoxelMap<VoxelKey, Vec<usize>> = VoxelMap::default();
    for (index, surfel) in surfels.iter().enumerate() {
        if surfel.prior.is_none() {
            regions.entry(region(surfel)).or_default().push(index);
        }
    }
    let mut regions: Vec<Vec<usize>> = regions.into_values().collect();
    regions.sort_unstable();
    let planes: Vec<(Vec<usize>, Plane)> = regions
        .into_par_iter()
        .flat_map_iter(|members| planes(surfels, members))
        .collect();
    for (number, (members, plane)) in (0..).zip(&planes) {
        let sigma = (plane.scatter / plane.count).sqrt();
        for &index in members {
            let assumed = &mut surfels[index].assumed;
            assumed.plane = Some(number);
            assumed.sigma[1..].fill(sigma);
        }
    }
    let shared = planes.into_iter().map(|(_, plane)| plane.shared());
    shared.collect()
}

/// The planes of a region, those with the most surfels first, as far as their slopes are worth sharing.
fn planes(surfels: &[Surfel], mut members: Vec<usize>) -> Vec<(Vec<usize>, Plane)> {
    let mut planes = Vec::new();
    while let Some(alike) = alike(surfels, &members) {
        // Both are in ascending order.
        members.retain(|index| alike.binary_search(index).is_err());
        let plane = Plane::of(surfels, &alike);
        if plane.scatter < OWN_SLOPES * plane.noise {
            planes.push((alike, plane));
        }
    }
    planes
}

/// The most of these surfels whose normals are the same but for noise.
fn alike(surfels: &[Surfel], members: &[usize]) -> Option<Vec<usize>> {
    let around = |normal: &Vec3, variance: f64| {
        let is_like = |index: &usize| {
            let apart = surfels[*index].axes[0].cross(normal).norm_squared();
            let limit = PLANE_SIGMAS * PLANE_SIGMAS * (noise(&surfels[*index]) + variance);
            apart < limit.min(STEEPEST)
        };
        let alike: Vec<usize> = members.iter().copied().filter(is_like).collect();
        (alike.len() >= MIN_SURFELS).then_some(alike)
    };
    let candidates = members
        .iter()
        .step_by(members.len().div_ceil(CANDIDATES).max(1));
    let most = candidates
        .filter_map(|&index| around(&surfels[index].axes[0], noise(&surfels[index])))
        .max_by_key(Vec::len)?;
    around(&Plane::of(surfels, &most).normal, 0.0)
}

/// The variance of the noise of both slopes together.
fn noise(surfel: &Surfel) -> f64 {
    surfel.plane_sigma[1..]
        .iter()
        .map(|sigma| sigma * sigma)
        .sum()
}

/// What surfels of one plane have in common.
struct Plane {
    /// Mean of their normals.
    normal: Vec3,
    /// Variance of a slope about the mean, S = Σ |n × n̄|² / (2 (k − 1)) of k surfels.
    scatter: f64,
    /// Mean variance of the noise of a slope.
    noise: f64,
    count: f64,
}

impl Plane {
    fn of(surfels: &[Surfel], members: &[usize]) -> Self {
        let first = surfels[members[0]].axes[0];
        // Normals have no sign.
        let normal = |index: &usize| {
            let normal = surfels[*index].axes[0];
            normal * normal.dot(&first).signum()
        };
        let mean = members.iter().map(normal).sum::<Vec3>().normalize();
        let count = members.len() as f64;
        let squares = members
            .iter()
            .map(|index| normal(index).cross(&mean).norm_squared());
        let noise = members.iter().map(|index| noise(&surfels[*index]));
        Self {
            normal: mean,
            scatter: squares.sum::<f64>() / (2.0 * (count - 1.0)),
            noise: noise.sum::<f64>() / (2.0 * count),
            count,
        }
    }

    fn shared(&self) -> SharedPlane {
        // Any axes in the plane: across the axis of the world that is farthest from its normal.
        let across = self.normal.cross(&Vec3::ith(self.normal.iamin(), 1.0));
        let u = across.normalize();
        SharedPlane {
            axes: [self.normal, u, self.normal.cross(&u)],
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::*;
    use crate::geometry::so3::exp;

    const SIGMA: f64 = 0.02;

    /// Surfels about a normal whose slopes have noise of [`SIGMA`] and truly scatter by `scatter`, with random axes and
    /// signs.
    fn about(
        normal: Vec3,
        count: usize,
        scatter: f64,
        random: &mut ChaCha8Rng,
    ) -> impl Iterator<Item = Surfel> {
        let across = normal.cross(&Vec3::x()).normalize();
        let other = normal.cross(&across);
        (0..count).map(move |_| {
            let mut draw = || random.sample::<f64, _>(StandardNormal) * SIGMA.hypot(scatter);
            let axis = (normal + across * draw() + other * draw()).normalize();
            let spin = exp(&(axis * random.random_range(0.0..6.0)));
            let u = spin * axis.cross(&Vec3::x()).normalize();
            let sign = if random.random() { 1.0 } else { -1.0 };
            Surfel {
                axes: [axis * sign, u, (axis * sign).cross(&u)],
                plane_sigma: [0.0, SIGMA, SIGMA],
                ..Surfel::default()
            }
        })
    }

    /// The normal that is assumed: n − b u − c v.
    fn assumed(surfel: &Surfel, planes: &[SharedPlane]) -> Vec3 {
        let plane = &planes[surfel.assumed.plane.unwrap() as usize];
        let [b, c] = plane.along([0.0; 2], surfel).map(|slope| slope.value);
        let [normal, u, v] = surfel.axes;
        let normal = (normal - u * b - v * c).normalize();
        normal * normal.z.signum()
    }

    #[test]
    fn a_floor_and_a_board_each_have_their_own_slopes() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (floor, board) = (Vec3::z(), Vec3::new(0.6, 0.0, 0.8));
        let mut surfels: Vec<Surfel> = about(floor, 60, 0.0, &mut random).collect();
        surfels.extend(about(board, 12, 0.0, &mut random));
        let planes = share_slopes(&mut surfels, |_| [0; 3]);
        for (of_plane, normal) in [(&surfels[..60], floor), (&surfels[60..], board)] {
            let expected = SIGMA / (of_plane.len() as f64).sqrt();
            for surfel in of_plane {
                let [_, b, c] = surfel.assumed.sigma;
                assert!(b == c && (b / expected - 1.0).abs() < 0.4, "{b} {expected}");
                // Both slopes within 4 sigma.
                assert!(
                    (assumed(surfel, &planes) - normal).norm() < 4.0 * 2.0_f64.sqrt() * expected
                );
            }
        }
    }

    #[test]
    fn slopes_that_differ_by_more_than_noise_are_their_own() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut shared = |scatter: f64| {
            let mut surfels: Vec<Surfel> = about(Vec3::z(), 200, scatter, &mut random).collect();
            share_slopes(&mut surfels, |_| [0; 3]);
            let is_shared = |surfel: &&Surfel| surfel.assumed.plane.is_some();
            surfels.iter().filter(is_shared).count()
        };
        assert!(shared(0.7 * SIGMA) > 190);
        assert_eq!(shared(1.4 * SIGMA), 0);
        assert_eq!(shared(10.0 * SIGMA), 0);
    }

    #[test]
    fn few_surfels_are_no_plane() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut surfels: Vec<Surfel> = about(Vec3::z(), 5, 0.0, &mut random).collect();
        share_slopes(&mut surfels, |_| [0; 3]);
        assert!(surfels.iter().all(|surfel| surfel.assumed.plane.is_none()));
    }
}
