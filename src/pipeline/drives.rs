//! Agreement of the clouds of the calibration drive and of the evaluation drives.

use std::path::Path;

use super::clouds::{self, KeptPoints, Mounted};
use super::job::Job;
use super::joint;
use super::keys::{Key, Keys};
use super::own::Own;
use super::scene;
use super::stages::{self, EstimatedPoses, Poses};
use crate::calibration::{Calibration, Method};
use crate::comparison::{Agreements, MountingKind, agreements};
use crate::error::Result;
use crate::geometry::{Bending, BodyFromScanner};
use crate::joint::{Joint, SurfelPlane, contradictions};
use crate::progress::Progress;
use crate::project::{OtherDrive, Project};
use crate::report::scene::{Scene, View};
use crate::results::Drive;
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

/// The final poses with which a drive's points are placed.
pub struct Adjusted {
    /// From the joint adjustment, or the drive's own.
    pub trajectory: Trajectory,
    /// The motion of the mountings along it; empty if they are rigid.
    pub bending: Vec<Bending>,
    /// The surface that an adjustment estimated.
    pub planes: Vec<SurfelPlane>,
}

impl Adjusted {
    /// The poses of a project's own drive, from an adjustment if there is one.
    ///
    /// # Errors
    /// See [`Trajectory::with_limits`].
    pub fn new(project: &Project, poses: &Poses, joint: Option<&Joint>) -> Result<Self> {
        let adjusted = joint.and_then(|joint| joint.drives.first());
        let trajectory = match adjusted {
            Some(drive) => drive.trajectory.clone().with_limits(project.limits)?,
            None => poses.trajectory.clone(),
        };
        let bending = adjusted.into_iter().flat_map(|drive| &drive.bending);
        Ok(Self {
            trajectory,
            bending: bending.map(|moved| moved.offsets.clone()).collect(),
            planes: joint.map_or_else(Vec::new, |joint| joint.planes.clone()),
        })
    }
}

/// A drive, and its clouds for the viewer.
pub type Shown = (Drive, Option<Scene>);

/// The data with which the drives of a project are compared.
pub struct Compared<'a> {
    /// The project.
    pub project: &'a Project,
    /// The mountings with which points are placed.
    pub mountings: &'a Mountings,
    /// The calibration.
    pub calibration: &'a Calibration,
    /// The keys of the stages.
    pub keys: &'a Keys,
}

impl Compared<'_> {
    /// Compares the kept points of the project's own drive, placed with each of the mountings, and then those of its
    /// evaluation drives. Points that are not kept yet are read.
    ///
    /// # Errors
    /// Invalid settings of the comparison; errors of the readers and of the stages on an evaluation drive.
    pub fn all(
        &self,
        (poses, adjusted, kept): (Poses, Adjusted, Option<KeptPoints>),
        own: &Own<'_>,
        job: &mut Job<'_>,
    ) -> Result<Vec<Shown>> {
        let project = self.project;
        let key = self.keyed(self.keys.joint.clone());
        let first = job.once("compare", &key, |progress| {
            let kept = match kept {
                Some(kept) => kept,
                None => clouds::stream(project, &adjusted.trajectory, None, progress)?,
            };
            let placed = (poses, &adjusted);
            self.drive((&name_of(project), project), placed, (own, &kept), progress)
        })?;
        let mut drives = vec![first];
        for (other, key) in project.evaluations.iter().zip(&self.keys.evaluations) {
            let key = self.keyed(key.clone());
            let stage = format!("evaluate {}", other.name);
            drives.push(job.once(&stage, &key, |progress| {
                let _stage = progress.stage(&stage, 0);
                self.evaluated(other, own, progress)
            })?);
        }
        Ok(drives)
    }

    fn keyed(&self, key: Key) -> Key {
        key.with(&(self.mountings, &self.project.comparison))
    }

    fn evaluated(
        &self,
        OtherDrive { name, project }: &OtherDrive,
        own: &Own<'_>,
        progress: &dyn Progress,
    ) -> Result<Shown> {
        let mut other = stages::aligned(self.project, Project::read(project)?)?;
        for (scanner, own) in other.scanners.iter_mut().zip(&self.project.scanners) {
            scanner.compliance = own.compliance;
        }
        let estimated = stages::poses(&other, progress)?;
        let kept = clouds::stream(&other, estimated.trajectory(), None, progress)?;
        let adjusted = adjusted_alone((name, &other), &estimated, self.calibration, progress)?;
        let poses = estimated.poses;
        let adjusted = adjusted.unwrap_or_else(|| Adjusted {
            bending: clouds::bending(&other, &poses.trajectory),
            trajectory: poses.trajectory.clone(),
            planes: Vec::new(),
        });
        self.drive((name, &other), (poses, &adjusted), (own, &kept), progress)
    }

    fn drive(
        &self,
        (name, project): (&str, &Project),
        (poses, adjusted): (Poses, &Adjusted),
        (own, kept): (&Own<'_>, &KeptPoints),
        progress: &dyn Progress,
    ) -> Result<Shown> {
        let (trajectory, bending) = (&adjusted.trajectory, adjusted.bending.as_slice());
        let trajectory_of = |kind| match kind {
            MountingKind::Initial | MountingKind::TwoStep => &poses.trajectory,
            MountingKind::Final | MountingKind::Truth => trajectory,
        };
        let bending_of = |kind| match kind {
            MountingKind::Final => bending,
            _ => &[],
        };
        let place = |(kind, mountings): &(MountingKind, Vec<BodyFromScanner>)| {
            let mounted = Mounted {
                mountings,
                bending: bending_of(*kind),
            };
            let trajectory = trajectory_of(*kind);
            (*kind, clouds::place(project, trajectory, mounted, kept))
        };
        let placed: Vec<_> = self.mountings.iter().map(place).collect();
        let scanners: Vec<&str> = project.scanners.iter().map(|s| s.name.as_str()).collect();
        let (surface, settings) = (own.surface(progress)?, &project.comparison);
        let agreements = agreements(name, &scanners, surface, &placed, settings, progress)?;
        let scene = {
            let _stage = progress.stage("choosing what the page shows", 0);
            let views = self.mountings.iter().map(|(kind, mountings)| View {
                kind: *kind,
                trajectory: trajectory_of(*kind),
                mountings,
                bending: bending_of(*kind),
            });
            let shown = scene::Shown {
                project,
                kept,
                agreements: &agreements,
                settings,
                reference: own.reference(progress)?,
                planes: &adjusted.planes,
                drives: 1 + self.project.evaluations.len(),
            };
            shown.with(views)
        };
        let placed = Poses {
            trajectory: trajectory.clone(),
            ..poses
        };
        Ok((drive(name, placed, agreements), scene))
    }
}

/// The poses of an evaluation drive and the motion of its mountings, adjusted with its own scans and without the
/// reference, by the mountings of a joint adjustment; `None` after two steps, and if the drive cannot be adjusted or is
/// contradicted.
fn adjusted_alone(
    (name, project): (&str, &Project),
    poses: &EstimatedPoses,
    calibration: &Calibration,
    progress: &dyn Progress,
) -> Result<Option<Adjusted>> {
    let (Method::Joint, Some(covariance)) = (calibration.method, &calibration.covariance) else {
        return Ok(None);
    };
    let calibrated = stages::with_mountings(project, &calibration.poses());
    let samples = stages::samples(&calibrated, poses.trajectory(), progress)?;
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
        Ok(joint) => {
            if let Some(reason) = contradictions(&joint).first() {
                keeps(reason);
                return Ok(None);
            }
            let drive = joint.drives.into_iter().next();
            let placed = drive.map(|drive| {
                let bending = drive.bending.into_iter().map(|moved| moved.offsets);
                Ok(Adjusted {
                    trajectory: drive.trajectory.with_limits(project.limits)?,
                    bending: bending.collect(),
                    planes: joint.planes,
                })
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
