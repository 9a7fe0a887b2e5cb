//! What each command of the command line does, and what it answers.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::{Extras, Findings, Truth, analyse, clouds, page, result, stages, summary};
use crate::error::{Error, Result};
use crate::format;
use crate::output::Staging;
use crate::progress::Progress;
use crate::project::Project;
use crate::report;
use crate::simulation::{self, Scenario};
use crate::trajectory::Trajectory;

/// Where results go and what chance starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The folder of the results; created where it is missing.
    pub out: PathBuf,
    /// Seed of every random draw; `None` for that of the scenario.
    pub seed: Option<u64>,
}

/// What a command found.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result as one document, as in `result.json`.
    pub result: Value,
    /// The same for people: a few lines with units.
    pub summary: String,
    /// What was written beside the report, most important first.
    pub files: Vec<PathBuf>,
}

/// Scales at which the demo runs the paper's own method beside ours: the finer ones take minutes.
const DEMO_PAPER_VOXELS_M: [f64; 2] = [0.05, 0.04];

/// Simulates the paper's drives, runs everything on them and writes the report.
///
/// # Errors
/// Whatever a stage refuses.
pub fn demo(options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let mut scenario = Scenario::demo();
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    let data = options.out.join("data");
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
        paper_voxels_m: DEMO_PAPER_VOXELS_M.to_vec(),
    };
    let findings = analyse(&project, &options.out, &extras, progress)?;
    Ok(answer(&project, &findings, &options.out))
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

/// Writes the drives of `scenario` (a name or a file) as sensor files, with the truth beside them.
///
/// # Errors
/// A scenario that cannot be read, a folder that cannot be written.
pub fn simulate(scenario: &str, options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let mut scenario = Scenario::load(scenario)?;
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
    written.push(files.reference.clone());
    Ok(Outcome {
        result: json!({
            "drives": drives,
            "reference": { "file": files.reference, "points": files.reference_points },
        }),
        summary: format!(
            "{} drives, {points} laser points, {} reference points",
            drives.len(),
            files.reference_points
        ),
        files: written,
    })
}

/// Logs to trajectory.
///
/// # Errors
/// Whatever the stage refuses.
pub fn trajectory(
    project: &Project,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let staging = Staging::new(&options.out)?;
    let poses = stages::poses(project, progress)?;
    super::write_trajectory(
        &staging.path("trajectory.csv"),
        &poses.trajectory,
        &project.origin_m,
    )?;
    let command = format!("boresight trajectory {}", project.path.display());
    let page = report::render(&page::trajectory_content(project, &poses, &command));
    let path = staging.path("trajectory.html");
    std::fs::write(&path, page).map_err(|error| Error::io(&path, error))?;
    staging.commit()?;
    let nodes = poses.trajectory.nodes();
    let (first_s, last_s) = poses.trajectory.span_s();
    let solution = poses.solution.as_ref();
    Ok(Outcome {
        result: json!({
            "trajectory": solution.map(|solution| result::trajectory(solution, nodes)),
            "rejected_rows": poses.rejected_rows,
            "poses": nodes.len(),
            "span_s": [first_s, last_s],
            "stages": { "estimate": { "seconds": poses.seconds } },
            "peak_memory_bytes": super::peak_memory_bytes(),
        }),
        summary: summary::trajectory(solution, nodes),
        files: ["trajectory.csv", "trajectory.html"]
            .map(|name| options.out.join(name))
            .into(),
    })
}

/// Trajectory and profiles to mountings.
///
/// # Errors
/// Whatever a stage refuses.
pub fn calibrate(project: &Project, options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let staging = Staging::new(&options.out)?;
    let reference = stages::reference(project, progress)?;
    let poses = stages::poses(project, progress)?;
    let samples = stages::samples(project, &poses.trajectory, progress)?;
    stages::check_reference(project, &samples, &reference)?;
    let settings = &project.calibration;
    let found = stages::calibration(project, settings, &poses, &samples, &reference, progress)?;
    let document = json!({
        "scanners": result::scanners(&found),
        "calibration": result::calibration(&found),
    });
    let calibrated = stages::with_mountings(project, &found.poses()).scanners_to_toml()?;
    let path = staging.path("calibration.toml");
    std::fs::write(&path, calibrated).map_err(|error| Error::io(&path, error))?;
    staging.commit()?;
    Ok(Outcome {
        result: document,
        summary: summary::mountings(&found),
        files: vec![options.out.join("calibration.toml")],
    })
}

/// Trajectory, profiles and mountings to clouds.
///
/// # Errors
/// Whatever a stage refuses.
pub fn georeference(
    project: &Project,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let staging = Staging::new(&options.out)?;
    let poses = stages::poses(project, progress)?;
    let mountings: Vec<_> = project
        .scanners
        .iter()
        .map(|s| s.body_from_scanner)
        .collect();
    let path = |scanner: &crate::project::Scanner| staging.path(&clouds::file_name(&scanner.name));
    clouds::stream(
        project,
        &poses.trajectory,
        &mountings,
        Some(&path),
        progress,
    )?;
    staging.commit()?;
    let files: Vec<PathBuf> = project
        .scanners
        .iter()
        .map(|scanner| options.out.join(clouds::file_name(&scanner.name)))
        .collect();
    Ok(Outcome {
        result: json!({ "clouds": files }),
        summary: format!(
            "{} clouds, placed with the project's mountings",
            files.len()
        ),
        files,
    })
}

/// All of it, and the report.
///
/// # Errors
/// Whatever a stage refuses.
pub fn run(project: &Project, options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let command = format!("boresight run {}", project.path.display());
    let extras = Extras {
        command,
        ..Extras::default()
    };
    let findings = analyse(project, &options.out, &extras, progress)?;
    Ok(answer(project, &findings, &options.out))
}

/// What a whole run answers.
fn answer(project: &Project, findings: &Findings, out: &Path) -> Outcome {
    let report = out.join("report.html");
    let names = ["result.json", "calibration.toml", "trajectory.csv"];
    let mut files: Vec<PathBuf> = names.iter().map(|name| out.join(name)).collect();
    files.extend(
        project
            .scanners
            .iter()
            .map(|s| out.join(clouds::file_name(&s.name))),
    );
    Outcome {
        result: result::document(project, findings),
        summary: format!(
            "report: {}\n\n{}\n\n{}\n",
            report.display(),
            summary::mountings(&findings.calibration),
            summary::distances(project, &findings.drives)
        ),
        files,
    }
}
