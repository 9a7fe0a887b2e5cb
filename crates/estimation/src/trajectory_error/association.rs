//! Poses of two trajectories at the same times.

use crate::error::{Error, Problem, Result};
use crate::geometry::WorldFromBody;
use crate::geometry::so3::{exp, log};
use crate::sensor::PoseRecord;
use crate::statistics::median;

/// Longest gap that is interpolated without being asked to, in median intervals.
const GAP_INTERVALS: f64 = 2.5;

/// The poses of both trajectories at a time.
#[derive(Debug, Clone, Copy)]
pub struct PosePair {
    /// Time of the reference, seconds.
    pub time_s: f64,
    /// The estimate, as it is in its file.
    pub estimate: WorldFromBody,
    /// The reference.
    pub reference: WorldFromBody,
}

/// Which poses are compared.
#[derive(Debug, Clone)]
pub struct Association {
    /// The pairs, in order of time.
    pub pairs: Vec<PosePair>,
    /// Whether it is the reference that is interpolated, at the times of the estimate; else the other way round. It is
    /// the one with more poses in the common time.
    pub interpolates_reference: bool,
    /// Longest interval that is interpolated, seconds.
    pub max_gap_s: f64,
    /// Poses outside the common time.
    pub outside: usize,
    /// Poses in gaps of the other trajectory.
    pub in_gaps: usize,
}

impl Association {
    /// Pairs two trajectories; `time_offset_s` is the time of the reference minus that of the estimate.
    pub(super) fn of(
        estimate: &[PoseRecord],
        reference: &[PoseRecord],
        time_offset_s: f64,
        max_gap_s: Option<f64>,
    ) -> Result<Self> {
        let shifted = |pose: &PoseRecord| (pose.time_s + time_offset_s, pose.world_from_body);
        let estimate: Vec<Timed> = estimate.iter().map(shifted).map(Timed::from).collect();
        let reference: Vec<Timed> = reference
            .iter()
            .map(|pose| Timed::from((pose.time_s, pose.world_from_body)))
            .collect();
        let common = common_span(&estimate, &reference)?;
        let within = |poses: &[Timed]| {
            let is_within = |pose: &&Timed| common.0 <= pose.time_s && pose.time_s <= common.1;
            poses.iter().filter(is_within).count()
        };
        let interpolates_reference = within(&estimate) <= within(&reference);
        let (places, dense) = if interpolates_reference {
            (&estimate, &reference)
        } else {
            (&reference, &estimate)
        };
        let intervals = dense.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
        let typical_s = median(intervals).unwrap_or(0.0);
        let max_gap_s = max_gap_s.unwrap_or(GAP_INTERVALS * typical_s);
        let mut found = Self {
            pairs: Vec::new(),
            interpolates_reference,
            max_gap_s,
            outside: places.len() - within(places),
            in_gaps: 0,
        };
        for place in places.iter() {
            if place.time_s < common.0 || place.time_s > common.1 {
                continue;
            }
            let Some(other) = at(dense, place.time_s, max_gap_s) else {
                found.in_gaps += 1;
                continue;
            };
            let (estimate, reference) = if interpolates_reference {
                (place.pose, other)
            } else {
                (other, place.pose)
            };
            found.pairs.push(PosePair {
                time_s: place.time_s,
                estimate,
                reference,
            });
        }
        if found.pairs.is_empty() {
            return Err(Error::of(
                Problem::NoOverlap,
                format!(
                    "no pose of one trajectory lies between two of the other that are at most {max_gap_s} s apart"
                ),
                "give the longest gap to interpolate with --max-gap-s",
            ));
        }
        Ok(found)
    }
}

/// A pose and its time on the clock of the reference.
#[derive(Debug, Clone, Copy)]
struct Timed {
    time_s: f64,
    pose: WorldFromBody,
}

impl From<(f64, WorldFromBody)> for Timed {
    fn from((time_s, pose): (f64, WorldFromBody)) -> Self {
        Self { time_s, pose }
    }
}

/// First and last time that both have.
fn common_span(estimate: &[Timed], reference: &[Timed]) -> Result<(f64, f64)> {
    let (Some([from, to]), Some([reference_from, reference_to])) =
        (span(estimate), span(reference))
    else {
        return Err(Error::of(
            Problem::TooFew,
            "a trajectory has no poses",
            "check the file",
        ));
    };
    let common = (from.max(reference_from), to.min(reference_to));
    if common.0 > common.1 {
        return Err(Error::of(
            Problem::NoOverlap,
            format!(
                "the trajectories have no common time: the estimate lasts from {from} s to {to} s, the reference from \
                 {reference_from} s to {reference_to} s"
            ),
            "if their clocks differ, give the difference with --time-offset-s",
        ));
    }
    Ok(common)
}

fn span(poses: &[Timed]) -> Option<[f64; 2]> {
    Some([poses.first()?.time_s, poses.last()?.time_s])
}

/// The pose at a time: straight between its neighbours and turning evenly. `None` if they are more than `max_gap_s`
/// apart.
fn at(poses: &[Timed], time_s: f64, max_gap_s: f64) -> Option<WorldFromBody> {
    let after = poses.partition_point(|pose| pose.time_s < time_s);
    let next = poses.get(after)?;
    if next.time_s == time_s {
        return Some(next.pose);
    }
    let last = poses.get(after.checked_sub(1)?)?;
    let interval_s = next.time_s - last.time_s;
    if interval_s > max_gap_s {
        return None;
    }
    let share = (time_s - last.time_s) / interval_s;
    let turn = log(&(last.pose.rotation.inverse() * next.pose.rotation));
    Some(WorldFromBody::new(
        last.pose.rotation * exp(&(turn * share)),
        last.pose
            .translation_m
            .lerp(&next.pose.translation_m, share),
    ))
}
