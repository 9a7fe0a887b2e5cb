//! Whether the scans, placed with the mountings of the project, make a surface at all, and which usual
//! mistake explains it if they do not.

use super::TIME_SCALES_S;
use crate::calibration::{Mounting, ScannerSample};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::{BodyFromScanner, EulerConvention, Rotation, Vec3};
use crate::statistics::quantile;
use crate::trajectory::Trajectory;
use crate::verdict::Verdict;

/// Edge of the columns in which heights are compared, metres.
const COLUMN_M: f64 = 0.25;
/// Most height of a level in a column: a board of 55° has as much, metres.
const LEVEL_M: f64 = 0.36;
/// Fewest points of a cloud in a column.
const MIN_POINTS: usize = 3;
/// Clouds of one scanner are told apart by blocks of time, seconds: about a pass.
const BLOCK_S: f64 = 20.0;
/// Fewest columns that two clouds share.
const MIN_COLUMNS: usize = 20;
/// Most points of a scanner that are placed.
const MAX_POINTS: usize = 30_000;
/// A rough mounting is off by less than this, metres.
const ROUGH_M: f64 = 0.2;
/// An alternative explains what is off where it leaves this share of it.
const LEFT_SHARE: f64 = 0.4;
/// The scans of a drive before the calibration.
pub struct Placement<'a> {
    /// As the project has them.
    pub mountings: &'a [Mounting],
    /// One a scanner.
    pub samples: &'a [ScannerSample],
    /// Poses of the body.
    pub trajectory: &'a Trajectory,
    /// World, metres; may be empty.
    pub reference: &'a [Vec3],
}

/// One way in which the project may be meant.
struct Alternative {
    poses: Vec<BodyFromScanner>,
    late_s: f64,
    code: &'static str,
    text: String,
}

/// How the scans lie with the mountings of the project.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Placed {
    /// How far apart the clouds lie, metres: three quarters of what is seen twice lie closer.
    pub apart_m: Option<f64>,
    /// What is wrong, if they lie farther apart than a rough mounting explains.
    pub verdict: Option<Verdict>,
}

/// Looks how far the clouds lie apart, and for a usual mistake if that is far.
pub fn scans(placement: &Placement<'_>) -> Placed {
    let reference = columns(placement.reference.iter().copied());
    let own: Vec<BodyFromScanner> = placement
        .mountings
        .iter()
        .map(|m| m.body_from_scanner)
        .collect();
    let misfit = |poses: &[BodyFromScanner], late_s: f64| {
        let clouds = (0..poses.len()).map(|scanner| {
            let mut groups = clouds(placement, scanner, &poses[scanner], late_s);
            groups.retain(|group| !group.is_empty());
            groups
        });
        misfit(&clouds.collect::<Vec<_>>(), &reference)
    };
    let Some((own_m, own_columns)) = misfit(&own, 0.0) else {
        return Placed::default();
    };
    let apart_m = Some(own_m);
    if own_m < ROUGH_M {
        return Placed {
            apart_m,
            verdict: None,
        };
    }
    let left = alternatives(placement.mountings, &own)
        .into_iter()
        .filter_map(|alternative| {
            let (left_m, common) = misfit(&alternative.poses, alternative.late_s)?;
            // One that moves clouds out of each other's way is none.
            (common >= own_columns / 2).then_some((left_m, alternative))
        });
    let best = left.min_by(|a, b| a.0.total_cmp(&b.0));
    let apart = format!("Placed with the project's mountings the clouds lie {own_m:.2} m apart");
    let verdict = match best {
        Some((left_m, found)) if left_m < ROUGH_M.min(LEFT_SHARE * own_m) => {
            let text = format!("{apart}. Only {left_m:.2} m remain {}", found.text);
            Verdict::fault(found.code, text).with_value(left_m, None)
        }
        _ => {
            let text = format!(
                "{apart}: if the result is wrong, check translation, rotation and rotation_convention of the \
                 scanners, their files, their clocks, and where the reference lies."
            );
            Verdict::note("placement.misfit", text).with_value(own_m, None)
        }
    };
    Placed {
        apart_m,
        verdict: Some(verdict),
    }
}

/// The points of a scanner in the world, later by so much, by the blocks of time in which it saw them.
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
        let body = match late_s == 0.0 {
            true => profile.world_from_body,
            false => cursor.pose_at(profile.time_s + late_s)?,
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

/// Median height of the points in each column that has one level: not floor and ceiling.
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

/// Distances in height of each scanner's clouds from the reference, or from what was seen first where there
/// is none: three quarters are smaller, for the worst scanner. Most of a field is flat and fits however
/// clouds are shifted. And how many columns all share; `None` where a scanner shares too few.
fn misfit(scanners: &[Vec<Columns>], reference: &Columns) -> Option<(f64, usize)> {
    let mut first = reference.clone();
    if reference.is_empty() {
        // Of two scanners, not of two moments of one, where both have been.
        for column in scanners.iter().flatten() {
            for (key, height) in column {
                first.entry(*key).or_insert(*height);
            }
        }
    }
    let (mut worst_m, mut common_columns): (Option<f64>, usize) = (None, 0);
    for clouds in scanners {
        let common = clouds.iter().flatten();
        let apart = common.filter_map(|(key, height)| Some((height - first.get(key)?).abs()));
        // What was seen first is no distance from itself.
        let mut apart: Vec<f64> = apart.filter(|m| *m > 0.0).collect();
        if apart.len() < MIN_COLUMNS {
            if reference.is_empty() && scanners.len() > 1 {
                continue;
            }
            return None;
        }
        common_columns += apart.len();
        apart.sort_unstable_by(f64::total_cmp);
        let apart_m = quantile(&apart, 0.75);
        worst_m = Some(worst_m.map_or(apart_m, |worst_m| worst_m.max(apart_m)));
    }
    Some((worst_m?, common_columns))
}

fn alternatives(mountings: &[Mounting], own: &[BodyFromScanner]) -> Vec<Alternative> {
    let mut all = Vec::new();
    let mut add = |poses: Vec<BodyFromScanner>, code, text: String| {
        all.push(Alternative {
            poses,
            late_s: 0.0,
            code,
            text,
        });
    };
    let inverse =
        |pose: &BodyFromScanner| BodyFromScanner::new(pose.rotation.inverse(), pose.translation_m);
    let other = |convention| match convention {
        EulerConvention::Bonn => "zyx",
        EulerConvention::Zyx => "bonn",
    };
    let convention = mountings.first().map_or("zyx", |m| other(m.convention));
    add(
        own.iter().map(inverse).collect(),
        "scanner.convention",
        format!(
            "with the inverse rotations: write rotation_convention = \"{convention}\", or invert the quaternions."
        ),
    );
    for i in 0..own.len() {
        let name = &mountings[i].name;
        if own.len() > 1 {
            let mut poses = own.to_vec();
            poses[i] = inverse(&poses[i]);
            let text = format!(
                "with the inverse rotation of scanner `{name}`: write rotation_convention = \"{}\" there.",
                other(mountings[i].convention)
            );
            add(poses, "scanner.convention", text);
        }
        for (j, other) in mountings.iter().enumerate().skip(i + 1) {
            let mut poses = own.to_vec();
            poses.swap(i, j);
            let text = format!(
                "with the profiles of `{name}` and `{}` exchanged: the files, or the mountings, are those of \
                 the other scanner.",
                other.name
            );
            add(poses, "scanner.swapped", text);
        }
        for (axis, axis_name) in ["x", "y", "z"].into_iter().enumerate() {
            let mut poses = own.to_vec();
            poses[i].translation_m[axis] *= -1.0;
            let text = format!(
                "with the other sign of {axis_name} in the translation of scanner `{name}`."
            );
            add(poses, "scanner.translation", text);
        }
        for (axis, turn) in [
            ("x", Vec3::x_axis()),
            ("y", Vec3::y_axis()),
            ("z", Vec3::z_axis()),
        ] {
            let mut poses = own.to_vec();
            poses[i].rotation *= Rotation::from_axis_angle(&turn, std::f64::consts::PI);
            let text = format!("with scanner `{name}` turned by 180° about its {axis} axis.");
            add(poses, "scanner.rotation", text);
        }
    }
    for (signs, what) in [
        (Vec3::new(1.0, -1.0, -1.0), "y and z"),
        (Vec3::new(1.0, 1.0, -1.0), "z"),
    ] {
        let poses = own.iter().map(|pose| {
            BodyFromScanner::new(pose.rotation, pose.translation_m.component_mul(&signs))
        });
        let text = format!(
            "with the other sign of {what} in all translations: are they given in FLU where the body is FRD, \
             or the other way round?"
        );
        add(poses.collect(), "scanner.translation", text);
    }
    let half_turn = Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    let other_axes = |pose: &BodyFromScanner| {
        BodyFromScanner::new(half_turn * pose.rotation, half_turn * pose.translation_m)
    };
    add(
        own.iter().map(other_axes).collect(),
        "scanner.axes",
        "with mountings whose y and z are negated: they are given in FLU and the body is FRD, or the other \
         way round."
            .into(),
    );
    for (scale_s, scales) in TIME_SCALES_S {
        for late_s in [scale_s, -scale_s] {
            let text = format!(
                "with {late_s:+.0} s added to the times of the scanners: {scales} differ by that. Write \
                 time_offset_s = {late_s:.1} for each scanner."
            );
            all.push(Alternative {
                poses: own.to_vec(),
                late_s,
                code: "scanner.time_offset",
                text,
            });
        }
    }
    all
}
