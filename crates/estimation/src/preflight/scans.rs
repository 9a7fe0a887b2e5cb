//! Whether the scans, placed with the mountings of the project, form a surface at all, and which usual
//! mistake explains it if they do not.

use serde::{Deserialize, Serialize};

use super::alternatives::{Alternative, Mistake, alternatives};
use crate::calibration::{Mounting, ScannerSample};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::statistics::{median, quantile};
use crate::trajectory::Trajectory;

/// Edge of the columns in which heights are compared, metres.
const COLUMN_M: f64 = 0.25;
/// Largest height of a single level within a column, metres: a board tilted by 55° has as much.
const LEVEL_M: f64 = 0.36;
/// Fewest points of a cloud in a column.
const MIN_POINTS: usize = 3;
/// The points of a scanner are divided into clouds by blocks of time, seconds: about one pass each.
const BLOCK_S: f64 = 20.0;
/// Fewest columns that two clouds share.
const MIN_COLUMNS: usize = 20;
/// Largest number of points of a scanner that are placed.
const MAX_POINTS: usize = 30_000;
/// A rough mounting is off by less than this, metres.
const ROUGH_M: f64 = 0.15;
/// An alternative explains the misfit if it leaves less than this share of it.
const LEFT_SHARE: f64 = 0.4;
/// An explanation is as good as another if it leaves less than this factor times what the other leaves.
const AS_GOOD: f64 = 1.2;

/// The scans of a drive before the calibration.
pub struct Placement<'a> {
    /// The mountings of the project.
    pub mountings: &'a [Mounting],
    /// One for each scanner.
    pub samples: &'a [ScannerSample],
    /// Poses of the body.
    pub trajectory: &'a Trajectory,
    /// World, metres; may be empty.
    pub reference: &'a [Vec3],
}

/// How far clouds lie apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Misfit {
    /// Three quarters of what is seen twice lies closer together, metres.
    pub apart_m: f64,
    /// In how many columns something is seen twice.
    pub columns: usize,
}

/// Why clouds lie farther apart than rough mountings place them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Misplaced {
    /// A usual mistake explains it.
    Mistake {
        /// The mistake.
        mistake: Mistake,
        /// How far they lie apart without it.
        left: Misfit,
    },
    /// They are near each other, but not the reference.
    OffReference {
        /// How far they lie from each other, metres.
        among_m: f64,
    },
    /// Something else.
    Unexplained,
}

/// How well the scans fit together with the mountings of the project.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Placed {
    /// With the mountings as they are; `None` where too little is seen twice.
    pub misfit: Option<Misfit>,
    /// What is wrong, if they lie farther apart than a rough mounting explains.
    pub misplaced: Option<Misplaced>,
}

impl Placed {
    /// How far apart the clouds lie, metres.
    pub fn apart_m(&self) -> Option<f64> {
        self.misfit.map(|misfit| misfit.apart_m)
    }

    /// Without the mistake that explains how far they lie apart, if one does.
    pub fn explained(&self) -> Option<Misfit> {
        match self.misplaced {
            Some(Misplaced::Mistake { left, .. }) => Some(left),
            _ => None,
        }
    }

    /// Whether a usual mistake explains how far they lie apart.
    pub fn is_mistaken(&self) -> bool {
        self.explained().is_some()
    }

    /// Whether the clouds lie no farther apart than in another placement, or share far more columns.
    pub fn is_as_close_as(&self, other: &Self) -> bool {
        match (self.misfit, other.misfit) {
            (Some(this), Some(other)) => {
                this.apart_m <= other.apart_m || this.columns > 2 * other.columns
            }
            (_, other) => other.is_none(),
        }
    }

    /// Whether a usual mistake leaves about as little as other mountings do.
    pub fn is_explained_as_well_as(&self, other: &Self) -> bool {
        let pair = self.explained().zip(other.misfit);
        pair.is_some_and(|(explained, other)| {
            explained.apart_m < AS_GOOD * other.apart_m && 4 * explained.columns > 3 * other.columns
        })
    }
}

/// Measures how far apart the clouds lie, and looks for a usual mistake if that is far.
pub fn scans(placement: &Placement<'_>) -> Placed {
    let reference = columns(placement.reference.iter().copied());
    let nominal: Vec<BodyFromScanner> = placement
        .mountings
        .iter()
        .map(|m| m.body_from_scanner)
        .collect();
    let all = |poses: &[BodyFromScanner], late_s: f64| {
        let clouds = (0..poses.len()).map(|scanner| {
            let mut groups = clouds(placement, scanner, &poses[scanner], late_s);
            groups.retain(|group| !group.is_empty());
            groups
        });
        clouds.collect::<Vec<_>>()
    };
    let nominal_clouds = all(&nominal, 0.0);
    let Some(nominal_misfit) = misfit(&nominal_clouds, &reference) else {
        return Placed::default();
    };
    let apart_m = nominal_misfit.apart_m;
    if apart_m < ROUGH_M {
        return Placed {
            misfit: Some(nominal_misfit),
            ..Placed::default()
        };
    }
    let left = alternatives(placement.mountings, &nominal)
        .into_iter()
        .filter_map(|alternative| {
            let clouds = all(&alternative.poses, alternative.late_s);
            let left = misfit(&clouds, &reference)?;
            // An alternative that moves clouds out of each other's way explains nothing.
            let Alternative { mistake, .. } = alternative;
            (left.columns >= nominal_misfit.columns / 2).then_some((left, mistake))
        });
    let best = left
        .chain(higher_reference(&nominal_clouds, &reference).filter(|_| nominal.len() > 1))
        .min_by(|a, b| a.0.apart_m.total_cmp(&b.0.apart_m));
    let explains = |left: &Misfit| left.apart_m < ROUGH_M.min(LEFT_SHARE * apart_m);
    let best = best.filter(|(left, _)| explains(left));
    let among = || misfit(&nominal_clouds, &Columns::default()).filter(|left| explains(left));
    let among = match (&best, reference.is_empty()) {
        (None, false) => among(),
        _ => None,
    };
    let misplaced = match (best, among) {
        (Some((left, mistake)), _) => Misplaced::Mistake { mistake, left },
        (None, Some(Misfit { apart_m, .. })) => Misplaced::OffReference { among_m: apart_m },
        (None, None) => Misplaced::Unexplained,
    };
    Placed {
        misfit: Some(nominal_misfit),
        misplaced: Some(misplaced),
    }
}

/// The misfit with the reference raised or lowered by the median difference in height.
fn higher_reference(scanners: &[Vec<Columns>], reference: &Columns) -> Option<(Misfit, Mistake)> {
    let common = scanners.iter().flatten().flatten();
    let above_m = median(common.filter_map(|(key, height)| Some(height - reference.get(key)?)))?;
    let raised = reference
        .iter()
        .map(|(key, height)| (*key, height + above_m));
    let left = misfit(scanners, &raised.collect())?;
    Some((left, Mistake::ReferenceHeight { above_m }))
}

/// The points of a scanner in the world, seen `late_s` later than their stamps, in one cloud for each block of
/// time.
fn clouds(
    placement: &Placement<'_>,
    scanner: usize,
    pose: &BodyFromScanner,
    late_s: f64,
) -> Vec<Columns> {
    let sample = &placement.samples[scanner];
    let every = sample.points.len().div_ceil(MAX_POINTS).max(1);
    let mut cursor = placement.trajectory.cursor();
    let points = sample.points.iter().step_by(every).filter_map(|point| {
        let profile = &sample.profiles[point.profile as usize];
        let body = if late_s == 0.0 {
            profile.world_from_body
        } else {
            cursor.pose_at(profile.time_s + late_s)?
        };
        let block = (profile.time_s / BLOCK_S).floor();
        Some((block, body.map(&pose.map(&point.position_m))))
    });
    let points: Vec<(f64, Vec3)> = points.collect();
    let blocks = points.chunk_by(|a, b| a.0 == b.0);
    blocks
        .map(|block| columns(block.iter().map(|(_, point)| *point)))
        .collect()
}

/// Median heights by column.
type Columns = VoxelMap<VoxelKey, f64>;

/// Median height of the points in each column that has a single level, not floor and ceiling.
fn columns(points: impl Iterator<Item = Vec3>) -> Columns {
    let mut heights: VoxelMap<VoxelKey, Vec<f64>> = VoxelMap::default();
    for point in points {
        let key = voxel_key(&Vec3::new(point.x, point.y, 0.0), COLUMN_M);
        heights.entry(key).or_default().push(point.z);
    }
    let enough = heights
        .into_iter()
        .filter(|(_, all)| all.len() >= MIN_POINTS);
    let levels = enough.filter_map(|(key, mut all)| {
        all.sort_unstable_by(f64::total_cmp);
        let height = quantile(&all, 0.9) - quantile(&all, 0.1);
        (height < LEVEL_M).then(|| (key, quantile(&all, 0.5)))
    });
    levels.collect()
}

/// How far the clouds of the worst scanner lie, in height, from the reference or, without one, from what was
/// seen first: three quarters of the distances are smaller, because most of a field is flat and fits however
/// clouds are shifted. Also the number of columns that are shared; `None` where a scanner shares too few.
fn misfit(scanners: &[Vec<Columns>], reference: &Columns) -> Option<Misfit> {
    let mut first = reference.clone();
    if reference.is_empty() {
        // Where two scanners have been, they are compared with each other, not one with itself at another time.
        for column in scanners.iter().flatten() {
            for (key, height) in column {
                first.entry(*key).or_insert(*height);
            }
        }
    }
    let (mut worst_m, mut columns): (Option<f64>, usize) = (None, 0);
    for clouds in scanners {
        let common = clouds.iter().flatten();
        let apart = common.filter_map(|(key, height)| Some((height - first.get(key)?).abs()));
        // What was seen first has no distance from itself.
        let mut apart: Vec<f64> = apart.filter(|m| *m > 0.0).collect();
        if apart.len() < MIN_COLUMNS {
            if reference.is_empty() && scanners.len() > 1 {
                continue;
            }
            return None;
        }
        columns += apart.len();
        apart.sort_unstable_by(f64::total_cmp);
        let apart_m = quantile(&apart, 0.75);
        worst_m = Some(worst_m.map_or(apart_m, |worst_m| worst_m.max(apart_m)));
    }
    worst_m.map(|apart_m| Misfit { apart_m, columns })
}
