//! A whole run: all stages in order.

use std::path::Path;

use super::clouds::Mounted;
use super::findings::{Extras, Findings};
use super::job::Job;
use super::stages::Poses;
use super::start::{self, Start};
use super::{clouds, drives, joint, mounting, page, result, stages};
use crate::calibration::{
    Calibration, CalibrationSettings, Method, Minimum, ScannerSample, Variant,
};
use crate::cloud::voxel;
use crate::comparison::MountingKind;
use crate::error::Result;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::joint::JointReport;
use crate::progress::Progress;
use crate::project::Project;
use crate::report::content::Drive;
use crate::report::{self, verdicts};
use crate::verdict::Severity;

/// Results other than the clouds.
const RESULTS: [&str; 6] = [
    "trajectory.csv",
    "mounting.csv",
    "calibration.toml",
    "project.toml",
    "report.html",
    "result.json",
];

/// The paper reports 50 to 450 iterations per scale.
const PAPER_ITERATIONS: usize = 450;

/// Runs all stages on the project and writes every result into `out`, whole or not at all.
///
/// # Errors
/// The first error of any stage; `out` then keeps its previous content.
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
    let (project, samples) = job.timed("sample", |progress| {
        let project = start::with_scales(project, &poses.trajectory, progress)?;
        let samples = stages::samples(&project, &poses.trajectory, progress)?;
        Ok((project, samples))
    })?;
    let project = &project;
    stages::check_reference(project, &samples, &reference)?;
    let start = job.timed("check placement", |progress| {
        let trajectory = &poses.trajectory;
        Ok(start::start(
            project, trajectory, &samples, &reference, progress,
        ))
    })?;
    let two_steps = job.timed("calibrate", |progress| {
        let Start {
            project, settings, ..
        } = &start;
        stages::calibration(project, settings, &poses, &samples, &reference, progress)
    })?;
    // Scans that are not where they belong would take minutes to be refused.
    let mut said = poses.preflight.iter().chain(&start.said);
    let minimum = two_steps.minimum.as_ref();
    let hindrance = if said.any(|verdict| verdict.severity == Severity::Fault) {
        Some("logs or scans have the fault that stands first")
    } else if minimum.is_some_and(Minimum::is_doubtful) {
        Some("two steps found another minimum that fits as well")
    } else {
        None
    };
    let joint = match (project.is_joint, hindrance) {
        (true, None) => Some(adjust_jointly(
            project, &poses, &samples, &two_steps, &reference, &mut job,
        )?),
        (true, Some(reason)) => Some(JointReport {
            refused: vec![reason.into()],
            ..JointReport::default()
        }),
        (false, _) => None,
    };
    let own = (&poses, samples.as_slice());
    let mut variants = calibrate_variants(&start, extras, own, &reference, &mut job)?;
    let left_out = stages::left_out(project, &samples);
    drop(samples);
    let accepted = joint.as_ref().and_then(JointReport::accepted);
    let calibration = match accepted {
        Some(joint) => {
            let found = joint.calibration(&two_steps);
            variants.insert(0, (Variant::TwoStep, two_steps));
            found
        }
        None => two_steps,
    };
    let placed = stages::with_latencies(project, accepted);
    let adjusted = drives::Adjusted::new(&placed, &poses, accepted)?;
    let kept = clouds::write(
        &placed,
        &adjusted.trajectory,
        Mounted {
            mountings: &calibration.poses(),
            bending: &adjusted.bending,
        },
        &mut job,
    )?;
    let mountings = mountings(project, &calibration, &variants, extras);
    let origin_sigma_m = stages::origin_sigma_m(project, poses.solution.as_ref());
    let own = (poses, adjusted);
    let drives = drives::compare(
        &placed,
        own,
        &reference,
        (&mountings, &calibration),
        kept,
        &mut job,
    )?;
    // An error of the origin moves no point of a drive, and is left out until here.
    let calibration = calibration.with_origin_sigma(origin_sigma_m);
    let variants = variants.into_iter().map(|(variant, found)| match variant {
        Variant::ExactPoses => (variant, found),
        _ => (variant, found.with_origin_sigma(origin_sigma_m)),
    });
    let variants = variants.collect();

    for warning in warnings(
        &project.origin_m,
        &calibration,
        joint.as_ref(),
        &drives,
        left_out,
    ) {
        job.warn(warning);
    }
    let mut findings = Findings {
        calibration,
        joint,
        variants,
        mountings,
        drives,
        origin_m: project.origin_m,
        background_m: thinned_for_drawing(&reference),
        stages: job.stages().to_vec(),
        placement: start.said,
        warnings: job.warnings().to_vec(),
        verdicts: Vec::new(),
    };
    let content = page::content(project, &findings, extras);
    findings.verdicts = verdicts(&content, &project.acceptance);
    write(project, &findings, extras, &job)?;
    job.commit()?;
    Ok(findings)
}

/// Adjusts mountings and trajectories together.
fn adjust_jointly(
    project: &Project,
    poses: &Poses,
    samples: &[ScannerSample],
    two_steps: &Calibration,
    reference: &[Vec3],
    job: &mut Job<'_>,
) -> Result<JointReport> {
    let name = drives::name_of(project);
    let own = joint::Drive {
        name: &name,
        project,
        poses,
        samples,
    };
    job.timed("adjust jointly", |progress| {
        joint::report(&own, two_steps, reference, progress)
    })
}

/// Calibrates the same drive under every other condition that `extras` and the reference allow.
fn calibrate_variants(
    Start {
        project, settings, ..
    }: &Start,
    extras: &Extras,
    (poses, samples): (&Poses, &[ScannerSample]),
    reference: &[Vec3],
    job: &mut Job<'_>,
) -> Result<Vec<(Variant, Calibration)>> {
    let mut variants = Vec::new();
    if !reference.is_empty() {
        let found = job.shown("calibrate without reference", |progress| {
            stages::calibration(project, settings, poses, samples, &[], progress)
        });
        variants.push((Variant::WithoutReference, found?));
    }
    if let Some(truth) = &extras.truth {
        let found = job.shown("calibrate with exact poses", |progress| {
            let exact = Poses::from_file(truth.trajectory.clone());
            let samples = stages::samples(project, &exact.trajectory, progress)?;
            stages::calibration(project, settings, &exact, &samples, reference, progress)
        });
        variants.push((Variant::ExactPoses, found?));
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
        variants.push((Variant::Paper, found?));
    }
    Ok(variants)
}

/// The mountings for which clouds are compared: initial, final, and the truth if known.
fn mountings(
    project: &Project,
    calibration: &Calibration,
    variants: &[(Variant, Calibration)],
    extras: &Extras,
) -> Vec<(MountingKind, Vec<BodyFromScanner>)> {
    let truth = extras.truth.as_ref().map(|truth| truth.mountings.clone());
    let mut mountings = vec![(MountingKind::Initial, stages::initial_poses(project))];
    let two_steps = variants
        .iter()
        .find(|(variant, _)| *variant == Variant::TwoStep);
    mountings.extend(two_steps.map(|(_, found)| (MountingKind::TwoStep, found.poses())));
    mountings.push((MountingKind::Final, calibration.poses()));
    mountings.extend(truth.map(|truth| (MountingKind::Truth, truth)));
    mountings
}

/// Results that need attention.
fn warnings(
    origin_m: &Vec3,
    calibration: &Calibration,
    joint: Option<&JointReport>,
    drives: &[Drive],
    left_out: Vec<String>,
) -> Vec<String> {
    let missing = drives.iter().flat_map(|drive| &drive.agreements.missing);
    let missing = missing.map(|(_, text)| text);
    let refused = joint.into_iter().flat_map(|joint| &joint.refused);
    let refused = refused.map(|reason| {
        format!("the result is that of two steps, not of the joint adjustment: {reason}")
    });
    let mut warnings: Vec<String> = refused.chain(missing.cloned()).chain(left_out).collect();
    if let Some(found) = joint.and_then(|joint| joint.found.as_ref()) {
        warnings.extend(found.regions.iter().map(|region| region.describe(origin_m)));
        warnings.extend(found.reference.and_then(|reference| reference.describe()));
    }
    if !calibration.converged {
        warnings.push("the calibration did not converge at every scale".into());
    }
    warnings.extend(report::constancy::warning(calibration));
    warnings.extend(report::constancy::gap_warning(calibration));
    let solution = drives.first().and_then(|drive| drive.solution.as_ref());
    if solution.is_some_and(|solution| !solution.converged) {
        warnings
            .push("the trajectory did not converge: its standard deviations are invalid".into());
    }
    warnings
}

/// The reference, thinned to a few thousand points.
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
    let accepted = findings.joint.as_ref().and_then(JointReport::accepted);
    if let Some(own) = findings.drives.first() {
        let moved = accepted.and_then(|joint| joint.drives.first());
        let moved = moved.map_or(&[][..], |drive| &drive.bending);
        let text = mounting::table(&findings.calibration, moved, &own.poses);
        job.write("mounting.csv", &text)?;
    }
    let project_then = stages::with_latencies(project, accepted);
    let calibrated = stages::with_mountings(&project_then, &findings.calibration.poses());
    let text = result::marked_toml(&calibrated, &findings.verdicts)?;
    job.write("calibration.toml", &text)?;
    job.write("project.toml", &project.to_toml()?)?;
    let page = report::render(&page::content(project, findings, extras));
    job.write("report.html", &page)?;
    let document = result::document(findings);
    job.write("result.json", &format!("{document:#}\n"))
}
