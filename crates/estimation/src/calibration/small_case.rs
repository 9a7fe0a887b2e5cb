//! A small asymmetric scene for tests, with points of every kind.

use std::sync::Arc;

use super::parameters::{Mounting, poses};
use super::scale::ScaleProblem;
use crate::geometry::{BodyFromScanner, Rotation, Vec3, WorldFromBody};
use crate::sensor::PoseRecord;
use crate::surface::{Profile, ProfilePoint, Surface, SurfaceCloud};
use crate::trajectory::Trajectory;

/// The floor s of the thickness.
pub const FLOOR_M: f64 = 0.02;

/// Numbers in [-1, 1) from a linear congruential generator, the same on every platform.
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Two scanners over a bumpy surface, each point with its own pose, and a reference.
pub fn case() -> (SurfaceCloud, Vec<Mounting>) {
    let mut next = numbers();
    let mut scanners = [(); 2].map(|()| (Vec::new(), Vec::new()));
    for i in 0..400 {
        let turn = Rotation::from_scaled_axis(Vec3::new(next(), next(), next()) * 0.3);
        let position_m = Vec3::new(next(), 0.1 * next(), -1.0 + 0.05 * next());
        let (profiles, points) = &mut scanners[i % 2];
        points.push(ProfilePoint {
            profile: profiles.len() as u32,
            position_m,
            count: 1,
        });
        profiles.push(Profile {
            time_s: i as f64 * 1e-3,
            world_from_body: WorldFromBody::new(turn, Vec3::new(next(), next(), 2.0)),
        });
    }
    let fixed = (0..100)
        .map(|_| Vec3::new(next(), next(), 1.0 + 0.3 * next()))
        .collect();
    let mountings = ["left", "right"]
        .map(|name| {
            let translation_m = Vec3::new(0.3 * next(), 0.3 * next(), 0.1 * next());
            let rotation = Rotation::from_scaled_axis(Vec3::new(next(), next(), next()));
            Mounting::new(name, BodyFromScanner::new(rotation, translation_m))
        })
        .to_vec();
    let mut cloud = SurfaceCloud::new(fixed);
    for (profiles, points) in scanners {
        cloud.add_scanner(&profiles, points);
    }
    (cloud, mountings)
}

/// Two scanners that look straight down, of which the points lie between each other, over hills of this height, with noise
/// of ± 1 cm.
pub fn ground(relief_m: f64) -> (SurfaceCloud, Vec<Mounting>) {
    let mut next = numbers();
    let mut scanners = [(); 2].map(|()| (Vec::new(), Vec::new()));
    for i in 0..4000 {
        let (profiles, points) = &mut scanners[i % 2];
        let (x, y) = (next(), next());
        let height_m = relief_m * (3.0 * x + 1.0).sin() * (4.0 * y).cos();
        points.push(ProfilePoint {
            profile: profiles.len() as u32,
            position_m: Vec3::z() * (height_m + 0.01 * next() - 1.0),
            count: 1,
        });
        profiles.push(Profile {
            time_s: i as f64,
            world_from_body: WorldFromBody::new(Rotation::identity(), Vec3::new(x, y, 1.0)),
        });
    }
    let mut cloud = SurfaceCloud::new(Vec::new());
    for (profiles, points) in scanners {
        cloud.add_scanner(&profiles, points);
    }
    let mountings = ["left", "right"].map(|n| Mounting::new(n, BodyFromScanner::identity()));
    (cloud, mountings.to_vec())
}

/// The adjustment of the cloud on one scale.
pub fn problem(cloud: SurfaceCloud) -> ScaleProblem {
    ScaleProblem {
        cloud: Arc::new(cloud),
        voxel_m: 0.5,
        floor_m: FLOOR_M,
        k: 20,
        stride: 1,
        max_iterations: 30,
        pass_gap_s: 3.0,
    }
}

/// The cloud placed, with neighbourhoods of 20 around every `stride`-th point.
pub fn surface(cloud: SurfaceCloud, mountings: &[Mounting], stride: usize) -> Surface {
    Surface::new(Arc::new(cloud), &poses(mountings), 20, stride)
}

/// The poses of a body that rests at the origin for 100 s.
pub fn at_rest() -> Trajectory {
    let record = |time_s| PoseRecord {
        time_s,
        world_from_body: WorldFromBody::identity(),
        velocity_m_s: None,
        bias: None,
        sigma: None,
    };
    Trajectory::new(vec![record(0.0), record(100.0)]).unwrap()
}
