//! The truth of simulated drives, and how far the results of an adjustment are from it.
#![allow(dead_code)] // tests and examples use their parts

use std::collections::BTreeMap;

use boresight::calibration::ScannerSample;
use boresight::comparison::{ComparisonSettings, Normals, Statistics, core_points, m3c2};
use boresight::error::Result;
use boresight::format;
use boresight::geometry::{BodyFromScanner, Vec3, WorldFromBody};
use boresight::joint::{Joint, MovedMounting};
use boresight::progress::Silent;
use boresight::sensor::PoseRecord;
use boresight::simulation::{Scenario, SimulatedDrive};
use boresight::statistics::rms;
use boresight::trajectory::Trajectory;

use super::moving::mountings_in;

/// The result of one method, and its errors.
pub struct Outcome {
    pub mountings: Vec<BodyFromScanner>,
    /// Root mean square error of the poses of profiles with points in the field, metres.
    pub poses_m: f64,
    /// Root mean square error of the points in the field, from poses and mountings without the scanner's noise, metres.
    pub points_m: f64,
    /// Root mean square height difference of the points of both scanners in cells of [`CELL_M`] and spans of
    /// [`PASS_S`], metres.
    pub gap_m: f64,
    /// Root mean square of the M3C2 distances to the reference, for these poses and mountings and for the exact ones,
    /// metres; NaN without a reference.
    pub distances_m: [f64; 2],
    pub seconds: f64,
}

pub fn true_poses(drive: &SimulatedDrive) -> Result<Trajectory> {
    let file = drive.folder.join("truth/trajectory.csv");
    Trajectory::new(format::read_trajectory(&file)?)
}

/// Errors (δp, δφ) of all mountings in body axes, metres and radians.
pub fn mounting_errors(mountings: &[BodyFromScanner], truth: &[BodyFromScanner]) -> Vec<f64> {
    let errors = mountings.iter().zip(truth).flat_map(|(mounting, truth)| {
        let (turn, shift) = mounting.perturbation_from(truth);
        [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
    });
    errors.collect()
}

/// A mounting that is stored as a pose of a trajectory.
pub fn as_mounting(pose: &WorldFromBody) -> BodyFromScanner {
    BodyFromScanner::new(pose.rotation, pose.translation_m)
}

/// The mean of mountings that are all close to `near`.
pub fn middle(
    near: &BodyFromScanner,
    mountings: impl ExactSizeIterator<Item = BodyFromScanner>,
) -> BodyFromScanner {
    let count = mountings.len() as f64;
    let (mut turns, mut shifts) = (Vec3::zeros(), Vec3::zeros());
    for mounting in mountings {
        let (turn, shift) = mounting.perturbation_from(near);
        turns += turn;
        shifts += shift;
    }
    near.perturbed(&(turns / count), &(shifts / count))
}

/// Replaces true and adjusted mountings by their means over the part of the drive that the true motion covers.
pub fn average_over_motion(
    truth: &mut [BodyFromScanner],
    mountings: &mut [BodyFromScanner],
    moving: &[Trajectory],
    bending: &[MovedMounting],
) {
    for (scanner, moving) in moving.iter().enumerate() {
        let (records, mean) = (moving.poses().iter(), mountings[scanner]);
        let exact = records
            .clone()
            .map(|pose| as_mounting(&pose.world_from_body));
        truth[scanner] = middle(&truth[scanner], exact);
        if let Some(moved) = bending.get(scanner) {
            let now = records.map(|pose| moved.offsets.apply(&mean, pose.time_s));
            mountings[scanner] = middle(&mean, now);
        }
    }
}

/// The true mountings along a drive; empty if they are rigid.
pub fn true_mountings(scenario: &Scenario, drive: &SimulatedDrive) -> Result<Vec<Trajectory>> {
    if !scenario.deformation.enabled {
        return Ok(Vec::new());
    }
    let scanners = scenario.scanners.iter();
    let files = scanners.map(|s| drive.folder.join(format!("truth/mounting-{}.csv", s.name)));
    let poses = files.map(|file| {
        let rows = mountings_in(&file)?.into_iter();
        let pose = |m: BodyFromScanner| WorldFromBody::new(m.rotation, m.translation_m);
        Trajectory::new(rows.map(|(t, m)| PoseRecord::new(t, pose(m))).collect())
    });
    poses.collect()
}

/// The truth with which results are compared.
pub struct Check<'a> {
    pub scenario: &'a Scenario,
    pub samples: &'a [ScannerSample],
    pub exact: &'a Trajectory,
    pub truth: &'a [BodyFromScanner],
    /// True mountings along the drive; empty if they are rigid.
    pub moving: Vec<Trajectory>,
    /// The reference cloud; empty if there is none.
    pub reference: &'a [Vec3],
}

/// Every fourth point is compared.
const EACH: usize = 4;
/// Side of the cells in which both scanners are compared, metres, and the time within which both see a cell, seconds.
const CELL_M: f64 = 0.05;
const PASS_S: f64 = 10.0;

/// The mounting of a scanner at a time: its mean, moved by the bending of the frame.
fn mounted(
    means: &[BodyFromScanner],
    bending: &[MovedMounting],
    scanner: usize,
    time_s: f64,
) -> BodyFromScanner {
    match bending.get(scanner) {
        Some(moved) => moved.offsets.apply(&means[scanner], time_s),
        None => means[scanner],
    }
}

impl Check<'_> {
    /// The true pose of the body and the true position of a point; `None` for a point outside the field.
    fn true_point(
        &self,
        scanner: usize,
        true_s: f64,
        in_scanner_m: &Vec3,
    ) -> Option<(WorldFromBody, Vec3)> {
        let exact = self.exact.pose_at(true_s)?;
        let mounted = match self.moving.get(scanner) {
            Some(moving) => as_mounting(&moving.pose_at(true_s)?),
            None => self.truth[scanner],
        };
        let point = exact.map(&mounted.map(in_scanner_m));
        let [east, north] = self.scenario.field.size_m;
        let within = (0.0..=east).contains(&point.x) && (0.0..=north).contains(&point.y);
        within.then_some((exact, point))
    }

    /// Errors of the points for which the adjustment gives standard deviations, and these, metres.
    pub fn point_errors(&self, joint: &Joint, late_s: &[f64]) -> Vec<[Vec3; 2]> {
        let drive = &joint.drives[0];
        let points = (0..)
            .zip(&drive.points)
            .flat_map(|(scanner, points)| points.iter().map(move |p| (scanner, p)));
        let mountings = joint.poses();
        let errors = points.filter_map(|(scanner, point): (usize, _)| {
            let stamp_s = point.time_s + late_s[scanner];
            let true_s = stamp_s - self.scenario.scanners[scanner].latency_s;
            let (_, truth) = self.true_point(scanner, true_s, &point.in_scanner_m)?;
            let pose = drive.trajectory.pose_at(point.time_s)?;
            let mounting = mounted(&mountings, &drive.bending, scanner, point.time_s);
            let adjusted = pose.map(&mounting.map(&point.in_scanner_m));
            Some([adjusted - truth, point.sigma_m])
        });
        errors.collect()
    }

    /// Root mean square of the M3C2 distances of points to the reference, metres.
    fn distance_m(&self, points: &[Vec3]) -> f64 {
        if self.reference.is_empty() {
            return f64::NAN;
        }
        let settings = ComparisonSettings::default();
        let core = core_points(self.reference, &settings);
        let normals = Normals::UPWARDS;
        let distances = m3c2(self.reference, points, &core, normals, &settings, &Silent);
        let statistics = distances.and_then(|distances| Statistics::of(&distances));
        statistics.map_or(f64::NAN, |statistics| statistics.rmse_m)
    }

    /// Assesses mountings and poses; `late_s` are the delays of the scanners.
    pub fn outcome(
        &self,
        mountings: Vec<BodyFromScanner>,
        poses: &Trajectory,
        late_s: &[f64],
        bending: &[MovedMounting],
        seconds: f64,
    ) -> Outcome {
        let (mut pose_sum, mut pose_count) = (0.0, 0.0);
        let (mut point_sum, mut point_count) = (0.0, 0.0);
        let mut cells = BTreeMap::new();
        let (mut placed, mut truly_placed) = (Vec::new(), Vec::new());
        for (scanner, sample) in self.samples.iter().enumerate() {
            let mut last = None;
            for point in sample.points.iter().step_by(EACH) {
                let stamp_s = sample.profiles[point.profile as usize].time_s;
                let true_s = stamp_s - self.scenario.scanners[scanner].latency_s;
                let Some(pose) = poses.pose_at(stamp_s - late_s[scanner]) else {
                    continue;
                };
                let Some((exact, truth)) = self.true_point(scanner, true_s, &point.position_m)
                else {
                    continue;
                };
                let mounting = mounted(&mountings, bending, scanner, true_s);
                let place = pose.map(&mounting.map(&point.position_m));
                placed.push(place);
                truly_placed.push(truth);
                let error = place - truth;
                point_sum += error.norm_squared();
                point_count += 1.0;
                let [east, north] = [truth.x, truth.y].map(|x| (x / CELL_M).floor() as i64);
                let cell = (east, north, (stamp_s / PASS_S).floor() as i64);
                let sums: &mut [[f64; 2]; 2] = cells.entry(cell).or_default();
                if let Some([sum, count]) = sums.get_mut(scanner) {
                    *sum += error.z;
                    *count += 1.0;
                }
                if last != Some(point.profile) {
                    last = Some(point.profile);
                    pose_sum += (pose.translation_m - exact.translation_m).norm_squared();
                    pose_count += 1.0;
                }
            }
        }
        let shared = cells
            .values()
            .filter(|sums| sums.iter().all(|s| s[1] > 0.0));
        let gaps = shared.map(|[left, right]| left[0] / left[1] - right[0] / right[1]);
        Outcome {
            mountings,
            gap_m: rms(gaps),
            distances_m: [&placed, &truly_placed].map(|points| self.distance_m(points)),
            poses_m: (pose_sum / f64::max(pose_count, 1.0)).sqrt(),
            points_m: (point_sum / f64::max(point_count, 1.0)).sqrt(),
            seconds,
        }
    }
}
