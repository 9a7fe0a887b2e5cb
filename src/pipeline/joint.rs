//! The joint adjustment of the drives of a project.

use std::time::Instant;

use nalgebra::DMatrix;

use super::stages::{self, Poses};
use crate::calibration::{Calibration, Mounting, ScannerSample};
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::joint::motion::Motion as JointMotion;
use crate::joint::{
    ChainMotion, CorrectedPoses, CorrelatedError, Joint, JointDrive, JointInput, JointReport,
    Scans, adjust, contradictions,
};
use crate::progress::Progress;
use crate::project::{Logs, Motion, Project};
use crate::trajectory::Solution;

/// The IMU's noise is scaled where its residuals exceed it by more than this many standard
/// deviations of the variance component.
const NOISE_SIGMAS: f64 = 3.0;

/// A drive before the adjustment.
pub struct Drive<'a> {
    /// As its results are called.
    pub name: &'a str,
    /// Its project.
    pub project: &'a Project,
    /// Its poses, from logs or a file.
    pub poses: &'a Poses,
    /// A sample of each scanner.
    pub samples: &'a [ScannerSample],
}

/// Adjusts the project's own drive and those of `[[drive]]`, from the result of two steps. What
/// keeps the adjustment from being made, and what contradicts it, is reported and not an error.
///
/// # Errors
/// Errors of the stages on other drives; [`Error::Cancelled`].
pub fn report(
    own: &Drive<'_>,
    two_steps: &Calibration,
    reference: &[Vec3],
    progress: &dyn Progress,
) -> Result<JointReport> {
    let begun = Instant::now();
    let project = own.project;
    let mut others = Vec::new();
    for other in &project.drives {
        let aligned = stages::with_mountings(
            &stages::aligned(project, Project::read(&other.project)?)?,
            &two_steps.poses(),
        );
        let poses = stages::poses(&aligned, progress)?;
        let samples = stages::samples(&aligned, &poses.trajectory, progress)?;
        others.push((other.name.as_str(), aligned, poses, samples));
    }
    let mut drives = vec![input(own)];
    drives.extend(others.iter().map(|(name, project, poses, samples)| {
        input(&Drive {
            name,
            project,
            poses,
            samples,
        })
    }));
    let made = drives
        .into_iter()
        .collect::<Result<Vec<_>>>()
        .and_then(|drives| {
            let input = JointInput {
                mountings: two_steps.mountings.clone(),
                known: None,
                estimate_latency: latencies(project),
                drives,
                reference,
            };
            adjust(&input, &project.joint, surfel_m(project), progress)
        });
    let seconds = begun.elapsed().as_secs_f64();
    Ok(match made {
        Ok(found) => JointReport {
            refused: contradictions(&found),
            found: Some(found),
            seconds,
        },
        Err(error) => JointReport {
            found: None,
            refused: vec![reason(error)?],
            seconds,
        },
    })
}

/// The poses of a drive adjusted with its own logs and scans, without a reference, by mountings that
/// are known.
///
/// # Errors
/// As for [`adjust`].
pub fn with_known_mountings(
    drive: &Drive<'_>,
    mountings: Vec<Mounting>,
    covariance: &DMatrix<f64>,
    progress: &dyn Progress,
) -> Result<Joint> {
    let input = JointInput {
        estimate_latency: vec![false; mountings.len()],
        mountings,
        known: Some(covariance),
        drives: vec![input(drive)?],
        reference: &[],
    };
    let project = drive.project;
    adjust(&input, &project.joint, surfel_m(project), progress)
}

/// Why the adjustment cannot be made, if that is what the error says.
///
/// # Errors
/// Any other error.
pub fn reason(error: Error) -> Result<String> {
    match error {
        Error::Data {
            kind: Problem::TooFew | Problem::TooMany | Problem::NotDetermined,
            problem,
            ..
        } => Ok(problem),
        other => Err(other),
    }
}

fn surfel_m(project: &Project) -> f64 {
    let sizes = &project.calibration.voxel_sizes_m;
    let finest_m = sizes.iter().copied().fold(f64::INFINITY, f64::min);
    project.joint.surfel_size_m(finest_m)
}

fn latencies(project: &Project) -> Vec<bool> {
    let scanners = project.scanners.iter();
    scanners
        .map(|scanner| scanner.estimate_time_offset)
        .collect()
}

fn input<'a>(drive: &Drive<'a>) -> Result<JointDrive<'a>> {
    let poses = drive.poses;
    let motion: Box<dyn JointMotion> = match (&poses.covariance, &drive.project.motion) {
        (Some(covariance), Motion::Logs(logs)) => {
            let names = logs.settings.positions.iter().map(|p| p.name.clone());
            let chain = ChainMotion::new(covariance, names.collect(), &correlated(logs));
            let scale = poses.solution.as_ref().map_or(1.0, noise_scale);
            Box::new(chain.with_noise_scaled(scale))
        }
        _ => {
            let correlation_s = drive.project.joint.correlation_s;
            let motion = CorrectedPoses::new(&poses.trajectory, correlation_s);
            Box::new(motion.ok_or_else(|| {
                Error::of(
                    Problem::TooFew,
                    "the poses have no standard deviations, which say how far they may be \
                     corrected",
                    "give sigma_position_m and sigma_rotation_deg in [trajectory]",
                )
            })?)
        }
    };
    Ok(JointDrive {
        name: drive.name.into(),
        motion,
        scans: Scans {
            samples: drive.samples.iter().collect(),
        },
    })
}

/// The correlated errors of position sensors and heading.
fn correlated(logs: &Logs) -> Vec<Option<CorrelatedError>> {
    let error = |sigma: Vec<f64>, correlation_s| {
        sigma.iter().any(|s| *s > 0.0).then_some(CorrelatedError {
            sigma,
            correlation_s,
        })
    };
    let positions = logs.settings.positions.iter();
    let positions = positions.map(|p| {
        let sigma = p.sigma_correlated_m.iter().copied().collect();
        error(sigma, p.correlation_s)
    });
    let heading = &logs.settings.heading;
    let heading = error(vec![heading.sigma_correlated_rad], heading.correlation_s);
    positions.chain([heading]).collect()
}

/// The factor on the IMU's standard deviations that its residuals ask for without scans, where that
/// is not chance: a vehicle that vibrates is no mounting that bends.
fn noise_scale(solution: &Solution) -> f64 {
    let of_imu = |name: &str| name == "gyro" || name == "accelerometer";
    let sensors = solution.sensors.iter().filter(|s| of_imu(&s.name));
    let (square, redundancy) = sensors.fold((0.0, 0.0), |(square, redundancy), sensor| {
        (square + sensor.chi_square, redundancy + sensor.redundancy)
    });
    let ratio: f64 = square / redundancy;
    let notable = ratio > 1.0 + NOISE_SIGMAS * (2.0 / redundancy).sqrt();
    if redundancy > 1.0 && notable {
        ratio.sqrt()
    } else {
        1.0
    }
}
