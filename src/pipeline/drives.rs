//! Agreement of the clouds of the calibration drive and of the evaluation drives.

use std::path::Path;

use super::clouds::{self, KeptPoints};
use super::job::Job;
use super::stages::{self, Poses};
use crate::comparison::{Agreements, MountingKind, agreements};
use crate::error::{Error, Result};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::progress::Progress;
use crate::project::{OtherDrive, Project};
use crate::report::content::Drive;

/// Mountings to compare, with their kinds.
pub type Mountings = [(MountingKind, Vec<BodyFromScanner>)];

/// The name of the project's own drive, which is that of its folder.
pub fn name_of(project: &Project) -> String {
    let folder = project.path.parent().and_then(Path::file_name);
    folder.map_or_else(
        || "drive".into(),
        |name| name.to_string_lossy().into_owned(),
    )
}

/// Compares the kept points of the project's own drive, placed with each of the mountings, and then
/// those of its evaluation drives.
///
/// # Errors
/// Invalid settings of the comparison; errors of the stages on an evaluation drive.
pub fn compare(
    project: &Project,
    poses: Poses,
    reference: &[Vec3],
    mountings: &Mountings,
    kept: KeptPoints,
    job: &mut Job<'_>,
) -> Result<Vec<Drive>> {
    let own = job.timed("compare", |progress| {
        let name = name_of(project);
        compared(&name, project, poses, reference, mountings, &kept, progress)
    })?;
    drop(kept);
    let mut drives = vec![own];
    for OtherDrive {
        name,
        project: path,
    } in &project.evaluations
    {
        let other = aligned(project, Project::read(path)?)?;
        let drive = job.shown(&format!("evaluate {name}"), |progress| {
            let poses = stages::poses(&other, progress)?;
            let kept = clouds::stream(&other, &poses.trajectory, None, progress)?;
            compared(name, &other, poses, reference, mountings, &kept, progress)
        });
        drives.push(drive?);
    }
    Ok(drives)
}

fn compared(
    name: &str,
    project: &Project,
    poses: Poses,
    reference: &[Vec3],
    mountings: &Mountings,
    kept: &KeptPoints,
    progress: &dyn Progress,
) -> Result<Drive> {
    let place =
        |mountings: &[BodyFromScanner]| clouds::place(project, &poses.trajectory, mountings, kept);
    let placed = mountings.iter();
    let placed: Vec<_> = placed
        .map(|(kind, mountings)| (*kind, place(mountings)))
        .collect();
    let scanners: Vec<&str> = project.scanners.iter().map(|s| s.name.as_str()).collect();
    let settings = &project.comparison;
    let agreements = agreements(name, &scanners, reference, &placed, settings, progress)?;
    Ok(drive(name, poses, agreements))
}

/// The results of a drive.
pub fn drive(name: &str, poses: Poses, agreements: Agreements) -> Drive {
    Drive {
        name: name.into(),
        poses: poses.trajectory.poses().to_vec(),
        solution: poses.solution,
        rejected_rows: poses.rejected_rows,
        agreements,
    }
}

/// The evaluation project with its scanners in the order of `project`, and with the same
/// comparison.
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
