//! Test whether two scanners keep their distance along the drive.
//!
//! The points of two scanners that see the same spot at nearly the same time differ by errors of the mountings, but
//! not of the poses, which are the same for both. If this distance changes along the drive, one scanner moves
//! relative to the other. The test needs no reference.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

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
/// Fewest points of the other scanner near a point.
const MIN_BESIDE: usize = 4;
/// Fewest points in a block.
const MIN_POINTS: usize = 30;
/// Fewest blocks for a test.
const MIN_BLOCKS: usize = 10;
/// Least standard deviation of a block, metres: the effect of mountings that are known to some tenths of a
/// millimetre, on slopes and boards.
const LEAST_SIGMA_M: f64 = 3e-4;
/// Largest change that counts, standard deviations: a foot in view during one block is not a moving mounting.
const MOST_SIGMAS: f64 = 6.0;
/// Root mean square of the changes, divided by their standard deviations, above which the distance counts as
/// changing.
const MAX_RATIO: f64 = 2.0;

/// How the distance between two scanners changes along the drive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Indices of the two scanners.
    pub scanners: [usize; 2],
    /// Root mean square of the changes of the distance over blocks of 2 s, metres.
    pub rms_m: f64,
    /// Root mean square of the changes divided by their standard deviations.
    pub ratio: f64,
    /// Whether the scanners appear to keep their distance.
    pub constant: bool,
}

/// Sums over one block of time.
#[derive(Default)]
struct Sums {
    count: f64,
    sum_m: f64,
    squares_m2: f64,
}

impl Gap {
    /// Tests the two scanners whose distance changes most; `None` if no two scanners saw enough of the same
    /// surface.
    pub fn test(surface: &Surface) -> Option<Self> {
        let centres = 0..surface.neighbourhoods.centres().len();
        let distances: Vec<Vec<Distance>> = centres
            .into_par_iter()
            .map(|index| distances(surface, index))
            .collect();
        let mut pairs = BTreeMap::<[u32; 2], BTreeMap<i64, Sums>>::new();
        for distance in distances.iter().flatten() {
            let block = (distance.time_s / BLOCK_S).floor() as i64;
            let blocks = pairs.entry(distance.scanners).or_default();
            let sums = blocks.entry(block).or_default();
            sums.count += 1.0;
            sums.sum_m += distance.distance_m;
            sums.squares_m2 += distance.distance_m * distance.distance_m;
        }
        let gaps = pairs
            .iter()
            .filter_map(|(scanners, blocks)| Self::between(*scanners, blocks));
        gaps.max_by(|a, b| a.ratio.total_cmp(&b.ratio))
    }

    fn between(scanners: [u32; 2], blocks: &BTreeMap<i64, Sums>) -> Option<Self> {
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
        let median_m = median(known.iter().map(|[mean_m, _]| *mean_m))?;
        let changes = || {
            known
                .iter()
                .map(|[mean_m, sigma_m]| (mean_m - median_m, sigma_m))
        };
        let ratio = rms(changes()
            .map(|(change_m, sigma_m)| (change_m / sigma_m).clamp(-MOST_SIGMAS, MOST_SIGMAS)));
        Some(Self {
            scanners: scanners.map(|scanner| scanner as usize),
            rms_m: rms(changes().map(|(change_m, _)| change_m)),
            ratio,
            constant: ratio < MAX_RATIO,
        })
    }
}

/// Height of a point of the first scanner above nearby points of the second, along the normal.
struct Distance {
    scanners: [u32; 2],
    time_s: f64,
    distance_m: f64,
}

/// Distances of the centre of a neighbourhood to the points of each scanner of higher index.
fn distances(surface: &Surface, index: usize) -> Vec<Distance> {
    let Surface { cloud, placed, .. } = surface;
    let centre = surface.neighbourhoods.centres()[index] as usize;
    let Some(point) = cloud.movable.get(centre) else {
        return Vec::new();
    };
    let profile = cloud.profile(point);
    let members = surface.neighbourhoods.members(index);
    let mut nearby = BTreeMap::<u32, (Vec3, usize)>::new();
    for &member in members {
        let Some(point) = cloud.movable.get(member as usize) else {
            continue;
        };
        let other = cloud.profile(point);
        if other.scanner > profile.scanner && (other.time_s - profile.time_s).abs() < PASS_S {
            let (sum, count) = nearby.entry(other.scanner).or_default();
            *sum += placed.world[member as usize];
            *count += 1;
        }
    }
    nearby.retain(|_, (_, count)| *count >= MIN_BESIDE);
    if nearby.is_empty() {
        return Vec::new();
    }
    let Some(normal) = upward_normal(&StructureTensor::of(&placed.world, members)) else {
        return Vec::new();
    };
    let distance = |(other, (sum, count)): (u32, (Vec3, usize))| Distance {
        scanners: [profile.scanner, other],
        time_s: profile.time_s,
        distance_m: normal.dot(&(placed.world[centre] - sum / count as f64)),
    };
    nearby.into_iter().map(distance).collect()
}
