//! Agreement of the clouds of the calibration drive and of the evaluation drives.

use std::path::Path;

use super::clouds::{self, KeptPoints, Mounted};
use super::job::Job;
use super::joint;
use super::stages::{self, Poses};
use crate::calibration::{Calibration, Method};
use crate::comparison::{Agreements, MountingKind, agreements};
use crate::error::Result;
use crate::geometry::{Bending, BodyFromScanner, Vec3};
use crate::joint::{Joint, contradictions};
use crate::progress::Progress;
use crate::project::{OtherDrive, Project};
use crate::report::content::Drive;
use crate::trajectory::Trajectory;

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

/// The poses with which a drive's points are placed in the end.
pub struct Adjusted {
    /// From the joint adjustment, or the drive's own.
    pub trajectory: Trajectory,
    /// How the mountings move on it; empty where they are rigid.
    pub bending: Vec<Bending>,
}

impl Adjusted {
    /// The poses of a project's own drive, from an adjustment if there is one.
    ///
    /// # Errors
    /// See [`Trajectory::with_limits`].
    pub fn new(project: &Project, poses: &Poses, joint: Option<&Joint>) -> Result<Self> {
        let found = joint.and_then(|joint| joint.drives.first());
        let trajectory = match found {
            Some(drive) => drive.trajectory.clone().with_limits(project.limits)?,
            None => poses.trajectory.clone(),
        };
        let bending = found.into_iter().flat_map(|drive| &drive.bending);
        Ok(Self {
            trajectory,
            bending: bending.map(|moved| moved.offsets.clone()).collect(),
        })
    }
}

/// Compares the kept points of the project's own drive, placed with each of the mountings, and then
/// those of its evaluation drives.
///
/// # Errors
/// Invalid settings of the comparison; errors of the stages on an evaluation drive.
pub fn compare(
    project: &Project,
    (poses, adjusted): (Poses, Adjusted),
    reference: &[Vec3],
    (mountings, calibration): (&Mountings, &Calibration),
    kept: KeptPoints,
    job: &mut Job<'_>,
) -> Result<Vec<Drive>> {
    let own = job.timed("compare", |progress| {
        let name = name_of(project);
        let poses = (poses, &adjusted.trajectory, adjusted.bending.as_slice());
        compared(&name, project, poses, reference, mountings, &kept, progress)
    })?;
    drop(kept);
    let mut drives = vec![own];
    for OtherDrive {
        name,
        project: path,
    } in &project.evaluations
    {
        let mut other = stages::aligned(project, Project::read(path)?)?;
        for (scanner, own) in other.scanners.iter_mut().zip(&project.scanners) {
            scanner.compliance = own.compliance;
        }
        let drive = job.shown(&format!("evaluate {name}"), |progress| {
            let poses = stages::poses(&other, progress)?;
            let kept = clouds::stream(&other, &poses.trajectory, None, progress)?;
            let adjusted = adjusted_alone((name, &other), &poses, calibration, progress)?;
            let (trajectory, bending) = adjusted.unwrap_or_else(|| {
                let bending = clouds::bending(&other, &poses.trajectory);
                (poses.trajectory.clone(), bending)
            });
            let poses = (poses, &trajectory, bending.as_slice());
            compared(name, &other, poses, reference, mountings, &kept, progress)
        });
        drives.push(drive?);
    }
    Ok(drives)
}

/// The poses of an evaluation drive, and how its mountings move, adjusted with its own scans and without the
/// reference by the mountings of a joint adjustment; `None` after two steps, and where it cannot be adjusted
/// or is contradicted.
fn adjusted_alone(
    (name, project): (&str, &Project),
    poses: &Poses,
    calibration: &Calibration,
    progress: &dyn Progress,
) -> Result<Option<(Trajectory, Vec<Bending>)>> {
    let (Method::Joint, Some(covariance)) = (calibration.method, &calibration.covariance) else {
        return Ok(None);
    };
    let calibrated = stages::with_mountings(project, &calibration.poses());
    let samples = stages::samples(&calibrated, &poses.trajectory, progress)?;
    let drive = joint::Drive {
        name,
        project: &calibrated,
        poses,
        samples: &samples,
    };
    let mountings = calibration.mountings.clone();
    let adjusted = joint::with_known_mountings(&drive, mountings, covariance, progress);
    let keeps =
        |reason: &str| progress.warn(&format!("drive `{name}` keeps its own poses: {reason}"));
    match adjusted {
        Ok(found) => {
            if let Some(reason) = contradictions(&found).first() {
                keeps(reason);
                return Ok(None);
            }
            let drive = found.drives.into_iter().next();
            let placed = drive.map(|drive| {
                let bending = drive.bending.into_iter().map(|moved| moved.offsets);
                Ok((
                    drive.trajectory.with_limits(project.limits)?,
                    bending.collect(),
                ))
            });
            placed.transpose()
        }
        Err(error) => {
            let reason = joint::reason(error)?;
            keeps(&reason);
            Ok(None)
        }
    }
}

fn compared(
    name: &str,
    project: &Project,
    (poses, trajectory, bending): (Poses, &Trajectory, &[Bending]),
    reference: &[Vec3],
    mountings: &Mountings,
    kept: &KeptPoints,
    progress: &dyn Progress,
) -> Result<Drive> {
    let place = |(kind, mountings): &(MountingKind, Vec<BodyFromScanner>)| {
        let own = [MountingKind::Initial, MountingKind::TwoStep].contains(kind);
        let trajectory = if own { &poses.trajectory } else { trajectory };
        let mounted = Mounted {
            mountings,
            bending: if *kind == MountingKind::Final {
                bending
            } else {
                &[]
            },
        };
        (*kind, clouds::place(project, trajectory, mounted, kept))
    };
    let placed: Vec<_> = mountings.iter().map(place).collect();
    let scanners: Vec<&str> = project.scanners.iter().map(|s| s.name.as_str()).collect();
    let settings = &project.comparison;
    let agreements = agreements(name, &scanners, reference, &placed, settings, progress)?;
    let placed = Poses {
        trajectory: trajectory.clone(),
        ..poses
    };
    Ok(drive(name, placed, agreements))
}

/// The results of a drive.
pub fn drive(name: &str, poses: Poses, agreements: Agreements) -> Drive {
    Drive {
        name: name.into(),
        poses: poses.trajectory.poses().to_vec(),
        solution: poses.solution,
        rejected_rows: poses.rejected_rows,
        agreements,
        preflight: poses.preflight,
        doubts: poses.doubts,
    }
}
