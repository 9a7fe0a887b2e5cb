//! Selects the points that are shown: profiles with a pose, places of sections, and an even sample.

use super::input::{Scan, View};
use super::passes::Passes;
use super::places::Place;
use super::quantised::Places;
use super::{PLACE_RADIUS_M, REFERENCE_STEP_M};
use crate::geometry::{Vec3, WorldFromBody};
use crate::sensor::ScanPoint;
use crate::trajectory::Trajectory;

/// Most profiles of a scanner; each profile adds its poses to the page.
const MOST_PROFILES: usize = 20_000;
/// Most points that are searched for places of sections.
const MOST_PLACED: usize = 1_000_000;
/// Most points of the reference, in addition to those around the places of sections.
const MOST_REFERENCE: usize = 60_000;

/// A profile of a scanner.
pub struct Profile<'a> {
    /// Its number among those with points in the recordings of the scanner.
    pub number: u32,
    /// Seconds on the common clock.
    pub time_s: f64,
    points: &'a [(u32, ScanPoint)],
    /// The pose of the body by each of the trajectories.
    pub poses: Vec<WorldFromBody>,
}

/// A profile with its points that are shown.
pub type Chosen<'a> = (Profile<'a>, Vec<ScanPoint>);

/// Whether item `n` of `total` items belongs to an evenly spread sample of about `most` items.
fn is_sampled(n: u64, most: usize, total: usize) -> bool {
    // Multiples of the golden ratio are spread evenly over [0, 2⁶⁴).
    let place = n.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    place as f64 / 2f64.powi(64) * (total as f64) < most as f64
}

/// The profiles of a scanner that have a pose by every trajectory, at most [`MOST_PROFILES`].
pub fn profiles<'a>(scan: &Scan<'a>, trajectories: &[&Trajectory]) -> Vec<Profile<'a>> {
    let all: Vec<_> = scan
        .points
        .chunk_by(|a, b| a.0 == b.0 && a.1.time_s == b.1.time_s)
        .collect();
    let mut cursors: Vec<_> = trajectories.iter().map(|t| t.cursor()).collect();
    let many = all.len();
    let some = all
        .into_iter()
        .zip(0..)
        .filter(|(_, n)| is_sampled(*n, MOST_PROFILES, many));
    let known = some.filter_map(|(points, _)| {
        let time_s = points[0].1.time_s + scan.time_offset_s;
        let poses: Option<Vec<_>> = cursors.iter_mut().map(|c| c.pose_at(time_s)).collect();
        Some(Profile {
            number: points[0].0,
            time_s,
            points,
            poses: poses?,
        })
    });
    known.collect()
}

/// About [`MOST_PLACED`] points, each with a number for the pass of the scanner that saw it.
pub fn placed(
    scans: &[Vec<Profile>],
    view: &View,
    set: usize,
    passes: &Passes,
) -> Vec<(Vec3, u32)> {
    let total = count(scans);
    let mut n = 0;
    let mut all = Vec::new();
    for (scanner, profiles) in scans.iter().enumerate() {
        for profile in profiles {
            let pose = profile.poses[set] * view.mounting(scanner, profile.time_s);
            let pass = u32::from(passes.at(profile.time_s));
            let by = scanner as u32 + scans.len() as u32 * pass;
            for (_, point) in profile.points {
                n += 1;
                if is_sampled(n, MOST_PLACED, total) {
                    all.push((pose.map(&point.position_m), by));
                }
            }
        }
    }
    all
}

/// Number of points.
fn count(scans: &[Vec<Profile>]) -> usize {
    let profiles = scans.iter().flatten();
    profiles.map(|profile| profile.points.len()).sum()
}

/// The profiles with the points that are shown: those around the places, and of the rest about the requested number.
pub fn select<'a>(
    scans: &'a [Vec<Profile<'a>>],
    most_points: usize,
    view: &View,
    set: usize,
    places: &[Place],
) -> Vec<Vec<Chosen<'a>>> {
    let total = count(scans);
    let is_near = |point: &Vec3| {
        let reach = PLACE_RADIUS_M.powi(2);
        places
            .iter()
            .any(|place| (place.centre_m - point).norm_squared() <= reach)
    };
    let mut n = 0;
    let mut all = Vec::new();
    for (scanner, profiles) in scans.iter().enumerate() {
        let mut taken = Vec::new();
        for profile in profiles {
            let pose = profile.poses[set] * view.mounting(scanner, profile.time_s);
            let mut points = Vec::new();
            for (_, point) in profile.points {
                n += 1;
                if is_sampled(n, most_points, total) || is_near(&pose.map(&point.position_m)) {
                    points.push(*point);
                }
            }
            points.truncate(usize::from(u16::MAX));
            if !points.is_empty() {
                let profile = Profile {
                    poses: profile.poses.clone(),
                    ..*profile
                };
                taken.push((profile, points));
            }
        }
        all.push(taken);
    }
    all
}

/// The points of the reference that are shown, relative to the origin, and the number of all its points.
pub fn reference(all: &[Vec3], places: &[Place], origin_m: &Vec3) -> (Places, u64) {
    let reach = PLACE_RADIUS_M.powi(2);
    let mut shown = Places::default();
    for (point, n) in all.iter().zip(0..) {
        let is_near = places
            .iter()
            .any(|place| (place.centre_m - point).norm_squared() <= reach);
        let from_origin = point - origin_m;
        let fits = from_origin.amax() < f64::from(i32::MAX) * REFERENCE_STEP_M;
        if fits && (is_near || is_sampled(n, MOST_REFERENCE, all.len())) {
            shown.push(&from_origin, REFERENCE_STEP_M);
        }
    }
    (shown, all.len() as u64)
}
