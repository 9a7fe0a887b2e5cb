//! A whole run: all stages in order.

use std::path::PathBuf;

use super::clouds::Mounted;
use super::findings::{Extras, Findings, KeptStages};
use super::finished::Finished;
use super::inputs::Inputs;
use super::job::Job;
use super::keys::{Key, Keys};
use super::outcome::Options;
use super::own::Own;
use super::stages::EstimatedPoses;
use super::start::{self, Start};
use super::{clouds, drives, joint, kept_page, mounting, page, result, stages};
use crate::calibration::{Calibration, CalibrationSettings, Method, Minimum, Variant};
use crate::cloud::voxel;
use crate::comparison::MountingKind;
use crate::error::{Error, Result};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::joint::JointReport;
use crate::judgement;
use crate::progress::Progress;
use crate::project::Project;
use crate::report::{self, csv};
use crate::stored::stored;
use crate::verdict::Severity;

/// Results other than the clouds.
const RESULTS: [&str; 7] = [
    "trajectory.csv",
    "mounting.csv",
    "calibration.toml",
    "project.toml",
    "report.html",
    kept_page::NAME,
    "result.json",
];

/// The paper reports 50 to 450 iterations per scale.
const PAPER_ITERATIONS: usize = 450;

/// Runs all stages on the project and writes every result into the folder `out` of the options, whole or not at
/// all. Stages that an earlier run with this folder finished from the same inputs are not run again, unless the
/// options say so.
///
/// # Errors
/// The first error of any stage; the folder then keeps its previous content.
pub fn analyse(
    project: &Project,
    options: &Options,
    extras: &Extras,
    progress: &dyn Progress,
) -> Result<Findings> {
    project.check_files()?;
    let names: Vec<String> = RESULTS.map(str::to_owned).into();
    let cloud_names = clouds::names(project);
    let names = [names.as_slice(), &cloud_names].concat();
    let inputs = project.inputs();
    let job = Job::new(&options.out, &inputs, &names, progress)?;
    let inputs = Inputs::read(inputs, progress)?;
    let keys = Keys::new(project, &inputs)?;
    let files = inputs.files();
    let finished = Finished::beside(&options.out, inputs, options.fresh);
    let mut job = job.with_finished(finished);
    let mut own = Own::new(project);

    let calibration_key = &keys.calibration;
    let background_m = job.once("reference", &keys.reference, |progress| {
        Ok(thinned_for_drawing(own.reference(progress)?))
    })?;
    let poses = job.once("trajectory", &keys.poses, |progress| {
        Ok(own.poses(progress)?.poses.clone())
    })?;
    let sampled = job.once("sample", calibration_key, |progress| {
        let scaled = start::with_scales(project, &poses.trajectory, progress)?;
        let samples = own.samples(&scaled, progress)?;
        stages::check_reference(&scaled, samples, own.reference(progress)?)?;
        Ok(Sampled {
            voxel_sizes_m: scaled.calibration.voxel_sizes_m.clone(),
        })
    })?;
    let project = &sampled.project(project);
    let start = job.once("check placement", calibration_key, |progress| {
        let samples = own.samples(project, progress)?;
        let reference = own.reference(progress)?;
        let trajectory = &poses.trajectory;
        Ok(start::start(
            project, trajectory, samples, reference, progress,
        ))
    })?;
    let two_steps = job.once("calibrate", calibration_key, |progress| {
        let (begin, settings) = (start.project(project), start.settings(project));
        let (poses, samples) = (own.poses(progress)?, own.samples(project, progress)?);
        let reference = own.reference(progress)?;
        stages::calibration(&begin, &settings, poses, samples, reference, progress)
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
        (true, None) => Some(job.once("adjust jointly", &keys.joint, |progress| {
            let drive = joint::Drive {
                name: &drives::name_of(project),
                project,
                poses: own.poses(progress)?,
                samples: own.samples(project, progress)?,
            };
            joint::report(&drive, &two_steps, own.reference(progress)?, progress)
        })?),
        (true, Some(reason)) => Some(JointReport {
            refused: vec![reason.into()],
            ..JointReport::default()
        }),
        (false, _) => None,
    };
    let mut variants = calibrate_variants((project, &start), extras, &own, &keys, &mut job)?;
    own.forget_poses_and_samples();
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
    let found = calibration.poses();
    let mounted = Mounted {
        mountings: &found,
        bending: &adjusted.bending,
    };
    let mut kept = None;
    let cloud_paths: Vec<PathBuf> = cloud_names.iter().map(|name| job.path(name)).collect();
    job.once_writing("georeference", &cloud_names, &keys.joint, |progress| {
        let open = clouds::into_files(&cloud_paths, placed.origin_m);
        let written = Some((mounted, &*open));
        let points = clouds::stream(&placed, &adjusted.trajectory, written, progress)?;
        kept = Some(points);
        Ok(())
    })?;
    let mountings = mountings(project, &calibration, &variants, extras);
    let origin_sigma_m = stages::origin_sigma_m(project, poses.solution.as_ref());
    let compared = drives::Compared {
        project: &placed,
        mountings: &mountings,
        calibration: &calibration,
        keys: &keys,
    };
    let shown = compared.all((poses, adjusted, kept), &own, &mut job)?;
    let (drives, scenes): (Vec<_>, Vec<_>) = shown.into_iter().unzip();
    // An error of the origin moves no point of a drive, and is left out until here.
    let calibration = calibration.with_origin_sigma(origin_sigma_m);
    let variants = variants.into_iter().map(|(variant, found)| match variant {
        Variant::ExactPoses => (variant, found),
        _ => (variant, found.with_origin_sigma(origin_sigma_m)),
    });
    let variants = variants.collect();

    job.warn_of_changes();
    let mut findings = Findings {
        calibration,
        joint,
        variants,
        mountings,
        drives,
        scenes,
        origin_m: project.origin_m,
        background_m,
        made_s: page::now_s(),
        files,
        stages: job.stages().to_vec(),
        placement: start.said,
        warnings: job.warnings().to_vec(),
        verdicts: Vec::new(),
        kept: None,
    };
    findings.verdicts = judgement::judge(&findings.results(), &project.acceptance);
    write(project, &findings, extras, &job)?;
    findings.kept = job.commit()?.map(|finished| KeptStages {
        folder: finished.folder().to_owned(),
        bytes: finished.bytes(),
        found: finished.found().to_vec(),
    });
    Ok(findings)
}

/// What samples tell of a project.
struct Sampled {
    voxel_sizes_m: Vec<f64>,
}
stored!(struct Sampled { voxel_sizes_m });

impl Sampled {
    /// The project with the scales that follow from its points.
    fn project(&self, project: &Project) -> Project {
        let mut project = project.clone();
        project.has_auto_scales = false;
        project.calibration.voxel_sizes_m = self.voxel_sizes_m.clone();
        project
    }
}

/// Calibrates the same drive under every other condition that `extras` and the reference allow.
fn calibrate_variants(
    (project, start): (&Project, &Start),
    extras: &Extras,
    own: &Own<'_>,
    keys: &Keys,
    job: &mut Job<'_>,
) -> Result<Vec<(Variant, Calibration)>> {
    let begin = start.project(project);
    let settings = start.settings(project);
    let mut calibrate =
        |name: &str, key: &Key, work: &dyn Fn(&dyn Progress) -> Result<Calibration>| {
            job.once(name, key, |progress| {
                let _stage = progress.stage(name, 0);
                work(progress)
            })
        };
    let key = &keys.calibration;
    let mut variants = Vec::new();
    if project.reference.is_some() {
        let found = calibrate("calibrate without reference", key, &|progress| {
            let (poses, samples) = (own.poses(progress)?, own.samples(project, progress)?);
            stages::calibration(&begin, &settings, poses, samples, &[], progress)
        });
        variants.push((Variant::WithoutReference, found?));
    }
    if let Some(truth) = &extras.truth {
        let key = key.clone().with(&truth.trajectory);
        let found = calibrate("calibrate with exact poses", &key, &|progress| {
            let exact = EstimatedPoses::from_file(truth.trajectory.clone());
            let samples = stages::samples(&begin, exact.trajectory(), progress)?;
            let reference = own.reference(progress)?;
            stages::calibration(&begin, &settings, &exact, &samples, reference, progress)
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
        let key = key.clone().with(&paper);
        let found = calibrate("calibrate as the paper", &key, &|progress| {
            let (poses, samples) = (own.poses(progress)?, own.samples(project, progress)?);
            let reference = own.reference(progress)?;
            stages::calibration(&begin, &paper, poses, samples, reference, progress)
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

/// The reference, thinned to a few thousand points.
pub fn thinned_for_drawing(reference: &[Vec3]) -> Vec<Vec3> {
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
    let mut content = page::content(project, findings, extras)?;
    for file in &csv::FILES {
        let text = file.text(&content);
        if !text.is_empty() {
            job.write(&format!("{}/{}", csv::FOLDER, file.name), &text)?;
            content.csv.push(file.name);
        }
    }
    job.write("report.html", &report::render(&content))?;
    let kept = job.path(kept_page::NAME);
    let bytes = kept_page::bytes_of(&content, &project.path);
    std::fs::write(&kept, bytes).map_err(|error| Error::io(&kept, error))?;
    let document = result::document(findings);
    job.write("result.json", &format!("{document:#}\n"))
}
