//! The calibration of a project's drive: the stages from the reference to the joint adjustment.

use super::calibration_drive::CalibrationDrive;
use super::findings::{Findings, Truth};
use super::job::Job;
use super::keys::Keys;
use super::open_project::OpenProject;
use super::rig::Rig;
use super::start::{self, Start};
use super::{calibration_toml, drives, joint, mounting, page, stages};
use crate::calibration::{Calibration, Method, Variant};
use crate::cloud::voxel;
use crate::comparison::MountingKind;
use crate::error::Result;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::joint::{Joint, JointReport};
use crate::judgement;
use crate::progress::Progress;
use crate::project::{Project, Scanner};
use crate::results::{Calibrations, Drive};

/// The results of the stages that need no scans.
pub struct BeforeScans {
    /// The reference, thinned for drawing.
    pub background_m: Vec<Vec3>,
    /// The poses before the joint adjustment.
    pub poses: stages::Poses,
}

/// Runs the stages that need no scans on the calibration drive.
///
/// # Errors
/// The first error of a stage.
pub fn before_scans(
    drive: &CalibrationDrive<'_>,
    keys: &Keys,
    job: &mut Job<'_>,
) -> Result<BeforeScans> {
    let background_m = job.once("reference", &keys.reference, |progress| {
        Ok(thinned_for_drawing(drive.reference(progress)?))
    })?;
    let poses = job.once("trajectory", &keys.poses, |progress| {
        Ok(drive.poses(progress)?.poses.clone())
    })?;
    Ok(BeforeScans {
        background_m,
        poses,
    })
}

/// The results of the stages.
pub struct Calibrated<'a> {
    /// The project.
    pub project: &'a OpenProject,
    /// The scanners before the calibration, with the scales that suit their points.
    pub rig: Rig,
    /// The reference, thinned for drawing.
    pub background_m: Vec<Vec3>,
    /// The start values of the calibration.
    pub start: Start,
    /// The calibration that gives the result.
    pub result: Calibration,
    /// Other calibrations of the same drive, such as the one in two steps if it is not the result.
    pub variants: Vec<(Variant, Calibration)>,
    /// The joint adjustment, if the project asks for it.
    pub joint: Option<JointReport>,
}

impl<'a> Calibrated<'a> {
    /// Runs the stages on the calibration drive, after [`before_scans`].
    ///
    /// # Errors
    /// The first error of any stage.
    pub fn run(
        project: &'a OpenProject,
        drive: &CalibrationDrive<'_>,
        BeforeScans {
            background_m,
            poses,
        }: &BeforeScans,
        keys: &Keys,
        job: &mut Job<'_>,
    ) -> Result<Self> {
        let rig = job.once("sample", &keys.calibration, |progress| {
            let initial = Rig::new(project);
            let rig = start::with_scales(project, &initial, &poses.trajectory, progress)?;
            let samples = drive.samples(&rig, progress)?;
            stages::check_reference(project, &rig, samples, drive.reference(progress)?)?;
            Ok(rig)
        })?;
        let start = job.once("check placement", &keys.calibration, |progress| {
            let samples = drive.samples(&rig, progress)?;
            let reference = drive.reference(progress)?;
            let trajectory = &poses.trajectory;
            Ok(start::start(
                project, &rig, trajectory, samples, reference, progress,
            ))
        })?;
        let two_steps = job.once("calibrate", &keys.calibration, |progress| {
            let (begin, settings) = (&start.rig.mountings, start.rig.settings(project));
            let (poses, samples) = (drive.poses(progress)?, drive.samples(&rig, progress)?);
            let reference = drive.reference(progress)?;
            stages::calibration(
                project, begin, &settings, poses, samples, reference, progress,
            )
        })?;
        // On badly misplaced scans, the joint adjustment would take minutes before it refuses them.
        let has_fault = poses.log_findings.spoil_poses() || start.first.placed.is_mistaken();
        let hindrance =
            has_fault.then_some("the logs or scans have a fault (see the first verdict)");
        let joint = match (project.is_joint, hindrance) {
            (true, None) => Some(job.once("adjust jointly", &keys.joint, |progress| {
                let input = joint::Drive {
                    name: &drives::name_of(project),
                    project,
                    rig: &rig,
                    poses: drive.poses(progress)?,
                    samples: drive.samples(&rig, progress)?,
                };
                let (begin, reference) = (&start.rig.mountings, drive.reference(progress)?);
                joint::report(&input, begin, &two_steps, reference, progress)
            })?),
            (true, Some(reason)) => Some(JointReport {
                refused: vec![reason.into()],
                ..JointReport::default()
            }),
            (false, _) => None,
        };
        let (result, variants) = match joint.as_ref().and_then(JointReport::accepted) {
            Some(joint) => {
                let calibration = joint.calibration(&two_steps);
                (calibration, vec![(Variant::TwoStep, two_steps)])
            }
            None => (two_steps, Vec::new()),
        };
        Ok(Self {
            project,
            rig,
            background_m: background_m.clone(),
            start,
            result,
            variants,
            joint,
        })
    }

    /// The joint adjustment whose values are the result.
    pub fn accepted(&self) -> Option<&Joint> {
        self.joint.as_ref().and_then(JointReport::accepted)
    }

    /// The poses of the drive after the joint adjustment, if there is one, from those before it.
    ///
    /// # Errors
    /// See [`drives::Adjusted::new`].
    pub fn adjusted_poses(&self, poses: &stages::Poses) -> Result<stages::Poses> {
        let adjusted = drives::Adjusted::new(self.project, poses, self.accepted())?;
        Ok(stages::Poses {
            trajectory: adjusted.trajectory,
            ..poses.clone()
        })
    }

    /// The scanners with the resulting values: mountings, and the latencies and the compliance of a joint adjustment.
    pub fn resulting_rig(&self) -> Rig {
        let joint = self.accepted();
        let late_s = |scanner: usize| joint?.late_s.get(scanner).copied().flatten();
        let offsets_s = self.rig.time_offsets_s.iter().enumerate();
        let offsets_s = offsets_s.map(|(scanner, offset_s)| match late_s(scanner) {
            Some((late_s, _)) => offset_s - late_s,
            None => *offset_s,
        });
        let scanners = 0..self.rig.mountings.len();
        Rig {
            mountings: self.result.mountings.clone(),
            time_offsets_s: offsets_s.collect(),
            compliance: scanners
                .map(|scanner| joint?.compliance.get(scanner).copied())
                .collect(),
            voxel_sizes_m: self.rig.voxel_sizes_m.clone(),
        }
    }

    /// The mountings for which clouds are compared: initial, two steps, final, and the truth if known.
    pub fn mountings(&self, truth: Option<&Truth>) -> Vec<(MountingKind, Vec<BodyFromScanner>)> {
        let mut mountings = vec![(MountingKind::Initial, self.rig.poses())];
        let mut variants = self.variants.iter();
        let two_steps = variants.find(|(variant, _)| *variant == Variant::TwoStep);
        mountings
            .extend(two_steps.map(|(_, calibration)| (MountingKind::TwoStep, calibration.poses())));
        mountings.push((MountingKind::Final, self.result.poses()));
        mountings.extend(truth.map(|truth| (MountingKind::Truth, truth.mountings.clone())));
        mountings
    }

    /// The findings of a run, with verdicts, from the results of its drives, of which the first is the calibration
    /// drive.
    pub fn findings(
        self,
        mountings: Vec<(MountingKind, Vec<BodyFromScanner>)>,
        drives: Vec<Drive>,
        job: &mut Job<'_>,
    ) -> Findings {
        let (project, rig) = (self.project, self.resulting_rig());
        let solution = drives.first().and_then(|drive| drive.solution.as_ref());
        // An error of the origin moves no point of a drive, so it is added only here.
        let origin_sigma_m = stages::origin_sigma_m(project, solution);
        let calibration = self.result.with_origin_sigma(origin_sigma_m);
        let variants = self.variants.into_iter();
        let variants = variants.map(|(variant, calibration)| match variant {
            Variant::ExactPoses => (variant, calibration),
            _ => (variant, calibration.with_origin_sigma(origin_sigma_m)),
        });
        job.warn_of_changes();
        let mut findings = Findings {
            rig,
            calibrations: Calibrations {
                mountings,
                result: calibration,
                joint: self.joint,
                variants: variants.collect(),
                origin_m: project.origin_m(),
            },
            drives,
            scenes: Vec::new(),
            background_m: self.background_m,
            made_s: page::now_s(),
            files: Vec::new(),
            stages: job.stages().to_vec(),
            placement: self.start.first,
            warnings: job.warnings().to_vec(),
            verdicts: Vec::new(),
            kept_stages: None,
        };
        findings.verdicts = judgement::judge(&findings.results(), &project.acceptance);
        findings
    }
}

/// The reference, thinned to a few thousand points.
fn thinned_for_drawing(reference: &[Vec3]) -> Vec<Vec3> {
    const VOXEL_M: f64 = 0.05;
    let thinned = voxel::thin(reference, VOXEL_M);
    thinned
        .iter()
        .map(|&index| reference[index as usize])
        .collect()
}

/// The files of [`write`].
pub const FILES: [&str; 2] = ["calibration.toml", "mounting.csv"];

/// Writes the mountings as tables for a project file and by time. A file that cannot be written does not keep back the
/// other.
///
/// # Errors
/// The first file that cannot be written.
pub fn write(project: &Project, findings: &Findings, job: &Job<'_>) -> Result<()> {
    let accepted = findings.calibrations.accepted();
    let text = calibration_toml::text(project, findings);
    let mut outcome = text.and_then(|text| job.write("calibration.toml", text));
    if let Some(drive) = findings.drives.first() {
        let adjusted = accepted.and_then(|joint| joint.drives.first());
        let moved = adjusted.map_or(&[][..], |drive| &drive.bending);
        let text = mounting::table(&findings.calibrations.result, moved, &drive.poses);
        outcome = outcome.and(job.write("mounting.csv", text));
    }
    outcome
}

/// The project with another method; warns of tables and keys that this method does not use.
pub fn with_method(project: &Project, method: Method, progress: &dyn Progress) -> Project {
    let project = project.clone().with_method(method);
    if !project.is_joint {
        let estimates = |scanner: &Scanner| scanner.estimate_time_offset;
        let unused = [
            ("[[drive]]", !project.drives.is_empty()),
            ("[bending]", project.bending.is_some()),
            (
                "`estimate` of scanners",
                project.scanners.iter().any(estimates),
            ),
        ];
        let unused = unused.iter().filter(|(_, is_there)| *is_there);
        let names: Vec<&str> = unused.map(|(name, _)| *name).collect();
        if !names.is_empty() {
            progress.warn(&format!(
                "without the joint adjustment, {} of the project are not used",
                names.join(", ")
            ));
        }
    }
    project
}
