//! Clouds placed with given mountings and poses.

use std::fs::File;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::clouds::Mounted;
use super::commands::files_in;
use super::job::Job;
use super::open_project::OpenProject;
use super::outcome::{Options, Outcome};
use super::result::judge;
use super::rig::Rig;
use super::{clouds, drives, stages, unfinished};
use crate::comparison::Agreements;
use crate::error::{Error, Location, Result};
use crate::judgement;
use crate::progress::Progress;
use crate::project::{Motion, Project};
use crate::results::Results;
use crate::verdict::Verdict;

/// A project with the mountings and poses with which its points are placed: those of the project, or the results of an
/// earlier run.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    project: Project,
    rig: Rig,
    inputs: Vec<PathBuf>,
    calibration: Option<PathBuf>,
    /// Remarks on the choice of values, for the log.
    remarks: Vec<String>,
}

impl Placement {
    /// Reads the mountings from `calibration`, and checks that every file exists that is needed to place points. The
    /// poses come from `trajectory`. Where one of them is `None`, the project's mountings or poses are used.
    ///
    /// # Errors
    /// A missing file; see [`Project::calibrated_scanners`].
    pub fn new(
        project: &Project,
        calibration: Option<&Path>,
        trajectory: Option<&Path>,
    ) -> Result<Self> {
        let mut inputs = project.inputs();
        inputs.extend(
            calibration
                .into_iter()
                .chain(trajectory)
                .map(Path::to_owned),
        );
        let rig = match calibration {
            Some(path) => Rig::calibrated(project, path)?,
            None => Rig::new(project),
        };
        let project = match trajectory {
            Some(path) => {
                check_poses(path)?;
                project.with_trajectory(path)?
            }
            None => project.clone(),
        };
        project.check_files()?;
        let offsets = project.scanners.iter().zip(&rig.time_offsets_s);
        let remarks = offsets
            .filter(|(scanner, used_s)| scanner.time_offset_s != **used_s)
            .map(|(scanner, used_s)| {
                format!(
                    "scanner `{}`: the time offset is {used_s} s, as in the calibration, not {} s, as in \
                     the project",
                    scanner.name, scanner.time_offset_s
                )
            })
            .collect();
        Ok(Self {
            project,
            rig,
            inputs,
            calibration: calibration.map(Path::to_owned),
            remarks,
        })
    }

    /// All files of the project, and the additional files given on the command line.
    pub fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }

    /// The files with the mountings and with the poses, or with the logs of the poses.
    fn sources(&self) -> [&Path; 2] {
        let project_file = &self.project.path;
        let poses = match &self.project.motion {
            Motion::Logs(_) => project_file,
            Motion::Poses(poses) => &poses.path,
        };
        [self.calibration.as_ref().unwrap_or(project_file), poses]
    }

    /// A verdict if the mountings of the project are used although there is a newer calibration.
    fn newer_calibration(&self) -> Option<Verdict> {
        let project_file = &self.project.path;
        let calibration_file = project_file.with_file_name("out").join("calibration.toml");
        let changed = |path: &Path| path.metadata().and_then(|data| data.modified()).ok();
        let is_newer =
            self.calibration.is_none() && changed(&calibration_file)? > changed(project_file)?;
        is_newer.then(|| judgement::newer_calibration(project_file, &calibration_file))
    }

    /// A verdict if the mountings come from a calibration that is marked as not usable.
    fn unusable_calibration(&self) -> Result<Option<Verdict>> {
        let path = self.calibration.as_deref();
        Ok(path.map(marked_unusable).transpose()?.flatten())
    }

    /// `placed with the mountings of …, on the poses of …`
    fn description(&self) -> String {
        let [mountings, poses] = self.sources();
        let mountings = match &self.calibration {
            Some(_) => format!("the mountings of {}", mountings.display()),
            None => "the project's mountings".to_owned(),
        };
        let poses = match &self.project.motion {
            Motion::Logs(_) => "the trajectory estimated from its logs".to_owned(),
            Motion::Poses(_) => format!("the poses of {}", poses.display()),
        };
        format!("placed with {mountings}, on {poses}")
    }
}

/// A verdict if a `calibration.toml` is marked as not usable.
///
/// # Errors
/// See [`crate::project::mountings`].
pub fn marked_unusable(calibration: &Path) -> Result<Option<Verdict>> {
    let is_unusable = crate::project::mountings(calibration)?.is_unusable;
    Ok(is_unusable.then(|| judgement::unusable_calibration(calibration)))
}

/// Checks that the file of the poses, which no key of the project names, can be opened.
fn check_poses(path: &Path) -> Result<()> {
    if path.is_dir() {
        let expected = "a file of poses, such as `trajectory.csv` in it";
        return Err(Error::format(path, Location::Whole, "a folder", expected));
    }
    let opened = File::open(path).map(drop);
    opened.map_err(|source| Error::io(path, source))
}

/// Georeferences the profiles.
///
/// # Errors
/// Errors of the stages.
pub fn georeference(
    placement: &Placement,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let (project, rig) = (
        &OpenProject::with_origin(&placement.project, progress),
        &placement.rig,
    );
    let names = clouds::names(project);
    let mut job = Job::new(options, placement.inputs(), &names, progress)?;
    for remark in &placement.remarks {
        progress.say(remark);
    }
    let poses = stages::poses(project, progress)?.poses;
    let bending = clouds::bending(rig, &poses.trajectory);
    let mounted = Mounted {
        rig,
        bending: &bending,
    };
    if let Err(error) = clouds::write(project, &poses.trajectory, mounted, &mut job) {
        let results = unfinished::Results {
            out: &options.out,
            names: &names,
            progress,
        };
        return Err(results.of_clouds(error, job));
    }
    job.commit()?;
    let files = files_in(&options.out, names);
    let marked = placement
        .unusable_calibration()?
        .or_else(|| placement.newer_calibration());
    let drive = drives::drive(&drives::name_of(project), poses, Agreements::default());
    let results = Results {
        drives: std::slice::from_ref(&drive),
        ..Results::default()
    };
    let mut verdicts = judgement::judge(&results, &project.acceptance);
    verdicts.push(marked.unwrap_or_else(|| judgement::placed(&placement.description())));
    judgement::attention_first(&mut verdicts);
    let [mountings_from, poses_from] = placement.sources();
    let mut result = json!({
        "clouds": files,
        "mountings_from": mountings_from,
        "poses_from": poses_from,
    });
    judge(&mut result, &verdicts);
    Ok(Outcome {
        result,
        verdicts: Some(verdicts),
        summary: format!(
            "{} cloud{}, {}",
            files.len(),
            if files.len() == 1 { "" } else { "s" },
            placement.description()
        ),
        files,
    })
}
