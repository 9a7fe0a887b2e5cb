//! What a run will find, as far as it can be seen within seconds: counts, overlaps, and the verdicts on the logs and on
//! the first placement of the scans. Nothing is calibrated and nothing is written.

use std::sync::Mutex;

use serde::Serialize;

use super::open_project::OpenProject;
use super::rig::Rig;
use super::stages::{self, Poses};
use super::start;
use crate::calibration::ScannerSample;
use crate::diagnostics::PoseSigmas;
use crate::error::Result;
use crate::judgement;
use crate::progress::Progress;
use crate::project::Project;
use crate::trajectory::Trajectory;
use crate::verdict::Verdict;

/// What was found about the inputs of a run.
#[derive(Debug, Default, Serialize)]
pub struct Preview {
    /// The poses; `None` if a fault of the logs keeps them from meaning anything.
    pub trajectory: Option<PosesFound>,
    /// In the order of the project; empty without a trajectory.
    pub scanners: Vec<ScanFound>,
    /// Number of points of the reference.
    pub reference_points: usize,
    /// Warnings of the stages.
    pub warnings: Vec<String>,
    /// What was not looked at, with the reason.
    pub not_seen: Vec<String>,
    /// The verdicts.
    #[serde(skip)]
    pub verdicts: Vec<Verdict>,
}

/// Poses.
#[derive(Debug, Serialize)]
pub struct PosesFound {
    /// Number of poses.
    pub poses: usize,
    /// First and last time, seconds.
    pub span_s: [f64; 2],
}

/// The scans of a scanner.
#[derive(Debug, Serialize)]
pub struct ScanFound {
    /// Name of the scanner.
    pub name: String,
    /// Number of laser points.
    pub points: u64,
    /// Number of those at times without a pose.
    pub outside: u64,
    /// First and last time of the profiles on the trajectory, seconds; `None` without one.
    pub span_s: Option<[f64; 2]>,
}

/// Looks at the logs, the trajectory, the scans and their first placement, as a run does before it calibrates. An error
/// with which a run would end after it read the logs is a verdict.
///
/// # Errors
/// The logs cannot be read or are refused.
pub fn preview(project: &Project, progress: &dyn Progress) -> Result<Preview> {
    let warnings = Warnings {
        each: Mutex::default(),
        progress,
    };
    let project = &OpenProject::with_origin(project, &warnings);
    let logs = stages::preflight(project, &warnings)?;
    let mut preview = Preview {
        verdicts: logs.iter().flat_map(judgement::raw_logs).collect(),
        ..Preview::default()
    };
    let others = project.drives.iter().chain(&project.evaluations);
    let others = others.map(|drive| format!("drive {}: inspect its project", drive.name));
    preview.not_seen.extend(others);
    if logs.is_some_and(|logs| logs.spoil_poses()) {
        let reason = "the scans: the logs have a fault, and the poses would mean nothing";
        preview.not_seen.push(reason.to_owned());
    } else if let Err(error) = preview.poses_and_scans(project, &warnings) {
        preview.verdicts.push(judgement::would_end(&error));
    }
    preview.warnings = warnings.each.into_inner().unwrap_or_default();
    judgement::attention_first(&mut preview.verdicts);
    Ok(preview)
}

impl Preview {
    fn poses_and_scans(&mut self, project: &OpenProject, warnings: &Warnings<'_>) -> Result<()> {
        let Poses {
            trajectory,
            solution,
            ..
        } = stages::rough_poses(project, warnings)?;
        let (first_s, last_s) = trajectory.span_s();
        self.trajectory = Some(PosesFound {
            poses: trajectory.poses().len(),
            span_s: [first_s, last_s],
        });
        if let Some(solution) = &solution {
            let constants = "constants such as lever arms and latencies, which a run tests";
            self.not_seen.push(constants.to_owned());
            let verdicts =
                judgement::trajectory(solution, PoseSigmas::of(trajectory.poses()).as_ref());
            let marked = verdicts
                .into_iter()
                .filter(|verdict| verdict.severity.is_marked());
            self.verdicts.extend(marked);
        }
        if project.scanners.is_empty() {
            return Ok(());
        }
        self.scans(project, &trajectory, warnings)
    }

    fn scans(
        &mut self,
        project: &OpenProject,
        trajectory: &Trajectory,
        warnings: &Warnings<'_>,
    ) -> Result<()> {
        let reference = stages::reference(project, warnings)?;
        self.reference_points = reference.len();
        let rig = start::with_scales(project, &Rig::new(project), trajectory, warnings)?;
        let samples = stages::samples(project, &rig, trajectory, warnings)?;
        let named = project.scanners.iter().zip(&samples);
        self.scanners = named
            .map(|(scanner, sample)| scan_found(&scanner.name, sample))
            .collect();
        stages::check_reference(project, &rig, &samples, &reference)?;
        let start = start::start(project, &rig, trajectory, &samples, &reference, warnings);
        self.verdicts.extend(judgement::looked_at(&start.first));
        Ok(())
    }
}

/// Keeps the warnings of the stages, each once, and shows only how far the stages are.
struct Warnings<'a> {
    each: Mutex<Vec<String>>,
    progress: &'a dyn Progress,
}

impl Progress for Warnings<'_> {
    fn begin(&self, stage: &str, total: u64) {
        self.progress.begin(stage, total);
    }

    fn advance(&self, units: u64) {
        self.progress.advance(units);
    }

    fn end(&self) {
        self.progress.end();
    }

    fn say(&self, _message: &str) {}

    fn warn(&self, message: &str) {
        if let Ok(mut warnings) = self.each.lock()
            && !warnings.iter().any(|other| other == message)
        {
            warnings.push(message.to_owned());
        }
    }

    fn verdict(&self, _text: &str) {}

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

fn scan_found(name: &str, sample: &ScannerSample) -> ScanFound {
    let first = sample.profiles.first();
    let span_s = first.zip(sample.profiles.last());
    ScanFound {
        name: name.to_owned(),
        points: sample.read,
        outside: sample.outside,
        span_s: span_s.map(|(first, last)| [first.time_s, last.time_s]),
    }
}
