//! A whole run: all stages in order.

use std::path::PathBuf;

use super::calibrated::{self, Calibrated};
use super::calibration_drive::CalibrationDrive;
use super::clouds::Mounted;
use super::findings::{Extras, Findings, KeptStages};
use super::finished::Finished;
use super::inputs::Inputs;
use super::job::Job;
use super::keys::{Key, Keys};
use super::outcome::Options;
use super::stages::EstimatedPoses;
use super::{clouds, drives, kept_page, page, result, stages};
use crate::calibration::{Calibration, CalibrationSettings, Method, Variant};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::project::Project;
use crate::report::{self, csv};

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

/// Iterations per scale: the paper reports 50 to 450.
const PAPER_ITERATIONS: usize = 450;

/// Runs all stages on the project and writes all results, or none, into the folder `out` of the options. Stages that an
/// earlier run with this folder finished from the same inputs are not run again, unless the options ask for it.
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
    let mut calibration_drive = CalibrationDrive::new(project);

    let (poses, mut calibrated) = Calibrated::run(project, &calibration_drive, &keys, &mut job)?;
    let variants = calibrate_variants(&calibrated, extras, &calibration_drive, &keys, &mut job)?;
    calibrated.variants.extend(variants);
    calibration_drive.drop_poses_and_samples();
    let rig = calibrated.resulting_rig();
    let adjusted = drives::Adjusted::new(project, &poses, calibrated.accepted())?;
    let mounted = Mounted {
        rig: &rig,
        bending: &adjusted.bending,
    };
    let mut samples = None;
    let cloud_paths: Vec<PathBuf> = cloud_names.iter().map(|name| job.path(name)).collect();
    job.once_writing("georeference", &cloud_names, &keys.joint, |progress| {
        let open = clouds::into_files(&cloud_paths, project.origin_m);
        let trajectory = &adjusted.trajectory;
        samples = Some(clouds::stream(
            project,
            trajectory,
            mounted,
            Some(&*open),
            progress,
        )?);
        Ok(())
    })?;
    let mountings = calibrated.mountings(extras.truth.as_ref());
    let compared = drives::Compared {
        project,
        rig: &rig,
        mountings: &mountings,
        calibration: &calibrated.result,
        keys: &keys,
    };
    let drives = compared.all(poses, adjusted, samples, &calibration_drive, &mut job)?;
    let (drives, scenes): (Vec<_>, Vec<_>) = drives.into_iter().unzip();
    let mut findings = calibrated.findings(mountings, drives, &mut job);
    findings.scenes = scenes;
    findings.files = files;
    write(project, &findings, extras, &job)?;
    findings.kept_stages = job.commit()?.map(|finished| KeptStages {
        folder: finished.folder().to_owned(),
        bytes: finished.bytes(),
        reused: finished.reused().to_vec(),
    });
    Ok(findings)
}

/// Calibrates the same drive under the other conditions: without the reference, with the true poses and by the paper's
/// method, as far as `extras` ask for it.
fn calibrate_variants(
    calibrated: &Calibrated<'_>,
    extras: &Extras,
    drive: &CalibrationDrive<'_>,
    keys: &Keys,
    job: &mut Job<'_>,
) -> Result<Vec<(Variant, Calibration)>> {
    let Calibrated {
        project,
        rig,
        start,
        ..
    } = calibrated;
    let (begin, settings) = (&start.rig.mountings, start.rig.settings(project));
    let mut calibrate =
        |name: &str, key: &Key, work: &dyn Fn(&dyn Progress) -> Result<Calibration>| {
            job.once(name, key, |progress| {
                let _stage = progress.stage(name, 0);
                work(progress)
            })
        };
    let key = &keys.calibration;
    let mut variants = Vec::new();
    if extras.without_reference && project.reference.is_some() {
        let calibration = calibrate("calibrate without reference", key, &|progress| {
            let (poses, samples) = (drive.poses(progress)?, drive.samples(rig, progress)?);
            stages::calibration(project, begin, &settings, poses, samples, &[], progress)
        });
        variants.push((Variant::WithoutReference, calibration?));
    }
    if let Some(truth) = &extras.truth {
        let key = key.clone().with(&truth.trajectory);
        let calibration = calibrate("calibrate with exact poses", &key, &|progress| {
            let exact = EstimatedPoses::from_file(truth.trajectory.clone());
            let samples = stages::samples(project, &start.rig, exact.trajectory(), progress)?;
            let reference = drive.reference(progress)?;
            stages::calibration(
                project, begin, &settings, &exact, &samples, reference, progress,
            )
        });
        variants.push((Variant::ExactPoses, calibration?));
    }
    if !extras.paper_voxels_m.is_empty() {
        let paper = CalibrationSettings {
            voxel_sizes_m: extras.paper_voxels_m.clone(),
            method: Method::Paper,
            max_iterations: PAPER_ITERATIONS,
            ..settings.clone()
        };
        let key = key.clone().with(&paper);
        let calibration = calibrate("calibrate as the paper", &key, &|progress| {
            let (poses, samples) = (drive.poses(progress)?, drive.samples(rig, progress)?);
            let reference = drive.reference(progress)?;
            stages::calibration(project, begin, &paper, poses, samples, reference, progress)
        });
        variants.push((Variant::Paper, calibration?));
    }
    Ok(variants)
}

/// Writes all results except the clouds, which are already staged.
fn write(project: &Project, findings: &Findings, extras: &Extras, job: &Job<'_>) -> Result<()> {
    if let Some(drive) = findings.drives.first() {
        let path = job.path("trajectory.csv");
        stages::write_trajectory(&path, &drive.poses, &project.origin_m)?;
    }
    calibrated::write(project, findings, job)?;
    let scales = &findings.rig.voxel_sizes_m;
    job.write("project.toml", &project.to_toml_with_scales(scales)?)?;
    let mut content = page::content(project, findings, extras)?;
    for file in &csv::FILES {
        let text = file.text(&content);
        if !text.is_empty() {
            job.write(&format!("{}/{}", csv::FOLDER, file.name), &text)?;
            content.csv.push(file.name.to_owned());
        }
    }
    job.write("report.html", &report::render(&content))?;
    let path = job.path(kept_page::NAME);
    let bytes = kept_page::bytes_of(&content, &project.path)?;
    std::fs::write(&path, bytes).map_err(|error| Error::io(&path, error))?;
    let document = result::document(findings);
    job.write("result.json", &format!("{document:#}\n"))
}
