//! Gathers a scene from the points of a drive that were kept for it.

use super::input::{Input, Scan};
use super::outline::outline;
use super::passes::Passes;
use super::places::{Place, places};
use super::quantised::{Range16, Track, step_31};
use super::select::{Chosen, placed, profiles, reference, select};
use super::surfels::surfels;
use super::variant::variant;
use super::{Fan, PLACE_RADIUS_M, Scene};
use crate::geometry::Vec3;
use crate::trajectory::Trajectory;

/// Smallest step of positions, metres, and of times, seconds.
const LEAST_STEP: f64 = 1e-6;

/// The scene of a drive; `None` without points or views.
pub fn gather(input: &Input) -> Option<Scene> {
    let result = input.views.last()?;
    let mut trajectories: Vec<&Trajectory> = Vec::new();
    let mut sets = Vec::new();
    for view in &input.views {
        let mut known = trajectories.iter();
        let known = known.position(|known| *known == view.trajectory);
        sets.push(known.unwrap_or(trajectories.len()));
        if known.is_none() {
            trajectories.push(view.trajectory);
        }
    }
    let last = sets.last().copied().unwrap_or(0);
    let scans = input.scans.iter();
    let scans: Vec<Vec<_>> = scans.map(|scan| profiles(scan, &trajectories)).collect();
    let passes = Passes::of(result.trajectory);
    let places = places(&placed(&scans, result, last, &passes));
    let selected = select(&scans, input.most_points, result, last, &places);
    let frame = Frame::around(&selected, last)?;

    let scanners = input.scans.iter().zip(&selected);
    let tracks = |set: usize| {
        selected
            .iter()
            .map(|chosen| frame.track(set, chosen))
            .collect()
    };
    let views = input.views.iter().zip(&sets);
    let (reference, reference_of) = reference(input.reference, &places, &frame.origin_m);
    let against = if input.reference.is_empty() {
        "another scanner"
    } else {
        "the reference"
    };
    let places = places.into_iter().map(|place| Place {
        centre_m: place.centre_m - frame.origin_m,
        ..place
    });
    Some(Scene {
        origin_m: frame.origin_m + input.origin_m,
        step_m: frame.step_m,
        start_s: frame.start_s,
        step_s: frame.step_s,
        fans: scanners
            .map(|(scan, chosen)| frame.fan(scan, chosen, &passes))
            .collect(),
        poses: (0..trajectories.len()).map(tracks).collect(),
        variants: views
            .map(|(view, &set)| variant(view, set, &selected, input, frame.step_m))
            .collect(),
        against: against.into(),
        reference,
        reference_of,
        surfels: surfels(input.planes, &frame.origin_m),
        places: places.collect(),
        place_radius_m: PLACE_RADIUS_M,
    })
}

/// Origin and steps of positions and times.
struct Frame {
    origin_m: Vec3,
    step_m: f64,
    start_s: f64,
    step_s: f64,
}

impl Frame {
    /// The frame of the profiles of all scanners, with its origin at a pose of the set `set`; `None` without any.
    fn around(selected: &[Vec<Chosen>], set: usize) -> Option<Self> {
        let all = selected.iter().flatten().map(|(profile, _)| profile);
        let first = all.clone().next()?;
        // An origin in whole metres adds no digits to the coordinates.
        let origin_m = first.poses[set].translation_m.map(f64::round);
        let start_s = all
            .clone()
            .fold(f64::INFINITY, |least, profile| least.min(profile.time_s));
        let mut reach_m: f64 = 1.0;
        let mut reach_s: f64 = 1.0;
        for profile in all {
            reach_s = reach_s.max(profile.time_s - start_s);
            for pose in &profile.poses {
                reach_m = reach_m.max((pose.translation_m - origin_m).amax());
            }
        }
        Some(Self {
            origin_m,
            step_m: step_31(LEAST_STEP, reach_m),
            start_s,
            step_s: step_31(LEAST_STEP, reach_s),
        })
    }

    /// The points of a scanner.
    fn fan(&self, scan: &Scan, chosen: &[Chosen], passes: &Passes) -> Fan {
        let points = || chosen.iter().flat_map(|(_, points)| points);
        let axis = |axis: usize| Range16::of(points().map(move |p| p.position_m[axis]));
        let time = |time_s: f64| ((time_s - self.start_s) / self.step_s).round() as i32;
        let profiles = || chosen.iter().map(|(profile, _)| profile);
        let counts = chosen.iter().map(|(_, points)| points.len() as u16);
        Fan {
            name: scan.name.into(),
            total: scan.total,
            coordinates: [axis(0), axis(1), axis(2)],
            counts: counts.collect(),
            times: profiles().map(|profile| time(profile.time_s)).collect(),
            numbers: profiles().map(|profile| profile.number as i32).collect(),
            passes: profiles()
                .map(|profile| passes.at(profile.time_s))
                .collect(),
            outline_m: outline(points().map(|point| point.position_m)),
        }
    }

    /// The poses of the profiles of a scanner, by the trajectory number `set`.
    fn track(&self, set: usize, chosen: &[Chosen]) -> Track {
        let mut track = Track::default();
        for (profile, _) in chosen {
            track.push(&profile.poses[set], &self.origin_m, self.step_m);
        }
        track
    }
}
