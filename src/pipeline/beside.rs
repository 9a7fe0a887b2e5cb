//! What stands beside the result: the same drive calibrated under other conditions.

use super::findings::Extras;
use super::job::Job;
use super::stages::{self, Poses};
use crate::calibration::{Calibration, CalibrationSettings, Method, ScannerSample, Variant};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::project::Project;

/// The paper reports 50 to 450 iterations a scale.
const PAPER_ITERATIONS: usize = 450;

/// Calibrates under every condition that `extras` and a reference allow.
///
/// # Errors
/// As for [`stages::calibration`].
pub fn calibrations(
    project: &Project,
    extras: &Extras,
    poses: &Poses,
    samples: &[ScannerSample],
    reference: &[Vec3],
    job: &mut Job<'_>,
) -> Result<Vec<(Variant, Calibration)>> {
    let settings = &project.calibration;
    let mut beside = Vec::new();
    if !reference.is_empty() {
        let found = job.shown("calibrate without reference", |progress| {
            stages::calibration(project, settings, poses, samples, &[], progress)
        });
        beside.push((Variant::WithoutReference, found?));
    }
    if let Some(truth) = &extras.truth {
        let found = job.shown("calibrate with exact poses", |progress| {
            let exact = Poses::from_file(truth.trajectory.clone());
            let samples = stages::samples(project, &exact.trajectory, progress)?;
            stages::calibration(project, settings, &exact, &samples, reference, progress)
        });
        beside.push((Variant::ExactPoses, found?));
    }
    if !extras.paper_voxels_m.is_empty() {
        let paper = CalibrationSettings {
            voxel_sizes_m: extras.paper_voxels_m.clone(),
            method: Method::Paper,
            max_iterations: PAPER_ITERATIONS,
            ..settings.clone()
        };
        let found = job.shown("calibrate as the paper", |progress| {
            stages::calibration(project, &paper, poses, samples, reference, progress)
        });
        beside.push((Variant::Paper, found?));
    }
    Ok(beside)
}
