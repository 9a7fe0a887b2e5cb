//! The whole program on one page.

use std::path::Path;

use super::findings::{Extras, Findings};
use super::job::Job;
use super::stages::Poses;
use super::{clouds, drives, page, result, stages};
use crate::calibration::{Calibration, CalibrationSettings, Method, ScannerSample, Variant};
use crate::cloud::voxel;
use crate::comparison::MountingKind;
use crate::error::Result;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::progress::Progress;
use crate::project::Project;
use crate::report::content::Drive;
use crate::report::{self, verdicts};

/// What is written beside the clouds.
const RESULTS: [&str; 5] = [
    "trajectory.csv",
    "calibration.toml",
    "project.toml",
    "report.html",
    "result.json",
];

/// The paper reports 50 to 450 iterations a scale.
const PAPER_ITERATIONS: usize = 450;

/// Runs all stages on the project and writes every result into `out`, whole or not at all.
///
/// # Errors
/// The first thing that any stage finds wrong; `out` then keeps what it held.
pub fn analyse(
    project: &Project,
    out: &Path,
    extras: &Extras,
    progress: &dyn Progress,
) -> Result<Findings> {
    project.check_files()?;
    let names: Vec<String> = RESULTS.map(str::to_owned).into();
    let names = [names, clouds::names(project)].concat();
    let mut job = Job::new(out, &project.inputs(), &names, progress)?;

    let reference = job.timed("reference", |progress| stages::reference(project, progress))?;
    let poses = job.timed("trajectory", |progress| stages::poses(project, progress))?;
    let samples = job.timed("sample", |progress| {
        stages::samples(project, &poses.trajectory, progress)
    })?;
    stages::check_reference(project, &samples, &reference)?;
    let calibration = job.timed("calibrate", |progress| {
        let settings = &project.calibration;
        stages::calibration(project, settings, &poses, &samples, &reference, progress)
    })?;
    let beside = calibrations_beside(project, extras, &poses, &samples, &reference, &mut job)?;
    let refusals = stages::refusals(project, &samples);
    drop(samples);
    let kept = clouds::write(project, &poses.trajectory, &calibration.poses(), &mut job)?;
    let mountings = mountings(project, &calibration, extras);
    let drives = drives::compare(project, poses, &reference, &mountings, kept, &mut job)?;

    for warning in warnings(&calibration, &drives, refusals) {
        job.warn(warning);
    }
    let findings = Findings {
        calibration,
        beside,
        mountings,
        drives,
        background_m: thinned_for_drawing(&reference),
        stages: job.stages().to_vec(),
        warnings: job.warnings().to_vec(),
    };
    write(project, &findings, extras, &job)?;
    job.commit()?;
    Ok(findings)
}

/// What stands beside the result: the same drive calibrated under every other condition that `extras`
/// and a reference allow.
fn calibrations_beside(
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

/// The mountings that clouds are compared under: initial, final, and the truth where it is known.
fn mountings(
    project: &Project,
    calibration: &Calibration,
    extras: &Extras,
) -> Vec<(MountingKind, Vec<BodyFromScanner>)> {
    let truth = extras.truth.as_ref().map(|truth| truth.mountings.clone());
    let mut mountings = vec![
        (MountingKind::Initial, stages::initial_poses(project)),
        (MountingKind::Final, calibration.poses()),
    ];
    mountings.extend(truth.map(|truth| (MountingKind::Truth, truth)));
    mountings
}

/// What somebody should look at.
fn warnings(calibration: &Calibration, drives: &[Drive], refusals: Vec<String>) -> Vec<String> {
    let missing = drives.iter().flat_map(|drive| &drive.agreements.missing);
    let mut warnings: Vec<String> = missing.cloned().chain(refusals).collect();
    if !calibration.converged {
        warnings.push("the calibration did not converge at every scale".into());
    }
    warnings.extend(verdicts::not_constant(calibration));
    let solution = drives.first().and_then(|drive| drive.solution.as_ref());
    if solution.is_some_and(|solution| !solution.converged) {
        warnings.push("the trajectory did not converge: its sigmas mean nothing".into());
    }
    warnings
}

/// A few thousand points of the reference.
fn thinned_for_drawing(reference: &[Vec3]) -> Vec<Vec3> {
    const VOXEL_M: f64 = 0.05;
    let kept = voxel::thin(reference, VOXEL_M);
    kept.iter()
        .map(|&index| reference[index as usize])
        .collect()
}

/// Writes everything but the clouds, which are already staged.
fn write(project: &Project, findings: &Findings, extras: &Extras, job: &Job<'_>) -> Result<()> {
    if let Some(own) = findings.drives.first() {
        let path = job.path("trajectory.csv");
        stages::write_trajectory(&path, &own.poses, &project.origin_m)?;
    }
    let calibrated = stages::with_mountings(project, &findings.calibration.poses());
    job.write("calibration.toml", &calibrated.scanners_to_toml()?)?;
    job.write("project.toml", &project.to_toml()?)?;
    let page = report::render(&page::content(project, findings, extras));
    job.write("report.html", &page)?;
    let document = result::document(findings);
    job.write("result.json", &format!("{document:#}\n"))
}
