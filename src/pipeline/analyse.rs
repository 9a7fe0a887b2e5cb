//! A whole run: all stages in order.

use std::path::PathBuf;

use super::calibrated::{self, BeforeScans, Calibrated};
use super::calibration_drive::CalibrationDrive;
use super::clouds::Mounted;
use super::drives::DriveAndScene;
use super::findings::{Extras, Findings, KeptStages};
use super::finished::Finished;
use super::inputs::Inputs;
use super::job::Job;
use super::keys::{Key, Keys};
use super::open_project::OpenProject;
use super::outcome::Options;
use super::stages::{EstimatedPoses, Poses};
use super::{clouds, drives, stages, unfinished, write};
use crate::calibration::{Calibration, CalibrationSettings, Method, Variant};
use crate::comparison::Agreements;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::project::Project;
use crate::results::Drive;

/// Iterations per scale: the paper reports 50 to 450.
const PAPER_ITERATIONS: usize = 450;

/// Runs all stages on the project and writes all results into the folder `out` of the options. Stages that an earlier run
/// with this folder finished from the same inputs are not run again, unless the options ask for it.
///
/// # Errors
/// The first error of any stage. The results of the stages before it are then in the folder, unless there are none or the
/// run was cancelled.
pub fn analyse(
    project: &Project,
    options: &Options,
    extras: &Extras,
    progress: &dyn Progress,
) -> Result<Findings> {
    project.check_files()?;
    let cloud_names = clouds::names(project);
    let names = [&write::RESULTS.map(str::to_owned)[..], &cloud_names].concat();
    let inputs = project.inputs();
    let job = Job::new(options, &inputs, &names, progress)?;
    let inputs = Inputs::read(inputs, progress)?;
    let project = &OpenProject::with_origin(project, progress);
    let files = inputs.files();
    let run = Run {
        project,
        extras,
        keys: Keys::new(project, &inputs)?,
        cloud_names,
    };
    let finished = Finished::beside(&options.out, inputs, options.fresh);
    let mut job = job.with_finished(finished);
    let mut drive = CalibrationDrive::new(project);
    let results = unfinished::Results {
        out: &options.out,
        names: &names,
        progress,
    };

    let before = calibrated::before_scans(&drive, &run.keys, &mut job)?;
    let calibrated = Calibrated::run(project, &drive, &before, &run.keys, &mut job);
    let mut calibrated = match calibrated {
        Ok(calibrated) => calibrated,
        Err(error) => {
            let drive = run.without_clouds(before.poses);
            return Err(results.of_trajectory(project, extras, &drive, error, job));
        }
    };
    let mut drives = Vec::new();
    let ended = run.place_and_compare(&before, &mut calibrated, &mut drive, &mut drives, &mut job);
    if matches!(ended, Err(Error::Cancelled)) {
        return Err(Error::Cancelled);
    }
    if drives.is_empty() {
        let adjusted = calibrated.adjusted_poses(&before.poses);
        let poses = adjusted.unwrap_or(before.poses);
        drives.push((run.without_clouds(poses), None));
    }
    let (drives, scenes): (Vec<_>, Vec<_>) = drives.into_iter().unzip();
    let mountings = calibrated.mountings(extras.truth.as_ref());
    let mut findings = calibrated.findings(mountings, drives, &mut job);
    findings.scenes = scenes;
    findings.files = files;
    if let Err(error) = &ended {
        findings.end_early(error);
    }
    let written = write::all(project, &findings, extras, &ended, &job);
    if let Err(error) = ended.and(written) {
        return Err(results.of_calibration(&findings, error, job));
    }
    match job.commit() {
        Ok(finished) => {
            findings.kept_stages = finished.map(|finished| KeptStages {
                folder: finished.folder().to_owned(),
                bytes: finished.bytes(),
                reused: finished.reused().to_vec(),
            });
            Ok(findings)
        }
        Err(error) => Err(unfinished::shown(&findings, error, progress)),
    }
}

/// What all stages of a run need.
struct Run<'a> {
    project: &'a OpenProject,
    extras: &'a Extras,
    keys: Keys,
    cloud_names: Vec<String>,
}

impl Run<'_> {
    /// Runs the stages after the calibration: the calibrations for comparison, which are added to `calibrated`, the
    /// clouds, and the comparisons, which are added to `drives`.
    fn place_and_compare(
        &self,
        before: &BeforeScans,
        calibrated: &mut Calibrated<'_>,
        drive: &mut CalibrationDrive<'_>,
        drives: &mut Vec<DriveAndScene>,
        job: &mut Job<'_>,
    ) -> Result<()> {
        let (project, keys) = (self.project, &self.keys);
        let variants = calibrate_variants(calibrated, self.extras, drive, keys, job)?;
        calibrated.variants.extend(variants);
        drive.drop_poses_and_samples();
        let rig = calibrated.resulting_rig();
        let adjusted = drives::Adjusted::new(project, &before.poses, calibrated.accepted())?;
        let mounted = Mounted {
            rig: &rig,
            bending: &adjusted.bending,
        };
        let mut samples = None;
        let paths: Vec<PathBuf> = self.cloud_names.iter().map(|name| job.path(name)).collect();
        let placed = job.once_writing("georeference", &self.cloud_names, &keys.joint, |progress| {
            let trajectory = &adjusted.trajectory;
            let open = clouds::into_files(&paths, project, trajectory);
            let open = Some(&*open);
            samples = Some(clouds::stream(
                project, trajectory, mounted, open, progress,
            )?);
            Ok(())
        });
        if placed.is_err() {
            // Clouds may be cut off, and take the space that the other results need on a full disk.
            self.cloud_names.iter().for_each(|name| job.discard(name));
        }
        placed?;
        let compared = drives::Compared {
            project,
            rig: &rig,
            mountings: &calibrated.mountings(self.extras.truth.as_ref()),
            calibration: &calibrated.result,
            keys,
        };
        compared.all(before.poses.clone(), adjusted, samples, drive, drives, job)
    }

    /// The calibration drive with poses whose clouds were not compared.
    fn without_clouds(&self, poses: Poses) -> Drive {
        drives::drive(&drives::name_of(self.project), poses, Agreements::default())
    }
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
