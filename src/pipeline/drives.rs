//! Agreement of the clouds of the calibration drive and of the evaluation drives.

use std::path::Path;

use super::calibration_drive::CalibrationDrive;
use super::clouds::{self, CloudSample, Mounted};
use super::job::Job;
use super::joint;
use super::keys::{Key, Keys};
use super::open_project::OpenProject;
use super::rig::{PASS_CELL_VOXELS, Rig};
use super::scene;
use super::stages::{self, EstimatedPoses, Poses};
use crate::calibration::{Calibration, Method};
use crate::comparison::{
    Agreements, MountingKind, PassCells, PassComparison, TimedPoint, agreements,
};
use crate::error::Result;
use crate::geometry::{Bending, BodyFromScanner};
use crate::joint::{Joint, SurfelPlane, contradictions};
use crate::progress::Progress;
use crate::project::{Motion, OtherDrive, Project};
use crate::report::scene::{Scene, View};
use crate::results::Drive;
use crate::trajectory::Trajectory;

/// Mountings to compare, with their kinds.
pub type Mountings = [(MountingKind, Vec<BodyFromScanner>)];

/// The name of a project's drive, which is that of its folder.
pub fn name_of(project: &Project) -> String {
    let folder = project.path.parent().and_then(Path::file_name);
    folder.map_or_else(
        || "drive".into(),
        |name| name.to_string_lossy().into_owned(),
    )
}

/// The final poses with which a drive's points are placed.
pub struct Adjusted {
    /// The poses of the joint adjustment, or those before it if there is none.
    pub trajectory: Trajectory,
    /// The motion of the mountings along it; empty if they are rigid.
    pub bending: Vec<Bending>,
    /// The surface that an adjustment estimated.
    pub planes: Vec<SurfelPlane>,
}

impl Adjusted {
    /// The poses of the calibration drive, from the joint adjustment if there is one.
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

/// The results of a drive, and its clouds for the viewer.
pub type DriveAndScene = (Drive, Option<Scene>);

/// A drive to be compared.
#[derive(Clone, Copy)]
struct ComparedDrive<'a> {
    name: &'a str,
    project: &'a OpenProject,
    rig: &'a Rig,
}

/// The data with which the drives of a project are compared.
pub struct Compared<'a> {
    /// The project.
    pub project: &'a OpenProject,
    /// The scanners with the values of the calibration.
    pub rig: &'a Rig,
    /// The mountings with which points are placed.
    pub mountings: &'a Mountings,
    /// The calibration.
    pub calibration: &'a Calibration,
    /// The keys of the stages.
    pub keys: &'a Keys,
}

impl Compared<'_> {
    /// Compares the sampled points of the calibration drive, placed with each of the mountings, and then those of the
    /// evaluation drives; appends each to `drives`. Without samples of the calibration drive, its points are read.
    ///
    /// # Errors
    /// Invalid settings of the comparison; errors of the readers and of the stages on an evaluation drive.
    pub fn all(
        &self,
        poses: Poses,
        adjusted: Adjusted,
        samples: Option<Vec<CloudSample>>,
        calibration_drive: &CalibrationDrive<'_>,
        drives: &mut Vec<DriveAndScene>,
        job: &mut Job<'_>,
    ) -> Result<()> {
        let drive = ComparedDrive {
            name: &name_of(self.project),
            project: self.project,
            rig: self.rig,
        };
        let key = self.keyed(self.keys.joint.clone());
        let first = job.once("compare", &key, |progress| {
            let samples = match samples {
                Some(samples) => samples,
                None => drive.samples(&adjusted.trajectory, progress)?,
            };
            self.drive(
                drive,
                poses,
                &adjusted,
                calibration_drive,
                &samples,
                progress,
            )
        })?;
        drives.push(first);
        for (other, key) in self.project.evaluations.iter().zip(&self.keys.evaluations) {
            let key = self.keyed(key.clone());
            let stage = format!("evaluate {}", other.name);
            drives.push(job.once(&stage, &key, |progress| {
                let _stage = progress.stage(&stage, 0);
                self.evaluated(other, calibration_drive, progress)
            })?);
        }
        Ok(())
    }

    fn keyed(&self, key: Key) -> Key {
        // The more drives, the fewer points of each are shown.
        let drives = self.project.evaluations.len();
        key.with(&(self.mountings, &self.project.comparison, drives))
    }

    fn evaluated(
        &self,
        other: &OtherDrive,
        calibration_drive: &CalibrationDrive<'_>,
        progress: &dyn Progress,
    ) -> Result<DriveAndScene> {
        let project = &self.project.drive(other.read(self.project)?);
        let rig = &Rig {
            mountings: self.rig.mountings.clone(),
            compliance: self.rig.compliance.clone(),
            ..self.rig.of_drive(project)
        };
        let drive = ComparedDrive {
            name: &other.name,
            project,
            rig,
        };
        let estimated = stages::poses(project, progress)?;
        let samples = drive.samples(estimated.trajectory(), progress)?;
        let adjusted = drive.adjusted_alone(&estimated, self.calibration, progress)?;
        let poses = estimated.poses;
        let adjusted = adjusted.unwrap_or_else(|| Adjusted {
            bending: clouds::bending(rig, &poses.trajectory),
            trajectory: poses.trajectory.clone(),
            planes: Vec::new(),
        });
        self.drive(
            drive,
            poses,
            &adjusted,
            calibration_drive,
            &samples,
            progress,
        )
    }

    fn drive(
        &self,
        ComparedDrive { name, project, rig }: ComparedDrive<'_>,
        poses: Poses,
        adjusted: &Adjusted,
        calibration_drive: &CalibrationDrive<'_>,
        samples: &[CloudSample],
        progress: &dyn Progress,
    ) -> Result<DriveAndScene> {
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
                rig: &rig.with_poses(mountings),
                bending: bending_of(*kind),
            };
            (*kind, clouds::place(trajectory_of(*kind), mounted, samples))
        };
        let placed: Vec<_> = self.mountings.iter().map(place).collect();
        let scanners: Vec<&str> = project.scanners.iter().map(|s| s.name.as_str()).collect();
        let (surface, settings) = (calibration_drive.surface(progress)?, &project.comparison);
        let mut agreements = agreements(name, &scanners, surface, &placed, settings, progress)?;
        let timed = |kind, mountings: &[BodyFromScanner], trajectory: &Trajectory| {
            let mounted = Mounted {
                rig: &rig.with_poses(mountings),
                bending: bending_of(kind),
            };
            clouds::place_timed(trajectory, mounted, samples)
        };
        let is_given = matches!(project.motion, Motion::Poses(_));
        let is_adjusted = self.calibration.method == Method::Joint;
        let given = (is_given && is_adjusted).then_some(&poses.trajectory);
        agreements.passes = passes(self.mountings, rig.finest_m(), trajectory_of, given, timed);
        let scene = {
            let _stage = progress.stage("selecting points for the page", 0);
            let views = self.mountings.iter().map(|(kind, mountings)| View {
                kind: *kind,
                trajectory: trajectory_of(*kind),
                mountings,
                bending: bending_of(*kind),
            });
            let input = scene::SceneInput {
                project,
                rig,
                samples,
                agreements: &agreements,
                settings,
                reference: calibration_drive.reference(progress)?,
                planes: &adjusted.planes,
                drives: 1 + self.project.evaluations.len(),
            };
            input.scene(views)
        };
        let placed = Poses {
            trajectory: trajectory.clone(),
            ..poses
        };
        Ok((drive(name, placed, agreements), scene))
    }
}

impl ComparedDrive<'_> {
    /// An even sample of the points of each scanner.
    fn samples(
        &self,
        trajectory: &Trajectory,
        progress: &dyn Progress,
    ) -> Result<Vec<CloudSample>> {
        let mounted = Mounted::rigid(self.rig);
        clouds::stream(self.project, trajectory, mounted, None, progress)
    }

    /// The poses of an evaluation drive and the motion of its mountings, adjusted with the mountings of the joint
    /// adjustment and the scans of this drive, without the reference; `None` after a calibration in two steps, and if
    /// the drive cannot be adjusted or its sensors contradict the adjustment.
    fn adjusted_alone(
        &self,
        poses: &EstimatedPoses,
        calibration: &Calibration,
        progress: &dyn Progress,
    ) -> Result<Option<Adjusted>> {
        let (Method::Joint, Some(covariance)) = (calibration.method, &calibration.covariance)
        else {
            return Ok(None);
        };
        let &Self { name, project, rig } = self;
        let drive = joint::Drive {
            name,
            project,
            rig,
            poses,
            samples: &stages::samples(project, rig, poses.trajectory(), progress)?,
        };
        let warn = |reason: &str| {
            progress.warn(&format!("drive `{name}` keeps its own poses: {reason}"));
        };
        match joint::with_known_mountings(&drive, covariance, progress) {
            Ok(joint) => {
                if let Some(reason) = contradictions(&joint).first() {
                    warn(reason);
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
                warn(&reason);
                Ok(None)
            }
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
        log_findings: poses.log_findings,
    }
}

/// How far passes over the same ground lie apart, with each kind of mounting on its poses, and, where poses were `given`
/// and adjusted, also with the final mounting on those.
fn passes<'a>(
    mountings: &[(MountingKind, Vec<BodyFromScanner>)],
    finest_m: f64,
    trajectory_of: impl Fn(MountingKind) -> &'a Trajectory,
    given: Option<&'a Trajectory>,
    place: impl Fn(MountingKind, &[BodyFromScanner], &Trajectory) -> Vec<TimedPoint>,
) -> Vec<PassComparison> {
    let is_final = |(kind, _): &&(MountingKind, Vec<BodyFromScanner>)| *kind == MountingKind::Final;
    let Some((_, result)) = mountings.iter().find(is_final) else {
        return Vec::new();
    };
    let adjusted = place(
        MountingKind::Final,
        result,
        trajectory_of(MountingKind::Final),
    );
    let cells = PassCells::new(&adjusted, PASS_CELL_VOXELS * finest_m);
    let compared = |mounting, on_given_poses, points: &[TimedPoint]| {
        let distances = cells.distances(points)?;
        Some(PassComparison {
            mounting,
            on_given_poses,
            distances,
        })
    };
    let all = mountings.iter().map(|(kind, mountings)| match kind {
        MountingKind::Final => compared(*kind, false, &adjusted),
        _ => compared(*kind, false, &place(*kind, mountings, trajectory_of(*kind))),
    });
    let on_given = given.map(|trajectory| {
        let points = place(MountingKind::Final, result, trajectory);
        compared(MountingKind::Final, true, &points)
    });
    all.chain(on_given).flatten().collect()
}
