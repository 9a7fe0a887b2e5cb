//! What the adjustment found.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::bend::{Compliance, Rung};
use super::components::Component;
use super::motion::{PositionBlocks, PositionResiduals};
use super::score::Score;
use super::settings::ReferenceSigma;
use super::surfel::Region;
use crate::adjustment::StopReason;
use crate::calibration::observability::LEVER_M;
use crate::calibration::{Calibration, Method, Mounting, Observability, UnobservableDirection};
use crate::geometry::{Bending, BodyFromScanner, Vec3};
use crate::statistics::rms;
use crate::stored::stored;
use crate::trajectory::{EstimatedConstant, Trajectory};
use crate::verdict::Verdict;

/// Mountings and trajectories adjusted together.
#[derive(Debug, Clone)]
pub struct Joint {
    /// One a scanner.
    pub mountings: Vec<Mounting>,
    /// Covariance of (δp, δφ) of all mountings, body axes; zero for fixed and held parameters.
    pub covariance: DMatrix<f64>,
    /// Latency of each scanner's profiles where it was estimated: value and standard deviation,
    /// seconds.
    pub late_s: Vec<Option<(f64, f64)>>,
    /// What the scans say of each latency that was held.
    pub late_scores: Vec<Option<Score>>,
    /// How far the scans put the reference above the world of the poses; its height is held.
    pub height_score: Option<Score>,
    /// How much the mountings may move in these values.
    pub rung: Rung,
    /// The rungs that were contradicted before.
    pub ladder: Vec<Climb>,
    /// Share of each variance, (δp, δφ) of all mountings, that rests on the prior of how they move; empty
    /// where mountings are rigid.
    pub prior_shares: Vec<f64>,
    /// How each mounting follows the load; empty where mountings are rigid.
    pub compliance: Vec<Compliance>,
    /// One a drive.
    pub drives: Vec<AdjustedDrive>,
    /// Constants estimated along.
    pub constants: Vec<EstimatedConstant>,
    /// Errors of the whole reference; `None` without one.
    pub reference: Option<ReferenceError>,
    /// Standard deviation of the reference's errors over some decimetres, metres.
    pub surface_m: f64,
    /// Regions in which scans and reference disagree.
    pub regions: Vec<Region>,
    /// Directions of the mountings that nothing determines: they are held at their start values.
    pub held: Vec<DVector<f64>>,
    /// The residuals of each group.
    pub groups: Vec<GroupTest>,
    /// Why it stopped.
    pub stop: StopReason,
    /// Steps of all rounds.
    pub iterations: usize,
    /// Scan rows of the last round.
    pub rows: usize,
    /// Surfels of the last round.
    pub surfels: usize,
    /// Where they came to lie.
    pub planes: Vec<SurfelPlane>,
    /// Unknowns of the last round.
    pub unknowns: usize,
}

/// A patch of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfelPlane {
    /// World, metres.
    pub centre_m: Vec3,
    /// Unit vector.
    pub normal: Vec3,
    /// Its edge, metres.
    pub size_m: f64,
    /// Standard deviation of points about it, metres.
    pub roughness_m: f64,
}

/// The trajectory of a drive after the adjustment.
#[derive(Debug, Clone)]
pub struct AdjustedDrive {
    /// As given.
    pub name: String,
    /// The poses with standard deviations.
    pub trajectory: Trajectory,
    /// How each mounting moved about its mean; empty where mountings are rigid.
    pub bending: Vec<MovedMounting>,
    /// What a motion of the mountings would take from the residuals of the scans, over what chance makes of it.
    pub motion_left: f64,
    /// Where mountings moved all at once; their values are those before.
    pub jumps: Vec<Jump>,
    /// How well points are known, of each scanner, evenly along the drive.
    pub points: Vec<Vec<KnownPoint>>,
    /// Name of the group of its IMU.
    pub imu: String,
    /// Residuals of its position sensors in blocks of time.
    pub positions: Vec<PositionBlocks>,
    /// The same residuals one by one.
    pub residuals: Vec<PositionResiduals>,
    /// How far the adjustment moved each pose.
    pub moved: Vec<PoseMove>,
}

/// How well a point on the ground is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownPoint {
    /// Its profile's time, seconds.
    pub time_s: f64,
    /// Scanner frame, metres.
    pub in_scanner_m: Vec3,
    /// Standard deviations in the world, metres: of what poses and mounting do, without the scanner's noise.
    pub sigma_m: Vec3,
}

/// Root mean square of the standard deviations of points, world, metres; `None` without any.
pub fn known_m(points: &[KnownPoint]) -> Option<Vec3> {
    let squares = points.iter().map(|p| p.sigma_m.component_mul(&p.sigma_m));
    let sum = squares.reduce(|a, b| a + b)?;
    Some((sum / points.len() as f64).map(f64::sqrt))
}

/// How a mounting moved along a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedMounting {
    /// Off its mean.
    pub offsets: Bending,
    /// Standard deviations of these offsets at the same times, not including that of the mean.
    pub sigmas: Bending,
}

/// A mounting that moved all at once: somebody leaned on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// Its place among the scanners.
    pub scanner: usize,
    /// It happened between these times, seconds.
    pub between_s: [f64; 2],
    /// (δφ, δp) after it, less before: radians and metres in body axes.
    pub step: [f64; 6],
    /// Standard deviations.
    pub sigma: [f64; 6],
}

/// A rung that was left.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Climb {
    /// Which.
    pub rung: Rung,
    /// What contradicted it, the gravest first.
    pub reasons: Vec<String>,
}

/// Where the reference as a whole lies against the world of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceError {
    /// What was known beforehand.
    pub prior: ReferenceSigma,
    /// Shift of its middle, world, metres.
    pub shift_m: Vec3,
    /// Standard deviations of the shift, metres.
    pub shift_sigma_m: Vec3,
    /// Rotation vector about its middle, world, radians.
    pub turn_rad: Vec3,
    /// Standard deviations of the rotation, radians.
    pub turn_sigma_rad: Vec3,
}

/// The height of a reference is named where it is off by more than this, metres, and by more standard
/// deviations: some ten micrometres on the slopes of boards, which is what tells it, are no noise.
const HEIGHT_M: f64 = 0.008;
const HEIGHT_SIGMAS: f64 = 4.0;

/// A reference is named as displaced where it is by more than this many standard deviations of the
/// prior.
const DISPLACED_SIGMAS: f64 = 2.0;

impl ReferenceError {
    /// What is more than the prior leads one to expect, in words.
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
                "the reference lies off the world of the poses by {}: is it in the coordinates of \
                 the total station?",
                parts.join(" and by ")
            )
        })
    }
}

/// How far the adjustment moved a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseMove {
    /// Seconds.
    pub time_s: f64,
    /// World, metres.
    pub shift_m: Vec3,
    /// Rotation vector in body axes, radians.
    pub turn_rad: Vec3,
}

/// How the joint adjustment of a run ended.
#[derive(Debug, Clone, Default)]
pub struct JointReport {
    /// What it found; `None` where it could not be made.
    pub found: Option<Joint>,
    /// Why its values are not those of the run, the gravest reason first; empty where they are.
    pub refused: Vec<String>,
    /// What the logs of the other drives contradict, and a reference that does not fit the drives.
    pub said: Vec<Verdict>,
    /// Scanners whose profiles are later than the project says, and were corrected.
    pub late: Vec<LateScanner>,
    /// Run time, seconds.
    pub seconds: f64,
}

/// A scanner whose profiles are later than the project says.
#[derive(Debug, Clone, PartialEq)]
pub struct LateScanner {
    /// Its name.
    pub name: String,
    /// How late, seconds.
    pub late: Score,
    /// The offset that the project gives, seconds.
    pub time_offset_s: f64,
}

impl LateScanner {
    /// What was found and what to write, in words.
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
        self.found.as_ref().filter(|_| self.refused.is_empty())
    }
}

/// The residuals of a group of observations.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct GroupTest {
    /// `imu`, the name of a position sensor or scanner, …
    pub name: String,
    /// Rows used.
    pub rows: usize,
    /// Σ r², in the standard deviations of the adjustment.
    pub chi_square: f64,
    /// Rows − tr(J H⁻¹ Jᵀ).
    pub redundancy: f64,
    /// Their quotient: 1 where the model is right.
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
        // From the sum that is held to the direction that is free: both weigh rotations by a lever.
        let lever_m2 = |i: usize| if i % 6 < 3 { 1.0 } else { LEVER_M * LEVER_M };
        let free = |d: &DVector<f64>| DVector::from_fn(d.len(), |i, _| d[i] / lever_m2(i));
        let held = self.held.iter();
        let unobservable = held.map(|d| UnobservableDirection::held(&free(d), &self.mountings));
        Calibration {
            method: Method::Joint,
            mountings: self.mountings.clone(),
            converged: self.stop == StopReason::Converged,
            covariance: Some(self.covariance.clone()),
            observability: Observability {
                shares: two_steps.observability.shares.clone(),
                unobservable: unobservable.collect(),
            },
            ..two_steps.clone()
        }
    }

    /// How far the reference lies above the world of the poses, where that is beyond doubt and beyond
    /// what was known of it.
    pub fn reference_height(&self) -> Option<Score> {
        let known_m = self.reference.map_or(0.0, |found| found.prior.shift_m);
        self.height_score.filter(|found| {
            let most_m = HEIGHT_M.max(DISPLACED_SIGMAS * known_m);
            found.value.abs() > most_m && found.sigmas() > HEIGHT_SIGMAS
        })
    }

    /// How far mountings move along the drives, about each axis: root mean square of shifts, metres, and of
    /// rotations, radians; `None` where they are rigid.
    pub fn motion(&self) -> Option<[f64; 2]> {
        let moved = self.drives.iter().flat_map(|drive| &drive.bending);
        let samples = moved.flat_map(|moved| moved.offsets.samples());
        let offsets: Vec<&[f64; 6]> = samples.map(|(_, offset)| offset).collect();
        let of = |part: Range<usize>| rms(offsets.iter().flat_map(|o| &o[part.clone()]).copied());
        (!offsets.is_empty()).then(|| [of(3..6), of(0..3)])
    }

    /// The test of a group.
    pub fn group(&self, name: &str) -> Option<&GroupTest> {
        self.groups.iter().find(|group| group.name == name)
    }
}

stored!(struct JointReport { found, refused, said, late, seconds });
stored!(struct Joint {
    mountings, covariance, late_s, late_scores, height_score, rung, ladder, prior_shares, compliance,
    drives, constants, reference, surface_m, regions, held, groups, stop, iterations, rows, surfels,
    planes, unknowns,
});
stored!(struct LateScanner { name, late, time_offset_s });
stored!(struct Climb { rung, reasons });
stored!(struct AdjustedDrive {
    name, trajectory, bending, motion_left, jumps, points, imu, positions, residuals, moved,
});
stored!(struct ReferenceError { prior, shift_m, shift_sigma_m, turn_rad, turn_sigma_rad });
stored!(struct GroupTest { name, rows, chi_square, redundancy, ratio });
stored!(struct MovedMounting { offsets, sigmas });
stored!(struct KnownPoint { time_s, in_scanner_m, sigma_m });
stored!(struct SurfelPlane { centre_m, normal, size_m, roughness_m });
stored!(struct Jump { scanner, between_s, step, sigma });
stored!(struct PoseMove { time_s, shift_m, turn_rad });
