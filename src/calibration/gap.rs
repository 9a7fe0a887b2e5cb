//! Whether two scanners keep their distance along the drive.
//!
//! What two scanners see on one spot at nearly the same time lies apart by an error of the mountings, and not by
//! one of the poses: these are the same for both. Where that distance changes along the drive, a mounting moves
//! on the other, with or without a reference.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use super::constancy::upward_normal;
use crate::cloud::StructureTensor;
use crate::geometry::Vec3;
use crate::statistics::{median, rms};
use crate::surface::Surface;

/// Length of a block, seconds.
const BLOCK_S: f64 = 2.0;
/// Points of one pass lie within this time, seconds: poses drift less against themselves than
/// [`LEAST_SIGMA_M`].
const PASS_S: f64 = 5.0;
/// Fewest points of the other scanner beside one.
const MIN_BESIDE: usize = 4;
/// Fewest points in a block, and fewest blocks.
const MIN_POINTS: usize = 30;
const MIN_BLOCKS: usize = 10;
/// What mountings that are known to some tenths of a millimetre do to it on slopes and boards, metres.
const LEAST_SIGMA_M: f64 = 3e-4;
/// A change counts up to this many standard deviations: a foot in one block is no mounting that moves.
const MOST_SIGMAS: f64 = 6.0;
/// Root mean square of the changes, over what is expected of them, beyond which a mounting moves on the other.
const MAX_RATIO: f64 = 2.0;

/// How the distance between two scanners changes along the drive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gap {
    /// Their places.
    pub scanners: [usize; 2],
    /// Root mean square of its changes over blocks of 2 s, metres.
    pub rms_m: f64,
    /// The same over what is expected.
    pub ratio: f64,
    /// Whether the scanners appear to keep their distance.
    pub constant: bool,
}

/// One block of time.
#[derive(Default)]
struct Sums {
    count: f64,
    sum_m: f64,
    squares_m2: f64,
}

impl Gap {
    /// Of the two scanners whose distance changes most; `None` where too little was seen by two.
    pub fn of(surface: &Surface) -> Option<Self> {
        let count = surface.cloud.scanners;
        let pairs =
            (0..count).flat_map(|first| (first + 1..count).map(move |other| [first, other]));
        let gaps = pairs.filter_map(|scanners| Self::between(surface, scanners));
        gaps.max_by(|a, b| a.ratio.total_cmp(&b.ratio))
    }

    fn between(surface: &Surface, scanners: [usize; 2]) -> Option<Self> {
        let centres = 0..surface.neighbourhoods.centres().len();
        let distances: Vec<(f64, f64)> = centres
            .into_par_iter()
            .filter_map(|index| distance_m(surface, scanners, index))
            .collect();
        let mut blocks = BTreeMap::<i64, Sums>::new();
        for (time_s, distance_m) in distances {
            let sums = blocks.entry((time_s / BLOCK_S).floor() as i64).or_default();
            sums.count += 1.0;
            sums.sum_m += distance_m;
            sums.squares_m2 += distance_m * distance_m;
        }
        let known = blocks
            .values()
            .filter(|sums| sums.count >= MIN_POINTS as f64);
        let known: Vec<[f64; 2]> = known
            .map(|sums| {
                let mean_m = sums.sum_m / sums.count;
                let variance_m2 = (sums.squares_m2 / sums.count - mean_m * mean_m).max(0.0);
                [
                    mean_m,
                    (variance_m2 / sums.count).sqrt().hypot(LEAST_SIGMA_M),
                ]
            })
            .collect();
        if known.len() < MIN_BLOCKS {
            return None;
        }
        let usual_m = median(known.iter().map(|[mean_m, _]| *mean_m))?;
        let changes = || {
            known
                .iter()
                .map(|[mean_m, sigma_m]| (mean_m - usual_m, sigma_m))
        };
        let ratio = rms(changes()
            .map(|(change_m, sigma_m)| (change_m / sigma_m).clamp(-MOST_SIGMAS, MOST_SIGMAS)));
        Some(Self {
            scanners,
            rms_m: rms(changes().map(|(change_m, _)| change_m)),
            ratio,
            constant: ratio < MAX_RATIO,
        })
    }
}

/// How far a point of the first scanner lies above those of the other beside it, along the normal, with its
/// time.
fn distance_m(surface: &Surface, [first, other]: [usize; 2], index: usize) -> Option<(f64, f64)> {
    let Surface { cloud, placed, .. } = surface;
    let centre = surface.neighbourhoods.centres()[index] as usize;
    let own = cloud.profile(cloud.movable.get(centre)?);
    if own.scanner as usize != first {
        return None;
    }
    let members = surface.neighbourhoods.of(index);
    let is_beside = |&&member: &&u32| {
        let point = cloud.movable.get(member as usize);
        let profile = point.map(|point| cloud.profile(point));
        profile.is_some_and(|profile| {
            profile.scanner as usize == other && (profile.time_s - own.time_s).abs() < PASS_S
        })
    };
    let beside = members
        .iter()
        .filter(is_beside)
        .map(|&member| placed.world[member as usize]);
    let beside: Vec<Vec3> = beside.collect();
    if beside.len() < MIN_BESIDE {
        return None;
    }
    let normal = upward_normal(&StructureTensor::of(&placed.world, members))?;
    let mean = beside.iter().sum::<Vec3>() / beside.len() as f64;
    Some((own.time_s, normal.dot(&(placed.world[centre] - mean))))
}
