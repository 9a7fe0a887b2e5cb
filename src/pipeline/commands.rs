//! What each command of the command line does, and what it answers.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::{Extras, Findings, Truth, analyse, clouds, evaluate, page, result, stages};
use crate::calibration::Calibration;
use crate::comparison::{Statistics, core_points, m3c2};
use crate::error::{Error, Result};
use crate::format;
use crate::geometry::Vec3;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::output::{Staging, write_whole};
use crate::progress::Progress;
use crate::project::{ComparisonSettings, Project};
use crate::report::content::MountingKind;
use crate::simulation::{self, Scenario};
use crate::trajectory::Trajectory;

/// Where results go and what chance starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The folder of the results; created where it is missing.
    pub out: PathBuf,
    /// Seed of every random draw.
    pub seed: u64,
}

/// What a command found.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result as one document, as in `result.json`.
    pub result: Value,
    /// The same for people: a few lines with units.
    pub summary: String,
    /// What was written, most important first.
    pub files: Vec<PathBuf>,
}

/// Scales at which the demo runs the paper's own method beside ours: the finer ones take minutes.
const DEMO_PAPER_VOXELS_M: [f64; 2] = [0.05, 0.04];

/// Simulates the paper's drives, runs everything on them and writes the report.
///
/// # Errors
/// Whatever a stage refuses.
pub fn demo(options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let scenario = Scenario {
        seed: options.seed,
        ..Scenario::demo()
    };
    let data = options.out.join("data");
    let files = simulation::simulate(&scenario, &data, progress)?;
    let project = Project::read(&files.drives[0].project)?;
    let extras = Extras {
        command: "boresight demo".into(),
        seed: Some(options.seed),
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
    let is_file = Path::new(scenario).exists();
    let mut scenario = Scenario::load(scenario)?;
    if !is_file {
        scenario.seed = options.seed;
    }
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
    let poses = stages::poses(project, progress)?;
    let staging = Staging::new(&options.out)?;
    super::write_trajectory(
        &staging.path("trajectory.csv"),
        &poses.trajectory,
        &project.origin_m,
    )?;
    staging.commit()?;
    let nodes = poses.trajectory.nodes();
    let (first_s, last_s) = poses.trajectory.span_s();
    Ok(Outcome {
        result: json!({
            "trajectory": poses.solution,
            "poses": nodes.len(),
            "span_s": [first_s, last_s],
        }),
        summary: format!("{} poses over {:.1} s", nodes.len(), last_s - first_s),
        files: vec![options.out.join("trajectory.csv")],
    })
}

/// Trajectory and profiles to mountings.
///
/// # Errors
/// Whatever a stage refuses.
pub fn calibrate(project: &Project, options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    let reference = stages::reference(project, progress)?;
    let poses = stages::poses(project, progress)?;
    let samples = stages::samples(project, &poses.trajectory, progress)?;
    let settings = &project.calibration;
    let found = stages::calibration(project, settings, &poses, &samples, &reference, progress)?;
    let document = json!({
        "scanners": result::scanners(project, &found),
        "calibration": result::calibration(&found),
    });
    let staging = Staging::new(&options.out)?;
    let calibrated = stages::with_mountings(project, &found.poses());
    for (name, text) in [
        ("calibration.toml", calibrated.scanners_to_toml()?),
        ("result.json", format!("{document:#}\n")),
    ] {
        let path = staging.path(name);
        std::fs::write(&path, text).map_err(|error| Error::io(&path, error))?;
    }
    staging.commit()?;
    Ok(Outcome {
        result: document,
        summary: mountings_in_words(&found),
        files: vec![
            options.out.join("calibration.toml"),
            options.out.join("result.json"),
        ],
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
    let poses = stages::poses(project, progress)?;
    let mountings: Vec<_> = project
        .scanners
        .iter()
        .map(|s| s.body_from_scanner)
        .collect();
    let staging = Staging::new(&options.out)?;
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
        summary: format!("{} clouds", files.len()),
        files,
    })
}

/// M3C2 from `cloud` to `reference`.
///
/// # Errors
/// Clouds that cannot be read or do not meet.
pub fn compare(
    cloud: &Path,
    reference: &Path,
    settings: &ComparisonSettings,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let (compared, to) = (format::read_cloud(cloud)?, format::read_cloud(reference)?);
    let core = core_points(&to.points, settings);
    let found = m3c2(
        &to.points,
        &compared.points,
        &core,
        None,
        settings,
        &Vec3::z(),
        progress,
    )?;
    let statistics = Statistics::of(&found)?;
    let mut table = String::from(
        "east_m,north_m,up_m,distance_m,level_of_detection_m,normal_x,normal_y,normal_z\n",
    );
    for core in &found.core {
        let (p, n) = (&core.point, &core.normal);
        table.push_str(&format!(
            "{},{},{},{},{},{},{},{}\n",
            p.x, p.y, p.z, core.distance_m, core.level_of_detection_m, n.x, n.y, n.z
        ));
    }
    std::fs::create_dir_all(&options.out).map_err(|error| Error::io(&options.out, error))?;
    let path = options.out.join("m3c2.csv");
    write_whole(&path, table.as_bytes())?;
    let summary = format!(
        "RMSE {:.2} mm, mean {:.2} mm, standard deviation {:.2} mm, median {:.2} mm over {} of {} \
         core points",
        statistics.rmse_m * 1e3,
        statistics.mean_m * 1e3,
        statistics.std_m * 1e3,
        statistics.median_m * 1e3,
        statistics.n,
        statistics.core_points
    );
    Ok(Outcome {
        result: json!(statistics),
        summary,
        files: vec![path],
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
    let mut lines = vec![mountings_in_words(&findings.calibration)];
    for drive in &findings.drives {
        for found in drive
            .agreements
            .iter()
            .filter(|a| a.mounting == MountingKind::Final)
        {
            let before =
                evaluate::Drive::find(drive, found.scanner, found.against, MountingKind::Initial);
            let before = before.map_or(String::new(), |before| {
                format!(" (initially {:.1} mm)", before.statistics.rmse_m * 1e3)
            });
            lines.push(format!(
                "{}, {}: M3C2 RMSE {:.2} mm{before}",
                drive.name,
                found.pair(project),
                found.statistics.rmse_m * 1e3
            ));
        }
    }
    let names = [
        "report.html",
        "result.json",
        "calibration.toml",
        "trajectory.csv",
    ];
    let mut files: Vec<PathBuf> = names.iter().map(|name| out.join(name)).collect();
    files.extend(
        project
            .scanners
            .iter()
            .map(|s| out.join(clouds::file_name(&s.name))),
    );
    Outcome {
        result: result::document(project, findings),
        summary: lines.join("\n"),
        files,
    }
}

/// Mountings with sigmas, and what could not be found.
fn mountings_in_words(calibration: &Calibration) -> String {
    let mut lines = Vec::new();
    for (index, mounting) in calibration.mountings.iter().enumerate() {
        let pose = &mounting.body_from_scanner;
        let sigmas = calibration.sigmas(index, mounting.convention);
        let angles = euler_deg_from_rotation(mounting.convention, &pose.rotation);
        let shown = |value: f64, sigma: Option<f64>, digits: usize| match sigma {
            Some(sigma) => format!("{value:.digits$} ± {sigma:.digits$}"),
            None => format!("{value:.digits$} (held)"),
        };
        let metres: Vec<String> = (0..3)
            .map(|axis| shown(pose.translation.vector[axis], sigmas[axis], 4))
            .collect();
        let degrees: Vec<String> = (0..3)
            .map(|axis| shown(angles[axis], sigmas[3 + axis].map(f64::to_degrees), 3))
            .collect();
        lines.push(format!(
            "{}: t = ({}) m, angles ({:?}) = ({})°",
            mounting.name,
            metres.join(", "),
            mounting.convention,
            degrees.join(", ")
        ));
    }
    lines.extend(page::statements(calibration, ""));
    lines.join("\n")
}
