//! The joint adjustment of the drives of a project.

use std::time::Instant;

use nalgebra::DMatrix;

use super::given_poses::reason_for_two_steps;
use super::held_out;
pub use super::joint_input::Drive;
use super::joint_input::{input, surfel_m};
use super::placed;
use super::rig::{PASS_CELL_VOXELS, Rig};
use super::stages;
use crate::calibration::{Calibration, INITIAL_SIGMA, Minimum, Mounting, Reach, change, is_within};
use crate::error::{Error, Problem, Result, unless_cancelled};
use crate::geometry::Vec3;
use crate::joint::{
    Compliance, ContradictedLogs, Joint, JointInput, JointReport, LateScanner, Rung, Score, adjust,
    consider_start, contradictions,
};
use crate::judgement;
use crate::number;
use crate::progress::Progress;
use crate::project::{Motion, Project};
use crate::statistics::chi_square;

/// A scanner is late if the scans show a latency of more than this many standard deviations and of more than
/// `LEAST_LATENCY_S`, seconds.
const LATE_SIGMAS: f64 = 5.0;
const LEAST_LATENCY_S: f64 = 0.002;

/// Initial values are farther off than this in one of a thousand mountings, standard normal distribution.
const INITIAL_Z: f64 = 3.09;

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
    let is_ambiguous = two_steps.minimum.as_ref().is_some_and(Minimum::is_doubtful);
    let adjusted = if is_ambiguous {
        from_both(&mut input, begin, calibration_drive, progress)
    } else {
        with_late_scanners(&mut input, calibration_drive, progress)
    };
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

/// Why the mountings of a joint adjustment cannot be true: one is farther from its initial value than this is off, and also
/// farther than [`Reach::ROUGH`] from that of two steps, which leave an initial value that is wrong.
fn beyond_initial_values(
    initial: &[Mounting],
    two_steps: &[Mounting],
    joint: &[Mounting],
) -> Option<String> {
    let mut all = joint.iter().zip(two_steps).zip(initial);
    all.find_map(|((joint, two_steps), initial)| {
        let from = |other: &Mounting| {
            let other = &other.body_from_scanner;
            joint.body_from_scanner.perturbation_from(other)
        };
        let (turn, shift) = from(initial);
        let [shift_m, turn_rad] = INITIAL_SIGMA;
        let squares = (shift / shift_m).norm_squared() + (turn / turn_rad).norm_squared();
        let is_beyond = squares > chi_square(6.0, INITIAL_Z);
        (is_beyond && Reach::ROUGH.is_exceeded(&from(two_steps))).then(|| {
            format!(
                "it ends {} and {:.1}° away from the initial value of `{}`, farther than the stated uncertainty of \
                 initial values allows",
                number::length(shift.norm()),
                turn.norm().to_degrees(),
                joint.name,
            )
        })
    })
}

/// Whether an adjustment did not converge, or is contradicted.
fn is_doubtful(joint: &Joint) -> bool {
    not_converged(joint).is_some() || !contradictions(joint).is_empty()
}

/// Why an adjustment that did not converge is doubtful: its standard deviations are those of another state.
fn not_converged(joint: &Joint) -> Option<String> {
    let iterations = joint.iterations;
    (!joint.stop.is_converged()).then(|| format!("it did not converge in {iterations} iterations"))
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

/// Adjusts; if the scans contradict the latencies of scanners, adjusts again and estimates these latencies. They are
/// held by default, because estimating a latency costs tx a third of its accuracy.
fn with_late_scanners(
    input: &mut JointInput<'_>,
    calibration_drive: &Drive<'_>,
    progress: &dyn Progress,
) -> Result<(Joint, Vec<LateScanner>)> {
    let (settings, surfel_m) = (
        &calibration_drive.project.joint,
        surfel_m(calibration_drive),
    );
    let joint = adjust(input, settings, surfel_m, progress)?;
    let is_late = |score: &Option<Score>| {
        score.is_some_and(|s| s.value.abs() > LEAST_LATENCY_S && s.sigmas() > LATE_SIGMAS)
    };
    let late: Vec<bool> = joint.late_scores.iter().map(is_late).collect();
    if !late.contains(&true) {
        return Ok((joint, Vec::new()));
    }
    let estimated = input.estimate_latency.iter_mut().zip(&late);
    estimated.for_each(|(estimate, late)| *estimate |= late);
    let freed = unless_cancelled(adjust(input, settings, surfel_m, progress))?;
    let Some(joint) = freed else {
        // The adjustment succeeds only with latencies held.
        return Ok((joint, Vec::new()));
    };
    let scanners = calibration_drive
        .project
        .scanners
        .iter()
        .zip(&joint.late_s)
        .zip(&late);
    let named = scanners.filter_map(|((scanner, latency), late)| {
        let (value, sigma) = latency.filter(|_| *late)?;
        Some(LateScanner {
            name: scanner.name.clone(),
            late: Score { value, sigma },
            time_offset_s: scanner.time_offset_s,
        })
    });
    let named: Vec<LateScanner> = named.collect();
    named
        .iter()
        .for_each(|scanner| progress.verdict(&judgement::late_scanner(scanner).text));
    Ok((joint, named))
}

/// Adjusts from where two steps began and, if that holds, from their result, which is one of several minima: only if both
/// end at the same mountings is it known which they are. An adjustment from the first alone that is doubtful is returned
/// as it is.
///
/// # Errors
/// Those of [`adjust`]; the two end apart ([`Problem::NotDetermined`]).
fn from_both(
    input: &mut JointInput<'_>,
    begin: &[Mounting],
    calibration_drive: &Drive<'_>,
    progress: &dyn Progress,
) -> Result<(Joint, Vec<LateScanner>)> {
    progress
        .say("two steps have several minima: adjusting from the initial values and from two steps");
    let two_steps = std::mem::replace(&mut input.mountings, begin.to_vec());
    let (joint, late) = with_late_scanners(input, calibration_drive, progress)?;
    if is_doubtful(&joint) {
        return Ok((joint, late));
    }
    input.mountings = two_steps;
    let other = unless_cancelled(with_late_scanners(input, calibration_drive, progress))?;
    let agrees = |(other, _): &(Joint, _)| {
        let apart = change(&joint.mountings, &other.mountings);
        !is_doubtful(other) && is_within(&apart, &joint.covariance)
    };
    if other.as_ref().is_some_and(agrees) {
        return Ok((joint, late));
    }
    Err(Error::of(
        Problem::NotDetermined,
        "the calibration in two steps has another minimum that fits as well, and from there the joint adjustment does \
         not end at the same mountings as from the initial values",
        "drive over planes in more directions, give a reference, or start nearer",
    ))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BodyFromScanner;

    #[test]
    fn an_adjustment_that_ends_farther_than_initial_values_are_off_is_named() {
        let at = |turn_rad: f64, shift_m: f64| {
            let (turn, shift) = (Vec3::x() * turn_rad, Vec3::y() * shift_m);
            let pose = BodyFromScanner::identity().perturbed(&turn, &shift);
            [Mounting::new("left", pose)]
        };
        let initial = at(0.0, 0.0);
        let reason = |turn_rad: f64, shift_m: f64| {
            beyond_initial_values(&initial, &initial, &at(turn_rad, shift_m))
        };
        // χ² of 6 degrees exceeds 22.5 once in a thousand: 4.7 standard deviations.
        assert_eq!((reason(0.11, 0.0), reason(0.0, 0.11)), (None, None));
        let far = reason(0.0, 0.25).unwrap();
        assert!(
            far.contains("250 mm and 0.0° away") && far.contains("`left`"),
            "{far}"
        );
        assert!(reason(0.15, 0.0).unwrap().contains("8.6° away"));
        // Two steps agree: the initial value is wrong.
        assert_eq!(
            beyond_initial_values(&initial, &at(0.15, 0.25), &at(0.16, 0.24)),
            None
        );
    }
}
