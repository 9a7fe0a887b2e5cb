//! The commands of the command line, as functions.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::analyse::analyse;
use super::calibrated::{self, Calibrated};
use super::calibration_drive::CalibrationDrive;
use super::findings::{Extras, Findings, Truth};
use super::inputs::Inputs;
use super::job::Job;
use super::keys::Keys;
use super::open_project::OpenProject;
use super::outcome::{Options, Outcome};
use super::{clouds, drives, page, result, stages, summary, unfinished, write};
use crate::comparison::Agreements;
use crate::error::Result;
use crate::format;
use crate::judgement;
use crate::output::refuse_kept;
use crate::progress::Progress;
use crate::project::Project;
use crate::report;
use crate::results::Results;
use crate::simulation::{self, Scenario};
use crate::tiles::peak_memory_bytes;
use crate::trajectory::Trajectory;

/// Scales at which the demo also runs the paper's method: the finer ones take minutes.
const DEMO_PAPER_VOXELS_M: [f64; 2] = [0.05, 0.04];

/// Simulates the paper's drives, runs all stages on them and writes the report.
///
/// # Errors
/// Errors of the stages.
pub fn demo(options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let mut scenario = Scenario::demo();
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    let data = options.out.join("data");
    let names = simulation::output_names(&scenario);
    let names: Vec<PathBuf> = names
        .iter()
        .map(|name| Path::new("data").join(name))
        .collect();
    refuse_kept(&options.out, &names, &options.kept)?;
    let files = simulation::simulate(&scenario, &data, progress)?;
    let project = Project::read(&files.drives[0].project)?;
    let extras = Extras {
        command: "boresight demo".into(),
        seed: Some(scenario.seed),
        truth: Some(truth(
            &project,
            &scenario,
            &files.drives[0].folder.join("truth"),
        )?),
        without_reference: true,
        paper_voxels_m: DEMO_PAPER_VOXELS_M.to_vec(),
    };
    let findings = analyse(&project, options, &extras, progress)?;
    Ok(outcome(&findings, &options.out))
}

/// The truth of the first drive: its poses as written into `folder`, and the scenario's mountings.
fn truth(project: &Project, scenario: &Scenario, folder: &Path) -> Result<Truth> {
    let trajectory = Trajectory::new(format::read_trajectory(&folder.join("trajectory.csv"))?)?;
    let names = scenario
        .scanners
        .iter()
        .map(|scanner| scanner.name.as_str());
    let known: Vec<_> = names.zip(scenario.true_mountings()).collect();
    let mountings = project
        .scanners
        .iter()
        .filter_map(|s| {
            known
                .iter()
                .find(|(name, _)| *name == s.name)
                .map(|(_, pose)| *pose)
        })
        .collect();
    Ok(Truth {
        mountings,
        trajectory,
    })
}

/// Writes the drives of `scenario` as sensor files, together with the truth.
///
/// # Errors
/// An invalid scenario, a folder that cannot be written.
pub fn simulate(
    mut scenario: Scenario,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    let files = simulation::simulate(&scenario, &options.out, progress)?;
    let drives: Vec<Value> = files
        .drives
        .iter()
        .map(|drive| {
            json!({
                "project": drive.project,
                "duration_s": drive.duration_s,
                "profiles": drive.profiles,
                "points": drive.points,
            })
        })
        .collect();
    let points: u64 = files.drives.iter().map(|drive| drive.points).sum();
    let mut written: Vec<PathBuf> = files.drives.iter().map(|d| d.project.clone()).collect();
    written.extend(
        files
            .reference
            .iter()
            .map(|reference| reference.file.clone()),
    );
    let reference = files.reference.as_ref();
    Ok(Outcome {
        result: json!({
            "drives": drives,
            "reference": reference.map(|r| json!({ "file": r.file, "points": r.points })),
        }),
        verdicts: None,
        summary: format!(
            "{} drives, {points} laser points, {} reference points",
            drives.len(),
            reference.map_or(0, |reference| reference.points)
        ),
        files: written,
    })
}

/// Estimates the trajectory from logs.
///
/// # Errors
/// Errors of the stage.
pub fn trajectory(
    project: &Project,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let names = ["trajectory.csv", "trajectory.html"];
    let job = Job::new(options, &project.inputs(), &names, progress)?;
    let project = &OpenProject::with_origin(project, progress);
    let poses = stages::poses(project, progress)?.poses;
    let (seconds, (first_s, last_s)) = (poses.seconds, poses.trajectory.span_s());
    let drive = drives::drive(&drives::name_of(project), poses, Agreements::default());
    let written = write::trajectory(project, &drive, &job);
    let command = format!("boresight trajectory {}", project.path.display());
    let mut content = page::trajectory(project, std::slice::from_ref(&drive), command)?;
    let results = Results {
        drives: std::slice::from_ref(&drive),
        ..Results::default()
    };
    let verdicts = judgement::judge(&results, &project.acceptance);
    // All other verdicts appear in the section of the trajectory.
    let marked = verdicts
        .iter()
        .filter(|verdict| verdict.severity.is_marked());
    content.verdicts = marked.cloned().collect();
    let written = written.and(job.write("trajectory.html", report::render(&content)));
    written.and(job.commit().map(drop))?;
    let solution = drive.solution.as_ref();
    let mut result = json!({
        "trajectory": solution.map(|solution| result::trajectory(solution, &drive.poses)),
        "rejected_rows": drive.rejected_rows,
        "poses": drive.poses.len(),
        "span_s": [first_s, last_s],
        "stages": { "estimate": { "seconds": seconds } },
        "peak_memory_bytes": peak_memory_bytes(),
    });
    result::judge(&mut result, &verdicts);
    Ok(Outcome {
        result,
        summary: summary::trajectory(solution, &drive.poses),
        files: files_in(&options.out, names),
        verdicts: Some(verdicts),
    })
}

/// Calibrates the mountings as [`run`] does, but writes no clouds.
///
/// # Errors
/// Errors of the stages.
pub fn calibrate(project: &Project, options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let names = [&calibrated::FILES[..], &["calibration.html"]].concat();
    let mut job = Job::new(options, &project.inputs(), &names, progress)?;
    let project = &OpenProject::with_origin(project, progress);
    // The stages are not kept, so their keys need no file contents.
    let keys = Keys::new(project, &Inputs::default())?;
    let calibration_drive = CalibrationDrive::new(project);
    let before = calibrated::before_scans(&calibration_drive, &keys, &mut job)?;
    let calibrated = Calibrated::run(project, &calibration_drive, &before, &keys, &mut job)?;
    let poses = calibrated.adjusted_poses(&before.poses)?;
    let drive = drives::drive(&drives::name_of(project), poses, Agreements::default());
    let extras = Extras {
        command: format!("boresight calibrate {}", project.path.display()),
        ..Extras::default()
    };
    let mountings = calibrated.mountings(None);
    let findings = calibrated.findings(mountings, vec![drive], &mut job);
    let written = calibrated::write(project, &findings, &job);
    let content = page::content(project, &findings, &extras);
    let page = content.and_then(|page| job.write("calibration.html", report::render(&page)));
    let written = written.and(page).and(job.commit().map(drop));
    if let Err(error) = written {
        return Err(unfinished::shown(&findings, error, progress));
    }
    Ok(Outcome {
        result: result::document(&findings),
        summary: summary::calibration(&findings),
        files: files_in(&options.out, names),
        verdicts: Some(findings.verdicts),
    })
}

/// Runs all stages and writes the report.
///
/// # Errors
/// Errors of the stages.
pub fn run(project: &Project, options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let command = format!("boresight run {}", project.path.display());
    let extras = Extras {
        command,
        without_reference: true,
        ..Extras::default()
    };
    let findings = analyse(project, options, &extras, progress)?;
    Ok(outcome(&findings, &options.out))
}

/// The outcome of a whole run.
fn outcome(findings: &Findings, out: &Path) -> Outcome {
    let names = ["result.json", "calibration.toml", "trajectory.csv"].map(str::to_owned);
    let scanners = findings.calibrations.result.mountings.iter();
    let clouds = scanners.map(|mounting| clouds::name(&mounting.name));
    Outcome {
        result: result::document(findings),
        summary: summary::run(findings, &out.join("report.html").display().to_string()),
        files: files_in(out, names.into_iter().chain(clouds)),
        verdicts: Some(findings.verdicts.clone()),
    }
}

/// Paths of these names in the folder `out`.
pub(super) fn files_in(
    out: &Path,
    names: impl IntoIterator<Item = impl AsRef<Path>>,
) -> Vec<PathBuf> {
    names.into_iter().map(|name| out.join(name)).collect()
}
