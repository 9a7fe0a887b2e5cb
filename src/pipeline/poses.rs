//! The stage that makes the poses: it corrects and adjusts logs and tests the project's constants, or reads a file.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::logs::DriveLogs;
use super::one_body;
use super::open_project::OpenProject;
use super::profiles::warn_of_remarks;
use super::recorded;
use crate::error::Result;
use crate::format;
use crate::geometry::Vec3;
use crate::judgement;
use crate::preflight::{
    Contradiction, Log, LogFindings, late_logs, logs as contradictions, position_noise, unmeasured,
};
use crate::progress::Progress;
use crate::project::{Logs, Motion, PosesFile};
use crate::sensor::{PoseRecord, PoseSigma, RejectedRow};
use crate::trajectory::{
    Estimate, PosteriorCovariance, Solution, Tested, Trajectory, estimate, estimate_tested,
};

/// Longest time between nodes if the joint adjustment corrects the poses, seconds, also where the prism has no fixes.
const JOINT_STEP_S: f64 = 0.25;

/// Warning for poses without standard deviations.
const POSES_WITHOUT_SIGMA: &str = "the poses have no standard deviations: those of the mounting assume \
     exact poses and are too small; give sigma_position_m and sigma_rotation_deg in [trajectory]";

/// The trajectory of the body, estimated or read.
#[derive(Debug)]
pub struct EstimatedPoses {
    /// The part that is kept for later runs.
    pub poses: Poses,
    /// Joint covariance of the poses; `None` if they came from a file.
    pub covariance: Option<PosteriorCovariance>,
}

/// The trajectory of the body with the results of its estimation.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Poses {
    /// The poses, the project's origin subtracted.
    pub trajectory: Trajectory,
    /// Result of the adjustment; `None` if the poses came from a file.
    pub solution: Option<Solution>,
    /// Rows of the logs without a measurement.
    pub rejected_rows: Vec<RejectedRow>,
    /// Wall time of the estimation without reading; `None` if the poses came from a file.
    pub seconds: Option<f64>,
    /// What the logs contradict.
    pub log_findings: LogFindings,
}

impl EstimatedPoses {
    /// Poses without a joint covariance.
    pub fn from_file(trajectory: Trajectory) -> Self {
        Self {
            poses: Poses {
                trajectory,
                solution: None,
                rejected_rows: Vec::new(),
                seconds: None,
                log_findings: LogFindings::default(),
            },
            covariance: None,
        }
    }

    /// The poses.
    pub fn trajectory(&self) -> &Trajectory {
        &self.poses.trajectory
    }
}

/// Estimates the trajectory from the logs, or reads it.
///
/// # Errors
/// Errors of the readers and the adjustment.
pub fn poses(project: &OpenProject, progress: &dyn Progress) -> Result<EstimatedPoses> {
    match &project.motion {
        Motion::Logs(logs) => poses_from_logs(project, logs, progress),
        Motion::Poses(file) => {
            let nodes = read_poses(project, file, progress)?;
            if nodes.iter().all(|node| node.sigma.is_none()) {
                progress.warn(POSES_WITHOUT_SIGMA);
            }
            let trajectory = Trajectory::new(nodes)?.with_limits(project.limits)?;
            Ok(EstimatedPoses::from_file(trajectory))
        }
    }
}

/// Corrects faults that the raw logs show beyond doubt; returns these and other contradictions.
///
/// # Errors
/// See [`crate::preflight::logs`].
fn correct_faults(logs: &mut DriveLogs, files: &Logs) -> Result<Vec<Contradiction>> {
    let file = |log: Log| {
        let path = match log {
            Log::Imu => &files.imu.path,
            Log::Position(i) => &files.positions[i].path,
            Log::Heading => files
                .heading
                .as_ref()
                .map_or(&files.imu.path, |log| &log.path),
        };
        path.file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    let mut found = unmeasured(&logs.motion(), &logs.settings, &file);
    for late in late_logs(&logs.motion(), &logs.settings) {
        let on_time = |time_s: &mut f64| *time_s -= late.late_s;
        match late.log {
            Log::Imu => logs.imu.iter_mut().for_each(|s| on_time(&mut s.time_s)),
            Log::Position(i) => {
                let fixes = logs.positions[i].iter_mut();
                fixes.for_each(|fix| on_time(&mut fix.time_s));
            }
            Log::Heading => logs.heading.iter_mut().for_each(|h| on_time(&mut h.time_s)),
        }
        found.push(Contradiction::Late(late));
    }
    found.extend(contradictions(&logs.motion(), &logs.settings)?);
    let is_opposite =
        |found: &Contradiction| matches!(found, Contradiction::OppositeHeadings { .. });
    if found.iter().any(is_opposite) {
        logs.heading.clear();
    }
    for (fixes, position) in logs.positions.iter().zip(&mut logs.settings.positions) {
        if let Some(noise) = position_noise(fixes, position) {
            position.sigma_m = noise.sigma_m;
            found.push(Contradiction::Noise(noise));
        }
    }
    Ok(found)
}

fn poses_from_logs(
    project: &OpenProject,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<EstimatedPoses> {
    let (files, estimates_doubted) = (logs, logs.estimates_doubted);
    let mut logs = DriveLogs::read(project, files, progress)?;
    if project.is_joint && !project.scanners.is_empty() {
        logs.settings.max_step_s = JOINT_STEP_S;
    }
    let mut findings = LogFindings {
        contradictions: correct_faults(&mut logs, files)?,
        ..LogFindings::default()
    };
    for found in &findings.contradictions {
        progress.verdict(&judgement::contradiction(found).text);
    }
    findings.clocks = recorded::clocks(project)?;
    let on_clocks = findings.clocks.iter().flat_map(judgement::recording);
    for verdict in on_clocks.filter(|v| v.severity.is_marked()) {
        progress.verdict(&verdict.text);
    }
    let begun = Instant::now();
    let is_sound = !findings.spoil_poses();
    let Tested {
        estimate,
        doubts,
        steps,
    } = if is_sound {
        estimate_tested(&logs.motion(), &logs.settings, estimates_doubted, progress)?
    } else {
        Tested {
            estimate: estimate(&logs.motion(), &logs.settings, progress)?,
            doubts: Vec::new(),
            steps: Vec::new(),
        }
    };
    for step in &steps {
        progress.verdict(&judgement::position_step(step).text);
    }
    for doubt in &doubts {
        progress.verdict(&judgement::doubt(doubt).text);
    }
    let seconds = begun.elapsed().as_secs_f64();
    let Estimate {
        trajectory,
        solution,
        covariance,
    } = estimate;
    let poses = Poses {
        trajectory: trajectory.with_limits(project.limits)?,
        solution: Some(solution),
        rejected_rows: logs.rejected,
        seconds: Some(seconds),
        log_findings: LogFindings {
            steps,
            doubts,
            ..findings
        },
    };
    Ok(EstimatedPoses {
        poses,
        covariance: Some(covariance),
    })
}

/// The poses that follow from the logs within seconds: at the position fixes, and without estimating or testing constants;
/// or the poses of a file.
///
/// # Errors
/// See [`poses`].
pub fn rough_poses(project: &OpenProject, progress: &dyn Progress) -> Result<Poses> {
    let Motion::Logs(files) = &project.motion else {
        return Ok(poses(project, progress)?.poses);
    };
    let mut logs = DriveLogs::read(project, files, progress)?;
    logs.settings.nodes = Default::default();
    logs.settings.estimate.clear();
    let contradictions = correct_faults(&mut logs, files)?;
    let estimate = estimate(&logs.motion(), &logs.settings, progress)?;
    Ok(Poses {
        trajectory: estimate.trajectory.with_limits(project.limits)?,
        solution: Some(estimate.solution),
        rejected_rows: logs.rejected,
        seconds: None,
        log_findings: LogFindings {
            contradictions,
            ..LogFindings::default()
        },
    })
}

/// What the raw logs of a project contradict, without an adjustment; `None` if the project has poses.
///
/// # Errors
/// Errors of the readers; see [`crate::preflight::logs`].
pub fn preflight(project: &OpenProject, progress: &dyn Progress) -> Result<Option<LogFindings>> {
    match &project.motion {
        Motion::Logs(files) => {
            let mut logs = DriveLogs::read(project, files, progress)?;
            Ok(Some(LogFindings {
                contradictions: correct_faults(&mut logs, files)?,
                clocks: recorded::clocks(project)?,
                ..LogFindings::default()
            }))
        }
        Motion::Poses(_) => Ok(None),
    }
}

fn read_poses(
    project: &OpenProject,
    file: &PosesFile,
    progress: &dyn Progress,
) -> Result<Vec<PoseRecord>> {
    let mut files = Vec::new();
    for path in file.paths() {
        let crs = project.crs.as_ref();
        let input = project.input(path);
        let poses = format::read_projected_trajectory(&input, project.axes, crs)?;
        files.push((path.as_path(), poses));
        warn_of_remarks(&path.display().to_string(), &[input], progress);
    }
    one_body::check(&files)?;
    let mut nodes: Vec<PoseRecord> = files.into_iter().flat_map(|(_, poses)| poses).collect();
    // The sort is stable: if files have poses at the same time, the pose of the first file remains.
    nodes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    nodes.dedup_by(|later, earlier| later.time_s == earlier.time_s);
    for node in &mut nodes {
        node.time_s += file.time_offset_s;
        node.world_from_body.translation_m -= project.origin_m();
        if node.sigma.is_none()
            && let (Some(position), Some(rotation)) =
                (file.sigma_position_m, file.sigma_rotation_rad)
        {
            node.sigma = Some(PoseSigma {
                position_m: Vec3::repeat(position),
                rotation_rad: Vec3::repeat(rotation),
            });
        }
    }
    Ok(nodes)
}
