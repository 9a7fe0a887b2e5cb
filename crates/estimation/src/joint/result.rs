//! Result of the joint adjustment.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::bend::{Compliance, Rung};
use super::components::Component;
use super::motion::{PositionBlocks, PositionResiduals};
use super::score::{RangeScore, Score};
use super::settings::ReferenceSigma;
use super::surfel::Region;
use crate::adjustment::StopReason;
use crate::calibration::{Calibration, Method, Mounting, Observability, UnobservableDirection};
use crate::geometry::{Bending, BodyFromScanner, Vec3, WorldFromBody};
use crate::preflight::LogFindings;
use crate::statistics::rms;
use crate::trajectory::{EstimatedConstant, Trajectory};

/// Mountings and trajectories adjusted together.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Joint {
    /// The mountings, one per scanner.
    pub mountings: Vec<Mounting>,
    /// Covariance of (δp, δφ) of all mountings, body axes; zero for fixed parameters.
    pub covariance: DMatrix<f64>,
    /// Latency of each scanner's profiles, if it was estimated: value and standard deviation,
    /// seconds.
    pub late_s: Vec<Option<(f64, f64)>>,
    /// Estimate of each latency that was held, seconds.
    pub late_scores: Vec<Option<Score>>,
    /// Estimate of what would be added to all ranges of each scanner.
    pub range_scores: Vec<Option<RangeScore>>,
    /// Estimate of the height of the reference above the world of the poses, which was held, metres.
    pub height_score: Option<Score>,
    /// The rung at which these values were adjusted.
    pub rung: Rung,
    /// The lower rungs, which were contradicted.
    pub ladder: Vec<Climb>,
    /// Share of each variance, (δp, δφ) of all mountings, that rests on the prior of their motion; empty
    /// if mountings are rigid.
    pub prior_shares: Vec<f64>,
    /// Compliance of each mounting; empty if mountings are rigid.
    pub compliance: Vec<Compliance>,
    /// The adjusted drives.
    pub drives: Vec<AdjustedDrive>,
    /// Constants that were estimated as well.
    pub constants: Vec<EstimatedConstant>,
    /// Errors of the whole reference; `None` without one.
    pub reference: Option<ReferenceError>,
    /// Standard deviation of the reference's errors over some decimetres, metres.
    pub surface_m: f64,
    /// Regions in which scans and reference disagree.
    pub regions: Vec<Region>,
    /// Directions (δp, δφ) of the mountings of which initial values say more than the drives.
    pub undetermined: Vec<DVector<f64>>,
    /// The residuals of each group.
    pub groups: Vec<GroupTest>,
    /// Why the adjustment stopped.
    pub stop: StopReason,
    /// Number of steps of all rounds.
    pub iterations: usize,
    /// Number of scan rows of the last round.
    pub rows: usize,
    /// Number of surfels of the last round.
    pub surfels: usize,
    /// The planes of these surfels.
    pub planes: Vec<SurfelPlane>,
    /// Number of unknowns of the last round.
    pub unknowns: usize,
}

/// A patch of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfelPlane {
    /// World, metres.
    pub centre_m: Vec3,
    /// Unit vector.
    pub normal: Vec3,
    /// Edge of the patch, metres.
    pub size_m: f64,
    /// Standard deviation of points about it, metres.
    pub roughness_m: f64,
}

/// The trajectory of a drive after the adjustment.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct AdjustedDrive {
    /// Name of the drive.
    pub name: String,
    /// The poses with standard deviations.
    pub trajectory: Trajectory,
    /// Motion of each mounting about its mean; empty if mountings are rigid.
    pub bending: Vec<MovedMounting>,
    /// The part of the scans' squared residuals that a motion of the mountings would explain, relative to the part
    /// that it explains by chance.
    pub motion_left: f64,
    /// Sudden moves of mountings; the values of the mountings are those before.
    pub jumps: Vec<Jump>,
    /// Uncertainty of points of each scanner, evenly spaced along the drive.
    pub points: Vec<Vec<KnownPoint>>,
    /// Name of the group of its IMU.
    pub imu: String,
    /// Errors of its poses if these came from a file.
    pub pose_errors: Option<PoseErrors>,
    /// Residuals of its position sensors in blocks of time.
    pub positions: Vec<PositionBlocks>,
    /// The same residuals one by one.
    pub residuals: Vec<PositionResiduals>,
    /// Change of each pose by the adjustment.
    pub moved: Vec<PoseMove>,
}

impl AdjustedDrive {
    /// The pose of the body and the mounting of a scanner at a time (seconds), given the mean of the mounting; `None`
    /// outside of the drive.
    pub fn poses_at(
        &self,
        scanner: usize,
        mounting: &BodyFromScanner,
        time_s: f64,
    ) -> Option<(WorldFromBody, BodyFromScanner)> {
        let body = self.trajectory.pose_at(time_s)?;
        let bending = self.bending.get(scanner);
        let moved = bending.map_or(*mounting, |moved| moved.offsets.apply(mounting, time_s));
        Some((body, moved))
    }
}

/// Errors of poses from a file: of each component, rotations about the body's axes (radians) and position in the
/// world (metres).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseErrors {
    /// Standard deviations.
    pub sigma: [f64; 6],
    /// Those with which the poses came.
    pub stated_sigma: [f64; 6],
    /// Correlation times, seconds.
    pub correlation_s: [f64; 6],
    /// Whether the scans determine both; otherwise they are as stated and assumed.
    pub is_determined: [bool; 6],
}

/// Uncertainty of a point on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KnownPoint {
    /// Time of its profile, seconds.
    pub time_s: f64,
    /// Scanner frame, metres.
    pub in_scanner_m: Vec3,
    /// Standard deviations in the world due to poses and mounting, without the scanner's noise, metres.
    pub sigma_m: Vec3,
}

/// Root mean square of the standard deviations of points, world, metres; `None` without any.
pub fn known_m(points: &[KnownPoint]) -> Option<Vec3> {
    let squares = points.iter().map(|p| p.sigma_m.component_mul(&p.sigma_m));
    let sum = squares.reduce(|a, b| a + b)?;
    Some((sum / points.len() as f64).map(f64::sqrt))
}

/// Motion of a mounting along a drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MovedMounting {
    /// Offsets from its mean.
    pub offsets: Bending,
    /// Standard deviations of these offsets at the same times, not including that of the mean.
    pub sigmas: Bending,
}

/// A sudden move of a mounting, for example because somebody leaned on it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Jump {
    /// Index of the scanner.
    pub scanner: usize,
    /// The times between which it happened, seconds.
    pub between_s: [f64; 2],
    /// (δφ, δp) after minus before the move: radians and metres in body axes.
    pub step: [f64; 6],
    /// Standard deviations of the step.
    pub sigma: [f64; 6],
}

/// A rung that was contradicted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Climb {
    /// The rung.
    pub rung: Rung,
    /// The contradictions, gravest first.
    pub reasons: Vec<String>,
}

/// Displacement of the reference as a whole against the world of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReferenceError {
    /// Prior standard deviations.
    pub prior: ReferenceSigma,
    /// Shift of its centre, world, metres.
    pub shift_m: Vec3,
    /// Standard deviations of the shift, metres.
    pub shift_sigma_m: Vec3,
    /// Rotation vector about its centre, world, radians.
    pub turn_rad: Vec3,
    /// Standard deviations of the rotation, radians.
    pub turn_sigma_rad: Vec3,
}

/// The height of a reference is reported if it is off by more than this, metres: it is estimated from some ten
/// micrometres on the slopes of boards, which are not only noise.
const HEIGHT_M: f64 = 0.008;
/// The height must also be off by more than this many standard deviations.
const HEIGHT_SIGMAS: f64 = 4.0;

/// A reference is reported as displaced if it is off by more than this many standard deviations of the
/// prior.
const DISPLACED_SIGMAS: f64 = 2.0;

impl ReferenceError {
    /// The displacement in words, if it is larger than the prior suggests.
    pub fn describe(&self) -> Option<String> {
        let prior = &self.prior;
        let beyond = |value: &Vec3, sigma: f64| value.amax() > DISPLACED_SIGMAS * sigma;
        let mut parts = Vec::new();
        if prior.shift_m > 0.0 && beyond(&self.shift_m, prior.shift_m) {
            let [east, north, up] = (1e3 * self.shift_m).into();
            parts.push(format!(
                "{east:+.1} mm east, {north:+.1} mm north and {up:+.1} mm up (reference.sigma_m is \
                 {:.1} mm)",
                1e3 * prior.shift_m
            ));
        }
        if prior.tilt_rad > 0.0 && beyond(&self.turn_rad, prior.tilt_rad) {
            let [east, north, up] = self.turn_rad.map(f64::to_degrees).into();
            parts.push(format!(
                "{east:+.3}°, {north:+.3}° and {up:+.3}° about east, north and up \
                 (reference.sigma_deg is {:.3}°)",
                prior.tilt_rad.to_degrees()
            ));
        }
        (!parts.is_empty()).then(|| {
            format!(
                "the reference is displaced against the poses by {}: is it in the coordinates of \
                the total station?",
                parts.join(" and by ")
            )
        })
    }
}

/// Change of a pose by the adjustment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseMove {
    /// Seconds.
    pub time_s: f64,
    /// World, metres.
    pub shift_m: Vec3,
    /// Rotation vector in body axes, radians.
    pub turn_rad: Vec3,
}

/// Outcome of the joint adjustment of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct JointReport {
    /// The result; `None` if the adjustment failed.
    pub result: Option<Joint>,
    /// What speaks against it, gravest first. Then its values are those of the run only if it predicts scans better
    /// than two steps do.
    pub refused: Vec<String>,
    /// The comparison with two steps on scans that neither had seen, if a sensor contradicts the adjustment.
    pub held_out: Option<HeldOut>,
    /// Whether the adjustment is contradicted or fails with the reference, and no sensor contradicts the one without it.
    pub fits_alone: bool,
    /// Contradictions in the logs of the other drives.
    pub contradicted: Vec<ContradictedLogs>,
    /// Scanners whose profiles are later than the project says, and were corrected.
    pub late: Vec<LateScanner>,
    /// Run time, seconds.
    pub seconds: f64,
}

/// How far passes over the same ground, or passes and the reference, lie apart in scans that two methods had not seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Root mean square after two steps, metres.
    pub two_steps_m: f64,
    /// Root mean square after the joint adjustment, metres.
    pub joint_m: f64,
    /// Whether the joint adjustment predicts them better, beyond chance.
    pub joint_is_better: bool,
    /// The factor by which residuals exceed their noise; the standard deviations of a joint adjustment that predicts
    /// better are multiplied by it.
    pub misfit: f64,
}

/// Contradictions in the logs of a drive.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ContradictedLogs {
    /// Name of the drive.
    pub drive: String,
    /// What they contradict.
    pub findings: LogFindings,
}

/// A scanner whose profiles are later than the project says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LateScanner {
    /// Its name.
    pub name: String,
    /// The latency, seconds.
    pub late: Score,
    /// The offset that the project gives, seconds.
    pub time_offset_s: f64,
}

impl LateScanner {
    /// The latency and the value to write into the project, in words.
    pub fn describe(&self) -> String {
        let Score { value, sigma } = self.late;
        format!(
            "the profiles of scanner `{}` are {:.1} ± {:.1} ms {}, which was corrected: check its clock, \
             or write time_offset_s = {:.4}",
            self.name,
            1e3 * value.abs(),
            1e3 * sigma,
            if value > 0.0 { "late" } else { "early" },
            self.time_offset_s - value
        )
    }
}

impl JointReport {
    /// The adjustment whose values are reported.
    pub fn accepted(&self) -> Option<&Joint> {
        let is_accepted = self.refused.is_empty() || self.predicts_better().is_some();
        self.result.as_ref().filter(|_| is_accepted)
    }

    /// The comparison with two steps, if the adjustment predicts scans better.
    pub fn predicts_better(&self) -> Option<HeldOut> {
        self.held_out.filter(|held_out| held_out.joint_is_better)
    }
}

/// The residuals of a group of observations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupTest {
    /// `imu`, the name of a position sensor or scanner, …
    pub name: String,
    /// Rows used.
    pub rows: usize,
    /// Σ r², in the standard deviations of the adjustment.
    pub chi_square: f64,
    /// Rows − tr(J H⁻¹ Jᵀ).
    pub redundancy: f64,
    /// Their quotient: 1 if the model is right.
    pub ratio: Option<f64>,
}

impl GroupTest {
    pub(super) fn new(name: &str, component: &Component) -> Self {
        Self {
            name: name.to_owned(),
            rows: component.rows,
            chi_square: component.chi_square,
            redundancy: component.redundancy,
            ratio: component.ratio(),
        }
    }
}

impl Joint {
    /// The mountings.
    pub fn poses(&self) -> Vec<BodyFromScanner> {
        self.mountings.iter().map(|m| m.body_from_scanner).collect()
    }

    /// The mountings with their quality, as a calibration; its scales are those of two steps, where
    /// it started.
    pub fn calibration(&self, two_steps: &Calibration) -> Calibration {
        let undetermined = self.undetermined.iter();
        let unobservable = undetermined.map(|d| UnobservableDirection::of(d, &self.mountings, 0.0));
        Calibration {
            method: Method::Joint,
            mountings: self.mountings.clone(),
            converged: self.stop.is_converged(),
            covariance: Some(self.covariance.clone()),
            observability: Observability {
                shares: two_steps.observability.shares.clone(),
                unobservable: unobservable.collect(),
            },
            ..two_steps.clone()
        }
    }

    /// Multiplies the standard deviations of mountings and points by a factor.
    pub fn scale_sigmas(&mut self, factor: f64) {
        self.covariance *= factor * factor;
        let points = self.drives.iter_mut().flat_map(|drive| &mut drive.points);
        points.flatten().for_each(|point| point.sigma_m *= factor);
    }

    /// Height of the reference above the world of the poses, if it is significant and larger than the prior
    /// suggests.
    pub fn reference_height(&self) -> Option<Score> {
        let known_m = self.reference.map_or(0.0, |error| error.prior.shift_m);
        self.height_score.filter(|height| {
            let most_m = HEIGHT_M.max(DISPLACED_SIGMAS * known_m);
            height.value.abs() > most_m && height.sigmas() > HEIGHT_SIGMAS
        })
    }

    /// Motion of the mountings along the drives: root mean square of shifts along an axis (metres) and of
    /// rotations about an axis (radians); `None` if they are rigid.
    pub fn motion(&self) -> Option<[f64; 2]> {
        let moved = self.drives.iter().flat_map(|drive| &drive.bending);
        let samples = moved.flat_map(|moved| moved.offsets.samples());
        let offsets: Vec<&[f64; 6]> = samples.map(|(_, offset)| offset).collect();
        let rms_of =
            |part: Range<usize>| rms(offsets.iter().flat_map(|o| &o[part.clone()]).copied());
        (!offsets.is_empty()).then(|| [rms_of(3..6), rms_of(0..3)])
    }

    /// The test of a group.
    pub fn group(&self, name: &str) -> Option<&GroupTest> {
        self.groups.iter().find(|group| group.name == name)
    }
}
