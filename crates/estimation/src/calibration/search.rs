//! A coarse search over mountings, for starts beyond the reach of any scale.

use rayon::prelude::*;

use super::parameters::Mounting;
use super::sample::ScannerSample;
use crate::cloud::voxel::{VoxelKey, VoxelMap, occupied};
use crate::geometry::{BodyFromScanner, Rotation, Vec3, so3};
use crate::statistics::median;

/// Steps of the search, degrees: each is tried until nothing is better, with shifts as large as half of what
/// it moves.
const STEPS_DEG: [f64; 4] = [10.0, 5.0, 2.5, 1.25];
/// Most moves of one length.
const MAX_MOVES: usize = 4;
/// Most points of a scanner that are placed.
const MAX_POINTS: usize = 8_000;
/// A voxel is as large as this share of what a step moves.
const VOXEL_SHARE: f64 = 0.5;
/// A start is left only where the clouds then take up less space by this share.
const LEAST_GAIN: f64 = 0.15;
/// Fewest points of a voxel, on average, for its clouds to take up a space.
const POINTS_PER_VOXEL: usize = 3;
/// And each move takes off at least this share.
const LEAST_MOVE_GAIN: f64 = 0.03;

/// Mountings from which the clouds take up much less space than from the given ones, as many voxels at half
/// of what a step moves; `None` where the given ones are as good.
///
/// Clouds that do not overlap are each as sharp as can be, so that no measure of sharpness says that they
/// are apart; the space that all take up together does.
pub fn better_start(
    mountings: &[Mounting],
    samples: &[ScannerSample],
    reference: &[Vec3],
) -> Option<Vec<BodyFromScanner>> {
    let mut poses: Vec<BodyFromScanner> = mountings.iter().map(|m| m.body_from_scanner).collect();
    let mut has_moved = false;
    for scanner in 0..poses.len() {
        let fixed = mountings[scanner].fixed;
        let free = Free {
            // Without a reference, the height of all costs nothing.
            heights: !reference.is_empty(),
            shifts: !fixed[..3].contains(&true),
            turns: !fixed[3..].contains(&true),
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
        // From the longest steps, and from shorter ones alone: long ones may leave a start that is near.
        let ends = (0..STEPS_DEG.len()).map(|first| {
            let steps = STEPS_DEG.iter().zip(&voxels).skip(first);
            steps.fold(poses[scanner], |pose, (step_deg, voxels)| {
                descended(sample, pose, step_deg.to_radians(), voxels, free)
            })
        });
        // The finest voxels that hold several points: where each is alone, all take up the same.
        let points = placed(sample, &poses[scanner]).count();
        let space_in = |pose: &BodyFromScanner, level: usize| space(sample, pose, &voxels[level]);
        let full = |level: &usize| POINTS_PER_VOXEL * space_in(&poses[scanner], *level) < points;
        let Some(level) = (0..STEPS_DEG.len()).rev().find(full) else {
            continue;
        };
        let space_of = |pose: &BodyFromScanner| space_in(pose, level);
        let found = ends.map(|pose| (space_of(&pose), pose));
        let Some((after, pose)) = found.min_by_key(|(space, _)| *space) else {
            continue;
        };
        if (after as f64) < (1.0 - LEAST_GAIN) * space_of(&poses[scanner]) as f64 {
            poses[scanner] = pose;
            has_moved = true;
        }
    }
    has_moved.then_some(poses)
}

/// What of a mounting may be changed.
#[derive(Clone, Copy)]
struct Free {
    heights: bool,
    shifts: bool,
    turns: bool,
}

/// Where turns by this angle about all axes, and shifts by a voxel along them, end.
fn descended(
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
        let neighbours = turned.chain(shifted);
        let found: Vec<(usize, BodyFromScanner)> = neighbours
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|pose| (space(sample, &pose, voxels), pose))
            .collect();
        match found.into_iter().min_by_key(|(space, _)| *space) {
            Some(found) if (found.0 as f64) < (1.0 - LEAST_MOVE_GAIN) * best.0 as f64 => {
                best = found;
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

/// Number of voxels that a scanner occupies and nothing else does.
fn space(
    sample: &ScannerSample,
    pose: &BodyFromScanner,
    (voxel_m, base): &(f64, VoxelMap<VoxelKey, ()>),
) -> usize {
    let own = occupied(placed(sample, pose), *voxel_m);
    own.keys().filter(|key| !base.contains_key(*key)).count()
}
