//! A coarse search over mountings, for starts beyond the reach of any scale.

use rayon::prelude::*;

use super::parameters::Mounting;
use super::sample::ScannerSample;
use super::settings::Reach;
use crate::cloud::voxel::{VoxelKey, VoxelMap, occupied};
use crate::geometry::{BodyFromScanner, Rotation, Vec3, so3};
use crate::statistics::median;

/// Turns of the search, degrees. Each is repeated until no move is better, together with shifts by half of the
/// distance by which the turn moves a point.
const STEPS_DEG: [f64; 4] = [10.0, 5.0, 2.5, 1.25];
/// Most moves of one length.
const MAX_MOVES: usize = 4;
/// Most points of a scanner that are placed.
const MAX_POINTS: usize = 8_000;
/// Edge of a voxel, as a share of the distance by which a turn moves a point.
const VOXEL_SHARE: f64 = 0.5;
/// Least share by which the clouds must occupy less space for the start to be replaced.
const LEAST_GAIN: f64 = 0.15;
/// Fewest points per voxel, on average, for the occupied space to be meaningful.
const POINTS_PER_VOXEL: usize = 3;
/// Least share by which each move must reduce the occupied space.
const LEAST_MOVE_GAIN: f64 = 0.03;

/// Mountings for which the clouds occupy much less space than for the given ones; `None` if the given ones are
/// as good. The space is the number of voxels whose edge is half of the distance by which a turn moves a point.
///
/// Clouds that do not overlap can each be perfectly sharp, so no measure of sharpness shows that they are apart;
/// the space that they occupy together does.
pub fn better_start(
    mountings: &[Mounting],
    samples: &[ScannerSample],
    reference: &[Vec3],
) -> Option<Vec<BodyFromScanner>> {
    let mut poses: Vec<BodyFromScanner> = mountings.iter().map(|m| m.body_from_scanner).collect();
    // Over flat ground, a cloud that slides by metres may save space too, but scanners sit on the body.
    let distances_m = poses.iter().map(|pose| pose.translation_m.norm());
    let farthest_m = distances_m.fold(Reach::WRONG.shift_m, f64::max);
    let mut has_moved = false;
    for scanner in 0..poses.len() {
        let fixed = mountings[scanner].fixed;
        let free = Free {
            // Without a reference, the cost does not depend on the common height.
            heights: !reference.is_empty(),
            shifts: !fixed[..3].contains(&true),
            turns: !fixed[3..].contains(&true),
            about_m: poses[scanner].translation_m,
            farthest_m,
        };
        if !free.shifts && !free.turns {
            continue;
        }
        let sample = &samples[scanner];
        let Some(range_m) = median(sample.points.iter().map(|p| p.position_m.norm())) else {
            continue;
        };
        let others = || {
            let others = (0..poses.len()).filter(|other| *other != scanner);
            let placed = others.flat_map(|other| placed(&samples[other], &poses[other]));
            placed.chain(reference.iter().copied())
        };
        let voxels: Vec<(f64, VoxelMap<VoxelKey, ()>)> = STEPS_DEG
            .iter()
            .map(|step_deg| {
                let voxel_m = VOXEL_SHARE * step_deg.to_radians() * range_m;
                (voxel_m, occupied(others(), voxel_m))
            })
            .collect();
        // Start with the longest turns, or only with shorter ones: long turns may leave a start that is near.
        let ends = (0..STEPS_DEG.len()).map(|first| {
            let steps = STEPS_DEG.iter().zip(&voxels).skip(first);
            steps.fold(poses[scanner], |pose, (step_deg, voxels)| {
                descend(sample, pose, step_deg.to_radians(), voxels, free)
            })
        });
        // The finest voxels that hold several points each: if every point is alone in its voxel, all poses occupy
        // the same space.
        let points = placed(sample, &poses[scanner]).count();
        let space_in = |pose: &BodyFromScanner, level: usize| space(sample, pose, &voxels[level]);
        let full = |level: &usize| POINTS_PER_VOXEL * space_in(&poses[scanner], *level) < points;
        let Some(level) = (0..STEPS_DEG.len()).rev().find(full) else {
            continue;
        };
        let space_at = |pose: &BodyFromScanner| space_in(pose, level);
        let candidates = ends.map(|pose| (space_at(&pose), pose));
        let Some((after, pose)) = candidates.min_by_key(|(space, _)| *space) else {
            continue;
        };
        if (after as f64) < (1.0 - LEAST_GAIN) * space_at(&poses[scanner]) as f64 {
            poses[scanner] = pose;
            has_moved = true;
        }
    }
    has_moved.then_some(poses)
}

/// The parts of a mounting that may change.
#[derive(Clone, Copy)]
struct Free {
    heights: bool,
    shifts: bool,
    turns: bool,
    /// The given position, and how far from it others may be, metres.
    about_m: Vec3,
    farthest_m: f64,
}

/// The pose that is reached by turns of this angle (radians) about all axes and shifts of a voxel along them, as
/// long as they reduce the occupied space.
fn descend(
    sample: &ScannerSample,
    start: BodyFromScanner,
    angle: f64,
    voxels: &(f64, VoxelMap<VoxelKey, ()>),
    free: Free,
) -> BodyFromScanner {
    let corner = |i: i32| Vec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9));
    let corners = || (0..27).map(|i| corner(i) - Vec3::repeat(1.0));
    let mut best = (space(sample, &start, voxels), start);
    for _ in 0..MAX_MOVES {
        let now = best.1;
        let turned = corners().filter(|_| free.turns).map(|corner| {
            let turn: Rotation = so3::exp(&(corner * angle));
            BodyFromScanner::new(turn * now.rotation, now.translation_m)
        });
        let shifted = corners().filter(|_| free.shifts);
        let shifted = shifted.filter(|corner| free.heights || corner.z == 0.0);
        let shifted = shifted.map(|corner| {
            BodyFromScanner::new(now.rotation, now.translation_m + corner * voxels.0)
        });
        let shifted =
            shifted.filter(|pose| (pose.translation_m - free.about_m).norm() <= free.farthest_m);
        let neighbours = turned.chain(shifted);
        let candidates: Vec<(usize, BodyFromScanner)> = neighbours
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|pose| (space(sample, &pose, voxels), pose))
            .collect();
        match candidates.into_iter().min_by_key(|(space, _)| *space) {
            Some(candidate) if (candidate.0 as f64) < (1.0 - LEAST_MOVE_GAIN) * best.0 as f64 => {
                best = candidate;
            }
            _ => break,
        }
    }
    best.1
}

/// At most [`MAX_POINTS`] of a scanner's points in the world.
fn placed<'a>(
    sample: &'a ScannerSample,
    pose: &'a BodyFromScanner,
) -> impl Iterator<Item = Vec3> + use<'a> {
    let every = sample.points.len().div_ceil(MAX_POINTS).max(1);
    sample.placed_each(every, pose)
}

/// Number of voxels that only this scanner occupies.
fn space(
    sample: &ScannerSample,
    pose: &BodyFromScanner,
    (voxel_m, base): &(f64, VoxelMap<VoxelKey, ()>),
) -> usize {
    let voxels = occupied(placed(sample, pose), *voxel_m);
    voxels.keys().filter(|key| !base.contains_key(*key)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::CalibrationSettings;
    use crate::calibration::small_case::at_rest;

    /// Level ground, 4 m long, seen by a body at rest from this height, and east of it by this distance, metres.
    fn level_ground(mounting: &Mounting, east_m: f64, up_m: f64) -> ScannerSample {
        let points: Vec<Vec3> = (0..8000)
            .map(|i| {
                let (row, column) = (f64::from(i / 100), f64::from(i % 100));
                Vec3::new(east_m + 0.05 * row, 0.04 * column, -up_m)
            })
            .collect();
        let times: Vec<f64> = (0..8000).map(|i| 0.01 * f64::from(i)).collect();
        let settings = CalibrationSettings {
            voxel_sizes_m: vec![0.01],
            ..CalibrationSettings::default()
        };
        ScannerSample::from_points(mounting, &times, &points, &at_rest(), &settings).unwrap()
    }

    #[test]
    fn a_cloud_comes_to_another_only_as_far_as_scanners_sit_apart() {
        let mountings =
            ["left", "right"].map(|name| Mounting::new(name, BodyFromScanner::identity()));
        let found = |east_m: f64| {
            let samples = [0.0, east_m].map(|east_m| level_ground(&mountings[0], east_m, 2.0));
            better_start(&mountings, &samples, &[])
        };
        let near = found(0.35).unwrap();
        assert!((near[1].translation_m.x + 0.35).abs() < 0.1, "{near:?}");
        assert_eq!(found(3.0), None);
    }
}
