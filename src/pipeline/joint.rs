//! The joint adjustment of the drives of a project.

use std::time::Instant;

use nalgebra::DMatrix;

use super::given_poses::reason_for_two_steps;
use super::held_out;
pub use super::joint_input::Drive;
use super::joint_input::{input, surfel_m};
use super::joint_starts::{
    adjusted, beyond_initial_values, is_ambiguous, is_doubtful, not_converged,
};
use super::placed;
use super::rig::{PASS_CELL_VOXELS, Rig};
use super::stages;
use crate::calibration::{Calibration, Mounting};
use crate::error::{Error, Problem, Result, unless_cancelled};
use crate::geometry::Vec3;
use crate::joint::{
    Compliance, ContradictedLogs, Joint, JointInput, JointReport, Rung, adjust, consider_start,
    contradictions,
};
use crate::progress::Progress;
use crate::project::{Motion, Project};

/// Adjusts the calibration drive together with those of `[[drive]]`, starting from the calibration in two steps, which
/// began at `begin`. If the adjustment is impossible or contradicted by sensors, the report says why; this is not an error.
///
/// # Errors
/// Errors of the stages on other drives; [`Error::Cancelled`].
pub fn report(
    calibration_drive: &Drive<'_>,
    begin: &[Mounting],
    two_steps: &Calibration,
    reference: &[Vec3],
    progress: &dyn Progress,
) -> Result<JointReport> {
    let begun = Instant::now();
    let project = calibration_drive.project;
    let (mut other_drives, mut contradicted) = (Vec::new(), Vec::new());
    for other in &project.drives {
        let other_project = project.drive(other.read(project)?);
        let columns = |project: &Project| project.bending.as_ref().map(|log| log.columns.clone());
        if let (Some(theirs), Some(ours)) = (columns(&other_project), columns(project))
            && theirs != ours
        {
            return Err(Error::data(
                format!(
                    "{}: [bending] with the columns {theirs:?}, not {ours:?}",
                    other.name
                ),
                "name the same columns in the same order in all drives, because mountings follow them in the same way",
            ));
        }
        let rig = Rig {
            mountings: two_steps.mountings.clone(),
            ..calibration_drive.rig.of_drive(&other_project)
        };
        let estimated = stages::poses(&other_project, progress)?;
        let poses = &estimated.poses;
        contradicted.push(ContradictedLogs {
            drive: other.name.clone(),
            findings: poses.log_findings.clone(),
        });
        let samples = stages::samples(&other_project, &rig, &poses.trajectory, progress)?;
        other_drives.push((other.name.as_str(), other_project, rig, estimated, samples));
    }
    let others = other_drives.iter();
    let others = others.map(|(name, project, rig, poses, samples)| Drive {
        name,
        project,
        rig,
        poses,
        samples,
    });
    let drives = [input(calibration_drive)]
        .into_iter()
        .chain(others.map(|drive| input(&drive)));
    let drives = match drives.collect::<Result<Vec<_>>>() {
        Ok(drives) => drives,
        Err(error) => {
            return Ok(JointReport {
                refused: vec![reason(error)?],
                contradicted,
                seconds: begun.elapsed().as_secs_f64(),
                ..JointReport::default()
            });
        }
    };
    let held = two_steps.observability.hidden();
    let mut input = JointInput {
        mountings: two_steps.mountings.clone(),
        initial: &calibration_drive.rig.mountings,
        held: &held,
        known: None,
        compliance: &[],
        estimate_latency: latencies(project),
        drives,
        reference,
    };
    let adjusted = adjusted(&mut input, begin, two_steps, calibration_drive, progress);
    let is_ambiguous = is_ambiguous(two_steps);
    let is_doubtful = match &adjusted {
        Ok((joint, _)) => is_doubtful(joint) || moves_with_reference(joint),
        Err(error) => !matches!(error, Error::Cancelled),
    };
    // What several minima explain is not blamed on the reference.
    let fits_alone = !reference.is_empty()
        && is_doubtful
        && !is_ambiguous
        && fits_without_reference(&mut input, calibration_drive, progress)?;
    let mut report = match adjusted {
        Ok((joint, late)) => {
            show(calibration_drive, &joint, reference, progress);
            JointReport {
                refused: not_converged(&joint)
                    .into_iter()
                    .chain(contradictions(&joint))
                    .collect(),
                result: Some(joint),
                late,
                ..JointReport::default()
            }
        }
        Err(error) => JointReport {
            refused: vec![reason(error)?],
            ..JointReport::default()
        },
    };
    (report.fits_alone, report.contradicted) = (fits_alone, contradicted);
    if fits_alone {
        let reason = "the drive is consistent without the reference, but not with it";
        report.refused.insert(0, reason.into());
    }
    if let Some(joint) = &mut report.result {
        let initial = &calibration_drive.rig.mountings;
        let reason = beyond_initial_values(initial, &two_steps.mountings, &joint.mountings);
        if let Some(reason) = reason {
            report.refused.push(reason);
        } else if matches!(project.motion, Motion::Poses(_)) {
            let cell_m = PASS_CELL_VOXELS * calibration_drive.rig.finest_m();
            let samples = calibration_drive.samples;
            let reason = reason_for_two_steps(samples, cell_m, two_steps, joint);
            report.refused.extend(reason);
        } else if report.refused.is_empty() {
            let surfel_m = surfel_m(calibration_drive);
            consider_start(&mut input, &project.joint, surfel_m, joint, progress)?;
        } else if !fits_alone && !is_ambiguous {
            let drive = calibration_drive;
            report.held_out = held_out::compare(drive, two_steps, joint, input, progress)?;
        }
    }
    if let (Some(better), Some(joint)) = (report.predicts_better(), &mut report.result) {
        joint.scale_sigmas(better.misfit);
    }
    report.seconds = begun.elapsed().as_secs_f64();
    Ok(report)
}

/// Whether mountings move and the reference is displaced: the adjustment may confuse one with the other.
fn moves_with_reference(joint: &Joint) -> bool {
    let is_displaced = joint.reference.is_some_and(|r| r.describe().is_some());
    joint.rung > Rung::Rigid && is_displaced
}

/// Whether an adjustment without the reference, with the smallest allowed motion of mountings, is contradicted by no
/// sensor.
///
/// # Errors
/// [`Error::Cancelled`].
fn fits_without_reference(
    input: &mut JointInput<'_>,
    calibration_drive: &Drive<'_>,
    progress: &dyn Progress,
) -> Result<bool> {
    progress.say("testing whether the drive is consistent without the reference");
    let reference = std::mem::take(&mut input.reference);
    let mut settings = calibration_drive.project.joint.clone();
    settings.mounting.most = settings.mounting.least;
    let adjusted = adjust(input, &settings, surfel_m(calibration_drive), progress);
    input.reference = reference;
    Ok(unless_cancelled(adjusted)?.is_some_and(|joint| !is_doubtful(&joint)))
}

/// Shows the clouds of the calibration drive, placed with the result of the adjustment, and the reference.
fn show(calibration_drive: &Drive<'_>, joint: &Joint, reference: &[Vec3], progress: &dyn Progress) {
    let names = calibration_drive
        .project
        .scanners
        .iter()
        .map(|scanner| scanner.name.as_str());
    let names: Vec<&str> = names
        .chain((!reference.is_empty()).then_some("reference"))
        .collect();
    progress.clouds("joint adjustment", &names, &|each| {
        reference
            .iter()
            .for_each(|point| each(joint.mountings.len(), (*point).into()));
        for point in placed::on_adjusted_poses(calibration_drive.samples, joint) {
            if let Some(position_m) = point.position_m {
                each(point.scanner, position_m.into());
            }
        }
    });
}

/// Adjusts the poses of a drive to its logs and scans, without a reference, with the mountings of its rig and their
/// covariance.
///
/// # Errors
/// As for [`adjust`].
pub fn with_known_mountings(
    drive: &Drive<'_>,
    covariance: &DMatrix<f64>,
    progress: &dyn Progress,
) -> Result<Joint> {
    let Rig {
        mountings,
        compliance,
        ..
    } = drive.rig;
    // A scanner without a `[scanner.compliance]` table is rigid.
    let mut known = compliance.iter().flatten();
    let rigid = known.next().copied().map(Compliance::rigid_beside);
    let compliance = compliance
        .iter()
        .filter_map(|compliance| compliance.or(rigid));
    let compliance: Vec<Compliance> = compliance.collect();
    let input = JointInput {
        compliance: &compliance,
        estimate_latency: vec![false; mountings.len()],
        mountings: mountings.clone(),
        initial: mountings,
        held: &[],
        known: Some(covariance),
        drives: vec![input(drive)?],
        reference: &[],
    };
    adjust(&input, &drive.project.joint, surfel_m(drive), progress)
}

/// The reason why the adjustment is impossible, from an error that says so.
///
/// # Errors
/// Any other error.
pub fn reason(error: Error) -> Result<String> {
    match error {
        Error::Data {
            kind:
                Problem::TooFew | Problem::TooMany | Problem::NotDetermined | Problem::Contradicted,
            problem,
            ..
        } => Ok(problem),
        other => Err(other),
    }
}

fn latencies(project: &Project) -> Vec<bool> {
    let scanners = project.scanners.iter();
    scanners
        .map(|scanner| scanner.estimate_time_offset)
        .collect()
}
