//! The stages, as functions of the project and of the results of earlier stages.

use std::path::Path;

use super::open_project::OpenProject;
pub use super::poses::{EstimatedPoses, Poses, poses, preflight, rough_poses};
use super::profiles::{all_profile_inputs, open_profiles, warn_of_remarks};
use super::rig::Rig;
use crate::calibration::{
    Calibration, CalibrationSettings, Input, Mounting, ScannerSample, calibrate, sample_profiles,
};
use crate::error::{Error, Problem, Result};
use crate::format;
use crate::geometry::Vec3;
use crate::georeference::ExcludedPoints;
use crate::progress::Progress;
use crate::project::{Motion, Project};
use crate::sensor::PoseRecord;
use crate::tiles::CloudSource;
use crate::trajectory::{PositionSettings, Solution, Trajectory};

/// Checks that no two scanners have a file in common.
///
/// # Errors
/// Two scanners with a file in common.
fn check_no_shared_files(project: &Project) -> Result<()> {
    for (index, scanner) in project.scanners.iter().enumerate() {
        for other in &project.scanners[..index] {
            let mut files = other.profiles.iter();
            if let Some(file) = files.find(|file| scanner.profiles.contains(file)) {
                let (file, a, b) = (file.display(), &other.name, &scanner.name);
                return Err(Error::data(
                    format!("{file}: the profiles of both scanner `{a}` and scanner `{b}`"),
                    "give each scanner its own file",
                ));
            }
        }
    }
    Ok(())
}

/// Reads and thins the profiles of every scanner.
///
/// # Errors
/// Scanners with a file in common; see [`sample_profiles`].
pub fn samples(
    project: &OpenProject,
    rig: &Rig,
    trajectory: &Trajectory,
    progress: &dyn Progress,
) -> Result<Vec<ScannerSample>> {
    check_no_shared_files(project)?;
    let inputs = all_profile_inputs(project);
    let all = project.scanners.iter().zip(&inputs);
    let all = all
        .map(|(scanner, inputs)| open_profiles(scanner, inputs, trajectory))
        .collect::<Result<Vec<_>>>()?;
    let bytes = all
        .iter()
        .flatten()
        .map(|reader| reader.bytes_total())
        .sum();
    let stage = progress.stage("reading profiles", bytes);
    let settings = &rig.settings(project);
    let scanners = rig.mountings.iter().zip(&rig.time_offsets_s);
    let jobs: Vec<_> = scanners.zip(all).collect();
    let samples = in_parallel(jobs, |((mounting, offset_s), readers)| {
        sample_profiles(mounting, readers, *offset_s, trajectory, settings, progress)
    })
    .into_iter()
    .collect::<Result<Vec<ScannerSample>>>()?;
    drop(stage);
    for ((scanner, sample), inputs) in project.scanners.iter().zip(&samples).zip(&inputs) {
        warn_of_remarks(&scanner.name, inputs, progress);
        progress.say(&format!(
            "scanner `{}`: {} points read, {} kept, {} outside the trajectory",
            scanner.name,
            sample.read,
            sample.points.len(),
            sample.outside
        ));
        warn_of_missing(
            &scanner.name,
            sample.outside,
            sample.read,
            &sample.excluded,
            progress,
        );
    }
    Ok(samples)
}

/// Warns about points without a pose, or with a pose beyond the project's limits.
pub fn warn_of_missing(
    scanner: &str,
    outside: u64,
    read: u64,
    excluded: &ExcludedPoints,
    progress: &dyn Progress,
) {
    if outside > 0 {
        progress.warn(&format!(
            "{:.1} % of the points of scanner `{scanner}` lie outside the trajectory and were left out",
            100.0 * outside as f64 / read as f64,
        ));
    }
    if let Some(warning) = exclusion_warning(scanner, read, excluded) {
        progress.warn(&warning);
    }
}

/// Warning about the excluded points of `scanner`, which has `read` points; `None` without any.
fn exclusion_warning(scanner: &str, read: u64, excluded: &ExcludedPoints) -> Option<String> {
    (excluded.points > 0).then(|| {
        format!(
            "{:.1} % of the points of scanner `{scanner}` were left out: {excluded}",
            100.0 * excluded.points as f64 / read as f64,
        )
    })
}

/// Checks that the reference, if there is one, overlaps the scanners' points.
///
/// # Errors
/// The bounding boxes of both are more than a metre apart; the margin allows for a rough mounting.
pub fn check_reference(
    project: &OpenProject,
    rig: &Rig,
    samples: &[ScannerSample],
    reference: &[Vec3],
) -> Result<()> {
    const MARGIN_M: f64 = 1.0;
    let scanned = rig
        .mountings
        .iter()
        .zip(samples)
        .flat_map(|(mounting, sample)| sample.placed(&mounting.body_from_scanner));
    let (Some(scanned), Some(reference)) = (box_of(scanned), box_of(reference.iter().copied()))
    else {
        return Ok(());
    };
    let gap_m = (0..3)
        .map(|axis| (reference.0[axis] - scanned.1[axis]).max(scanned.0[axis] - reference.1[axis]))
        .fold(f64::NEG_INFINITY, f64::max);
    if gap_m < MARGIN_M {
        return Ok(());
    }
    let text = |(low, high): (Vec3, Vec3)| {
        let (low, high) = (low + project.origin_m(), high + project.origin_m());
        format!(
            "east {:.1} to {:.1}, north {:.1} to {:.1}, up {:.1} to {:.1} m",
            low.x, high.x, low.y, high.y, low.z, high.z
        )
    };
    let file = project.reference.as_ref().map_or_else(
        || "the reference".to_owned(),
        |file| file.path.display().to_string(),
    );
    Err(Error::of(
        Problem::NoOverlap,
        format!(
            "{file}: the reference ({}) and the scanners' points ({}) do not overlap: the gap \
             is {gap_m:.1} m",
            text(reference),
            text(scanned)
        ),
        "check that the reference and the prism log are in the same world coordinates; or leave \
         [reference] out",
    ))
}

/// Bounding box: the smallest and the largest coordinates; `None` without points.
pub fn box_of(points: impl Iterator<Item = Vec3>) -> Option<(Vec3, Vec3)> {
    points.fold(None, |bounds, point| {
        let (low, high) = bounds.unwrap_or((point, point));
        Some((low.inf(&point), high.sup(&point)))
    })
}

/// Runs `work` on all jobs in parallel; returns the results in the order of the jobs.
pub fn in_parallel<J: Send, R: Send>(jobs: Vec<J>, work: impl Fn(J) -> R + Sync + Send) -> Vec<R> {
    use rayon::prelude::*;
    jobs.into_par_iter().map(work).collect()
}

/// Reads the reference, with the project's origin subtracted; empty if the project has none.
///
/// # Errors
/// Errors of the reader; a reference without points.
pub fn reference(project: &OpenProject, progress: &dyn Progress) -> Result<Vec<Vec3>> {
    let Some(reference) = &project.reference else {
        return Ok(Vec::new());
    };
    let stage = progress.stage("reading the reference", 0);
    let cloud = CloudSource::open(project.input(&reference.path), progress)?;
    let mut points = cloud.points(progress)?.into_owned();
    drop(stage);
    if points.is_empty() {
        return Err(Error::of(
            Problem::TooFew,
            format!("{}: the reference has no points", reference.path.display()),
            "check that the file is the right one and not empty",
        ));
    }
    let origin_m = project.origin_m();
    points.iter_mut().for_each(|point| *point -= origin_m);
    Ok(points)
}

/// Calibrates the project's scanners from these start values of their mountings.
///
/// # Errors
/// All parameters are fixed; see [`calibrate`].
pub fn calibration(
    project: &Project,
    mountings: &[Mounting],
    settings: &CalibrationSettings,
    EstimatedPoses { poses, covariance }: &EstimatedPoses,
    samples: &[ScannerSample],
    reference: &[Vec3],
    progress: &dyn Progress,
) -> Result<Calibration> {
    if mountings.iter().all(|mounting| mounting.fixed == [true; 6]) {
        return Err(Error::data(
            format!(
                "{}: all parameters of all scanners are fixed: there is nothing to calibrate",
                project.path.display()
            ),
            "remove some parameters from `fixed`, or use `boresight georeference`",
        ));
    }
    let input = Input::new(mountings.to_vec(), samples, &poses.trajectory);
    let input = input.with_reference(reference);
    let input = input.with_pose_correlation(project.joint.correlation_s);
    let input = match covariance {
        Some(covariance) => input.with_pose_covariance(covariance),
        None => input,
    };
    calibrate(&input, settings, progress)
}

/// Standard deviation of the body's origin along each axis, metres: that of the lever arm of the best
/// position sensor whose lever arm is not estimated, or 0 without one.
pub fn origin_sigma_m(project: &Project, solution: Option<&Solution>) -> f64 {
    let (Motion::Logs(logs), Some(solution)) = (&project.motion, solution) else {
        return 0.0;
    };
    let is_held = |position: &&PositionSettings| {
        let lever_arm = format!("{}.lever_arm", position.name);
        let mut constants = solution.constants.iter();
        !constants.any(|constant| constant.name.starts_with(&lever_arm))
    };
    let positions = logs.settings.positions.iter().filter(is_held);
    let best = positions.min_by(|a, b| a.sigma_m.norm().total_cmp(&b.sigma_m.norm()));
    best.map_or(0.0, |best| best.sigma_lever_arm_m)
}

/// Writes poses with the project's origin added back.
///
/// # Errors
/// The file cannot be written.
pub fn write_trajectory(path: &Path, poses: &[PoseRecord], origin_m: &Vec3) -> Result<()> {
    let mut poses = poses.to_vec();
    poses
        .iter_mut()
        .for_each(|pose| pose.world_from_body.translation_m += origin_m);
    format::write_trajectory(path, &poses)
}
