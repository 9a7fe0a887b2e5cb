//! A scene from the points that were kept of a drive.

use rayon::prelude::*;

use super::distances::Distances;
use super::passes::Passes;
use super::places::{Place, places};
use super::quantised::{Bytes, Places, Range16, Track, step_31};
use super::{Fan, REFERENCE_STEP_M, Scene, Variant};
use crate::comparison::{Against, Agreement, Agreements, ComparisonSettings, MountingKind};
use crate::geometry::{Bending, BodyFromScanner, Vec3, WorldFromBody};
use crate::report::number::nice_above;
use crate::sensor::ScanPoint;
use crate::statistics::quantile;
use crate::trajectory::Trajectory;

/// Most profiles of a scanner: each has its poses.
const MOST_PROFILES: usize = 20_000;
/// Most points of the reference, beside those around the places of sections.
const MOST_REFERENCE: usize = 60_000;
/// Radius around the place of a section within which all points are taken, metres.
const PLACE_RADIUS_M: f64 = 0.2;
/// Smallest step of positions, metres, and of times, seconds.
const LEAST_STEP: f64 = 1e-6;
/// Quantile of the sizes of distances that their bytes reach to.
const REACHED: f64 = 0.995;

/// What is known of a drive.
pub struct Input<'a> {
    /// Origin of the coordinates, which they lack, metres.
    pub origin_m: Vec3,
    /// One a scanner.
    pub scans: Vec<Scan<'a>>,
    /// The ways in which the points are placed; the last is that of the result.
    pub views: Vec<View<'a>>,
    /// The distances.
    pub agreements: &'a Agreements,
    /// How they were found.
    pub settings: &'a ComparisonSettings,
    /// The reference, metres; empty without one.
    pub reference: &'a [Vec3],
    /// About how many points are taken.
    pub most_points: usize,
}

/// The points of a scanner.
pub struct Scan<'a> {
    /// Name of the scanner.
    pub name: &'a str,
    /// Added to its times to get those of the trajectory, seconds.
    pub time_offset_s: f64,
    /// Number of points with a pose in its recordings.
    pub of: u64,
    /// A sample of them, in the order of their times, each with the number of its profile.
    pub points: &'a [(u32, ScanPoint)],
}

/// A way in which points are placed.
pub struct View<'a> {
    /// The mountings.
    pub kind: MountingKind,
    /// The poses of the body.
    pub trajectory: &'a Trajectory,
    /// One a scanner.
    pub mountings: &'a [BodyFromScanner],
    /// How each moves about it; empty where they are rigid.
    pub bending: &'a [Bending],
}

impl View<'_> {
    fn mounting(&self, scanner: usize, time_s: f64) -> BodyFromScanner {
        let mean = &self.mountings[scanner];
        let bending = self.bending.get(scanner);
        bending.map_or(*mean, |bending| bending.apply(mean, time_s))
    }
}

/// Points of one profile, and the pose of the body by each of the trajectories.
struct Profile<'a> {
    number: u32,
    time_s: f64,
    points: &'a [(u32, ScanPoint)],
    poses: Vec<WorldFromBody>,
}

/// The scene of a drive; `None` without points or views.
pub fn gather(input: &Input) -> Option<Scene> {
    let result = input.views.last()?;
    let mut trajectories: Vec<&Trajectory> = Vec::new();
    let mut poses_of = Vec::new();
    for view in &input.views {
        let known = trajectories
            .iter()
            .position(|known| *known == view.trajectory);
        poses_of.push(known.unwrap_or(trajectories.len()));
        if known.is_none() {
            trajectories.push(view.trajectory);
        }
    }
    let scans: Vec<Vec<Profile>> = input
        .scans
        .iter()
        .map(|scan| profiles(scan, &trajectories))
        .collect();
    let passes = Passes::of(result.trajectory);
    let last = poses_of.last().copied().unwrap_or(0);
    let places = places(&placed(&scans, result, last, &passes));

    let selected = select(&scans, input, (result, last), &places);
    let every = selected.iter().flatten();
    let origin_m = every.clone().next()?.0.poses[last]
        .translation_m
        .map(f64::round);
    let start_s = every
        .clone()
        .map(|(p, _)| p.time_s)
        .fold(f64::INFINITY, f64::min);
    let reach = |sizes: &mut dyn Iterator<Item = f64>| sizes.fold(1.0, f64::max);
    let step_m = step_31(
        LEAST_STEP,
        reach(&mut every.clone().flat_map(|(profile, _)| {
            let poses = profile.poses.iter();
            poses.map(|pose| (pose.translation_m - origin_m).amax())
        })),
    );
    let step_s = step_31(
        LEAST_STEP,
        reach(&mut every.clone().map(|(profile, _)| profile.time_s - start_s)),
    );
    let fans = input.scans.iter().zip(&selected).map(|(scan, profiles)| {
        let points = || profiles.iter().flat_map(|(_, points)| points);
        let axis = |axis: usize| Range16::of(points().map(move |p| p.position_m[axis]));
        let time =
            |(profile, _): &(Profile, _)| ((profile.time_s - start_s) / step_s).round() as i32;
        Fan {
            name: scan.name.into(),
            of: scan.of,
            coordinates: [axis(0), axis(1), axis(2)],
            counts: profiles
                .iter()
                .map(|(_, points)| points.len() as u16)
                .collect(),
            times: profiles.iter().map(time).collect(),
            numbers: profiles.iter().map(|(p, _)| p.number as i32).collect(),
            passes: profiles.iter().map(|(p, _)| passes.at(p.time_s)).collect(),
        }
    });
    let track = |set: usize, profiles: &[(Profile, Vec<ScanPoint>)]| {
        let mut track = Track::default();
        for (profile, _) in profiles {
            track.push(&profile.poses[set], &origin_m, step_m);
        }
        track
    };
    let poses = (0..trajectories.len()).map(|set| selected.iter().map(|s| track(set, s)).collect());
    let variants = input.views.iter().zip(&poses_of);
    let (reference, reference_of) = reference(input.reference, &places, &origin_m);
    Some(Scene {
        origin_m: origin_m + input.origin_m,
        step_m,
        start_s,
        step_s,
        fans: fans.collect(),
        poses: poses.collect(),
        variants: variants
            .map(|(view, &set)| variant(view, set, &selected, input, step_m))
            .collect(),
        against: if input.reference.is_empty() {
            "another scanner"
        } else {
            "the reference"
        }
        .into(),
        reference,
        reference_of,
        places: places
            .into_iter()
            .map(|place| Place {
                centre_m: place.centre_m - origin_m,
                ..place
            })
            .collect(),
        place_radius_m: PLACE_RADIUS_M,
    })
}

/// Whether the n-th of `of` things is one of about `most` that are evenly spread.
fn is_one_of(n: u64, most: usize, of: usize) -> bool {
    // Multiples of the golden ratio are spread evenly over [0, 2⁶⁴).
    let place = n.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    place as f64 / 2f64.powi(64) * (of as f64) < most as f64
}

/// The profiles of a scanner that have a pose by every trajectory, at most [`MOST_PROFILES`].
fn profiles<'a>(scan: &Scan<'a>, trajectories: &[&Trajectory]) -> Vec<Profile<'a>> {
    let all: Vec<_> = scan
        .points
        .chunk_by(|a, b| a.0 == b.0 && a.1.time_s == b.1.time_s)
        .collect();
    let mut cursors: Vec<_> = trajectories.iter().map(|t| t.cursor()).collect();
    let many = all.len();
    let some = all
        .into_iter()
        .zip(0..)
        .filter(|(_, n)| is_one_of(*n, MOST_PROFILES, many));
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

/// All points, with a number for the pass of the scanner that saw them.
fn placed(scans: &[Vec<Profile>], view: &View, set: usize, passes: &Passes) -> Vec<(Vec3, u32)> {
    let mut all = Vec::new();
    for (scanner, profiles) in scans.iter().enumerate() {
        for profile in profiles {
            let pose = profile.poses[set] * view.mounting(scanner, profile.time_s);
            let pass = u32::from(passes.at(profile.time_s));
            let by = scanner as u32 + scans.len() as u32 * pass;
            let points = profile.points.iter();
            all.extend(points.map(|(_, point)| (pose.map(&point.position_m), by)));
        }
    }
    all
}

/// The profiles with points that are shown: those around the places, and of the others about as many as asked for.
fn select<'a>(
    scans: &'a [Vec<Profile<'a>>],
    input: &Input,
    (view, set): (&View, usize),
    places: &[Place],
) -> Vec<Vec<(Profile<'a>, Vec<ScanPoint>)>> {
    let of = scans
        .iter()
        .flatten()
        .map(|profile| profile.points.len())
        .sum();
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
                if is_one_of(n, input.most_points, of) || is_near(&pose.map(&point.position_m)) {
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

fn variant(
    view: &View,
    set: usize,
    selected: &[Vec<(Profile, Vec<ScanPoint>)>],
    input: &Input,
    step_m: f64,
) -> Variant {
    let moves = !view.bending.is_empty();
    let moving = selected.iter().enumerate().filter(|_| moves);
    let moving = moving.map(|(scanner, profiles)| {
        let mut track = Track::default();
        for (profile, _) in profiles {
            let mounting = view.mounting(scanner, profile.time_s);
            track.push(&mounting, &Vec3::zeros(), step_m);
        }
        track
    });
    let known: Vec<Vec<[f64; 2]>> = selected
        .par_iter()
        .enumerate()
        .map(|(scanner, profiles)| distances(view, set, (scanner, profiles), input))
        .collect();
    let limit = |which: usize| {
        let all = known.iter().flatten().map(|values| values[which].abs());
        let mut sizes: Vec<f64> = all.filter(|size| size.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        nice_above(quantile(&sizes, REACHED).max(1e-4))
    };
    let (most, most_detected) = (limit(0), limit(1));
    let bytes = |which: usize, ends: (f64, f64)| -> Vec<Bytes> {
        let one = |values: &Vec<[f64; 2]>| Bytes::of(ends, values.iter().map(|v| v[which]));
        known.iter().map(one).collect()
    };
    Variant {
        kind: view.kind,
        poses: set,
        mountings: view.mountings.to_vec(),
        moving: moving.collect(),
        distances: bytes(0, (-most, most)),
        detections: bytes(1, (0.0, most_detected)),
    }
}

/// Distance and level of detection at each point of a scanner, metres; NaN where they are unknown.
fn distances(
    view: &View,
    set: usize,
    (scanner, profiles): (usize, &Vec<(Profile, Vec<ScanPoint>)>),
    input: &Input,
) -> Vec<[f64; 2]> {
    let name = input.scans[scanner].name;
    let wanted = |found: &&Agreement| {
        found.scanner == name
            && match &found.against {
                Against::Reference => true,
                Against::Scanner(_) => input.reference.is_empty(),
            }
    };
    let Some(found) = input.agreements.under(view.kind).find(wanted) else {
        let points = profiles.iter().map(|(_, points)| points.len());
        return vec![[f64::NAN; 2]; points.sum()];
    };
    let settings = input.settings;
    let (reach_m, most_m) = (settings.core_spacing_m, settings.max_distance_m);
    let distances = Distances::new(&found.distances, reach_m, most_m);
    let each = profiles.par_iter().flat_map_iter(|(profile, points)| {
        let pose = profile.poses[set] * view.mounting(scanner, profile.time_s);
        let at = points
            .iter()
            .map(|point| distances.at(&pose.map(&point.position_m)));
        at.collect::<Vec<_>>()
    });
    each.collect()
}

/// The points of the reference that are shown, from the origin, and of how many.
fn reference(all: &[Vec3], places: &[Place], origin_m: &Vec3) -> (Places, u64) {
    let reach = PLACE_RADIUS_M.powi(2);
    let mut shown = Places::default();
    for (point, n) in all.iter().zip(0..) {
        let is_near = places
            .iter()
            .any(|place| (place.centre_m - point).norm_squared() <= reach);
        let from_origin = point - origin_m;
        let fits = from_origin.amax() < f64::from(i32::MAX) * REFERENCE_STEP_M;
        if fits && (is_near || is_one_of(n, MOST_REFERENCE, all.len())) {
            shown.push(&from_origin, REFERENCE_STEP_M);
        }
    }
    (shown, all.len() as u64)
}
