//! The stages in order: logs → trajectory → mounting → clouds → comparison → report.
//!
//! [`analyse`] is the whole program on one page; [`commands`] and [`mod@compare`] are its parts as the
//! command line calls them.

pub mod clouds;
pub mod commands;
pub mod compare;
pub mod evaluate;
pub mod features;
pub mod logs;
mod memory;
pub mod online;
pub mod page;
pub mod result;
pub mod stages;
pub mod summary;
pub mod thin;
pub mod tile_store;
pub mod tiled;
pub mod verdicts;

use std::path::Path;
use std::time::Instant;

use crate::calibration::Calibration;
use crate::calibration::{CalibrationSettings, Method};
use crate::error::{Error, Result};
use crate::format;
use crate::geometry::{Pose, Vec3};
use crate::output::Staging;
use crate::progress::Progress;
use crate::project::Project;
use crate::report::{self, content::MountingKind};
use crate::sensor::{PoseRecord, RejectedRow};
use crate::trajectory::{Solution, Trajectory};
pub use commands::{Options, Outcome, calibrate, demo, georeference, run, simulate, trajectory};
pub use compare::{Comparison, NormalSource, compare};
use evaluate::Drive;
pub use features::{FeatureSettings, features};
pub use memory::peak_memory_bytes;
use stages::Poses;
pub use thin::thin;

/// What a simulated project knows beside its files.
#[derive(Debug, Clone)]
pub struct Truth {
    /// True mountings in the order of the project's scanners.
    pub mountings: Vec<Pose>,
    /// True poses of the calibration drive.
    pub trajectory: Trajectory,
}

/// What a run does beside the plain work.
#[derive(Debug, Clone, Default)]
pub struct Extras {
    /// The command as typed, for the report.
    pub command: String,
    /// The seed of every random draw, where there is one.
    pub seed: Option<u64>,
    /// The truth, where it is known.
    pub truth: Option<Truth>,
    /// Scales at which the paper's own method is run beside ours; empty for none.
    pub paper_voxels_m: Vec<f64>,
}

/// Run time of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct StageSeconds {
    /// Name.
    pub name: String,
    /// Seconds.
    pub seconds: f64,
}

/// Where the body was on one drive.
#[derive(Debug, Clone)]
pub struct Track {
    /// Name of the drive.
    pub name: String,
    /// The poses, the project's origin subtracted.
    pub poses: Vec<PoseRecord>,
    /// What the adjustment left; `None` where the poses came from a file.
    pub solution: Option<Solution>,
}

impl Track {
    /// Of the drive of this name.
    pub fn new(name: String, poses: &Poses) -> Self {
        Self {
            name,
            poses: poses.trajectory.nodes().to_vec(),
            solution: poses.solution.clone(),
        }
    }
}

/// Everything a run found.
#[derive(Debug)]
pub struct Findings {
    /// The calibration: with the reference where there is one.
    pub calibration: Calibration,
    /// The same without the reference, where there is one.
    pub without_reference: Option<Calibration>,
    /// With the true poses, where they are known.
    pub exact_poses: Option<Calibration>,
    /// The paper's method at the scales asked for.
    pub paper: Option<Calibration>,
    /// True mountings, where they are known.
    pub truth_mountings: Option<Vec<Pose>>,
    /// Rows of the logs that hold no measurement.
    pub rejected_rows: Vec<RejectedRow>,
    /// Poses of every drive: the calibration drive, then the evaluation drives.
    pub tracks: Vec<Track>,
    /// The calibration drive, then the evaluation drives.
    pub drives: Vec<Drive>,
    /// The reference, thinned for drawing.
    pub background: Vec<Vec3>,
    /// Run times in order.
    pub stages: Vec<StageSeconds>,
    /// What somebody should look at.
    pub warnings: Vec<String>,
}

/// As [`timed`], and shown as a stage around those of `work`: for what runs again.
fn shown<T>(
    stages: &mut Vec<StageSeconds>,
    name: &str,
    progress: &dyn Progress,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    progress.begin(name, 0);
    let done = timed(stages, name, work);
    progress.end();
    done
}

/// Runs `work` and notes how long it took under `name`.
fn timed<T>(
    stages: &mut Vec<StageSeconds>,
    name: &str,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let started = Instant::now();
    let done = work()?;
    stages.push(StageSeconds {
        name: name.into(),
        seconds: started.elapsed().as_secs_f64(),
    });
    Ok(done)
}

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
    let mut names = result_names();
    names.extend(project.scanners.iter().map(|s| clouds::file_name(&s.name)));
    let staging = Staging::new(out, &project.inputs(), &names)?;
    let mut times = Vec::new();

    let reference = timed(&mut times, "reference", || {
        stages::reference(project, progress)
    })?;
    let poses = timed(&mut times, "trajectory", || {
        stages::poses(project, progress)
    })?;
    let samples = timed(&mut times, "sample", || {
        stages::samples(project, &poses.trajectory, progress)
    })?;
    stages::check_reference(project, &samples, &reference)?;
    let settings = &project.calibration;
    let calibrate =
        |poses: &Poses, samples: &[_], reference: &[Vec3], settings: &CalibrationSettings| {
            stages::calibration(project, settings, poses, samples, reference, progress)
        };
    let calibration = timed(&mut times, "calibrate", || {
        calibrate(&poses, &samples, &reference, settings)
    })?;
    let without_reference = match reference.is_empty() {
        true => None,
        false => Some(shown(
            &mut times,
            "calibrate without reference",
            progress,
            || calibrate(&poses, &samples, &[], settings),
        )?),
    };
    let exact_poses = match &extras.truth {
        Some(truth) => Some(shown(
            &mut times,
            "calibrate with exact poses",
            progress,
            || {
                let exact = Poses::from_file(truth.trajectory.clone());
                let samples = stages::samples(project, &exact.trajectory, progress)?;
                calibrate(&exact, &samples, &reference, settings)
            },
        )?),
        None => None,
    };
    let paper = match extras.paper_voxels_m.is_empty() {
        true => None,
        false => Some(shown(
            &mut times,
            "calibrate as the paper",
            progress,
            || {
                let voxel_sizes_m = extras.paper_voxels_m.clone();
                let paper = CalibrationSettings {
                    voxel_sizes_m,
                    method: Method::Paper,
                    max_iterations: PAPER_ITERATIONS,
                    ..settings.clone()
                };
                calibrate(&poses, &samples, &reference, &paper)
            },
        )?),
    };
    let refusals: Vec<String> = project
        .scanners
        .iter()
        .zip(&samples)
        .filter_map(|(scanner, s)| stages::refusal(&scanner.name, s.read, &s.refused))
        .collect();
    drop(samples);

    let truth = extras.truth.as_ref().map(|truth| truth.mountings.clone());
    let kinds = kinds(project, &calibration, truth.as_deref());
    let found = calibration.poses();
    let kept = timed(&mut times, "georeference", || {
        let write =
            |scanner: &crate::project::Scanner| staging.path(&clouds::file_name(&scanner.name));
        clouds::stream(project, &poses.trajectory, &found, Some(&write), progress)
    })?;
    let mut drives = Vec::new();
    let mut tracks = vec![Track::new(name_of(project), &poses)];
    drives.push(timed(&mut times, "compare", || {
        compare_drive(
            &name_of(project),
            project,
            &poses.trajectory,
            &reference,
            &kinds,
            &kept,
            progress,
        )
    })?);
    drop(kept);
    for evaluation in &project.evaluations {
        let other = aligned(project, Project::read(&evaluation.project)?)?;
        let stage = format!("evaluate {}", evaluation.name);
        let drive = shown(&mut times, &stage, progress, || {
            let poses = stages::poses(&other, progress)?;
            let kept = clouds::stream(&other, &poses.trajectory, &found, None, progress)?;
            tracks.push(Track::new(evaluation.name.clone(), &poses));
            let name = &evaluation.name;
            compare_drive(
                name,
                &other,
                &poses.trajectory,
                &reference,
                &kinds,
                &kept,
                progress,
            )
        })?;
        drives.push(drive);
    }

    let mut warnings: Vec<String> = drives
        .iter()
        .flat_map(|drive| drive.missing.iter().cloned())
        .chain(refusals)
        .collect();
    if !calibration.converged {
        warnings.push("the calibration did not converge at every scale".into());
    }
    warnings.extend(page::not_constant(&calibration));
    if poses
        .solution
        .as_ref()
        .is_some_and(|solution| !solution.converged)
    {
        warnings.push("the trajectory did not converge: its sigmas mean nothing".into());
    }
    warnings.iter().for_each(|warning| progress.warn(warning));
    let findings = Findings {
        without_reference,
        exact_poses,
        paper,
        truth_mountings: truth,
        rejected_rows: poses.rejected_rows,
        tracks,
        drives,
        background: thinned_for_drawing(&reference),
        stages: times,
        warnings,
        calibration,
    };
    write(project, &poses.trajectory, &findings, extras, &staging)?;
    staging.commit()?;
    Ok(findings)
}

/// The paper reports 50 to 450 iterations a scale.
const PAPER_ITERATIONS: usize = 450;

/// Mountings to compare: initial, final, and the truth where it is known.
fn kinds(
    project: &Project,
    calibration: &Calibration,
    truth: Option<&[Pose]>,
) -> Vec<(MountingKind, Vec<Pose>)> {
    let initial = project
        .scanners
        .iter()
        .map(|scanner| scanner.body_from_scanner)
        .collect();
    let mut kinds = vec![
        (MountingKind::Initial, initial),
        (MountingKind::Final, calibration.poses()),
    ];
    if let Some(truth) = truth {
        kinds.push((MountingKind::Truth, truth.to_vec()));
    }
    kinds
}

fn compare_drive(
    name: &str,
    project: &Project,
    trajectory: &Trajectory,
    reference: &[Vec3],
    kinds: &[(MountingKind, Vec<Pose>)],
    kept: &clouds::KeptPoints,
    progress: &dyn Progress,
) -> Result<Drive> {
    let placed: Vec<_> = kinds
        .iter()
        .map(|(kind, mountings)| (*kind, clouds::place(project, trajectory, mountings, kept)))
        .collect();
    evaluate::evaluate(name, project, reference, &placed, progress)
}

/// The evaluation project with its scanners in the order of `project`, judged by the same rules.
fn aligned(project: &Project, mut other: Project) -> Result<Project> {
    let mut scanners = Vec::new();
    for scanner in &project.scanners {
        let same = other
            .scanners
            .iter()
            .find(|candidate| candidate.name == scanner.name);
        scanners.push(same.cloned().ok_or_else(|| {
            Error::data(
                format!("{} has no scanner `{}`", other.path.display(), scanner.name),
                "an evaluation drive needs every scanner of the calibrated project",
            )
        })?);
    }
    other.scanners = scanners;
    other.comparison = project.comparison.clone();
    other.origin_m = project.origin_m;
    other.limits = other.limits.or(project.limits);
    Ok(other)
}

/// The folder of the project file names the drive.
fn name_of(project: &Project) -> String {
    let folder = project.path.parent().and_then(Path::file_name);
    folder.map_or_else(
        || "drive".into(),
        |name| name.to_string_lossy().into_owned(),
    )
}

/// A few thousand points of the reference.
fn thinned_for_drawing(reference: &[Vec3]) -> Vec<Vec3> {
    const VOXEL_M: f64 = 0.05;
    let kept = crate::cloud::voxel::thin(reference, VOXEL_M);
    kept.iter()
        .map(|&index| reference[index as usize])
        .collect()
}

/// What [`write()`] writes.
fn result_names() -> Vec<String> {
    let names = [
        "trajectory.csv",
        "calibration.toml",
        "project.toml",
        "report.html",
        "result.json",
    ];
    names.map(str::to_owned).into()
}

/// Writes everything but the clouds, which are already staged.
fn write(
    project: &Project,
    trajectory: &Trajectory,
    findings: &Findings,
    extras: &Extras,
    staging: &Staging,
) -> Result<()> {
    let text = |name: &str, text: &str| {
        let path = staging.path(name);
        std::fs::write(&path, text).map_err(|error| Error::io(&path, error))
    };
    write_trajectory(
        &staging.path("trajectory.csv"),
        trajectory,
        &project.origin_m,
    )?;
    let calibrated = stages::with_mountings(project, &findings.calibration.poses());
    text("calibration.toml", &calibrated.scanners_to_toml()?)?;
    text("project.toml", &project.to_toml()?)?;
    text(
        "report.html",
        &report::render(&page::content(project, findings, extras)),
    )?;
    let document = result::document(project, findings);
    text("result.json", &format!("{document:#}\n"))
}

/// Writes a trajectory with the project's origin added back.
///
/// # Errors
/// The file cannot be written.
pub fn write_trajectory(path: &Path, trajectory: &Trajectory, origin_m: &Vec3) -> Result<()> {
    let mut nodes = trajectory.nodes().to_vec();
    nodes
        .iter_mut()
        .for_each(|node| node.world_from_body.translation.vector += origin_m);
    format::write_trajectory(path, &nodes)
}
