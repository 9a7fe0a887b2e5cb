//! A simulated drive with its truth, adjusted in two steps and jointly; shared by tests and examples.
#![allow(dead_code)] // tests and examples use their parts

use std::path::Path;
use std::time::Instant;

use boresight::error::{Error, Result};
use boresight::geometry::{BodyFromScanner, Rotation, Vec3, so3};
use boresight::joint::{Joint, JointSettings, MovedMounting, contradictions};
use boresight::nalgebra::{DMatrix, DVector};
use boresight::pipeline::joint::{Drive, report, with_known_mountings};
use boresight::pipeline::{OpenProject, Rig, clouds, stages};
use boresight::progress::Silent;
use boresight::project::{OtherDrive, Project};
use boresight::simulation::{Scenario, simulate};

pub use super::against_truth::Outcome;
use super::against_truth::{
    Check, average_over_motion, mounting_errors, true_mountings, true_poses,
};

/// Unknowns of a mounting.
pub const SIX: usize = 6;

/// A scenario, and how its drives are adjusted.
pub struct Setup {
    pub scenario: Scenario,
    /// Changes to the project that the simulator has written.
    pub project: Box<dyn Fn(&mut Project)>,
    /// Shift (metres) and rotation vector (radians) of the reference's points about their mean;
    /// `None` if the reference is not used.
    pub reference: Option<(Vec3, Vec3)>,
    pub joint: JointSettings,
    /// Number of drives that are adjusted together; the first is compared with the truth.
    pub drives: usize,
    /// Keeps only the scans of every second span of this many seconds: the even spans if true, else the odd ones.
    pub keep: Option<(f64, bool)>,
    /// Whether the next drive is then adjusted with the adjusted mountings, without the reference.
    pub evaluate: bool,
    /// Standard deviations (metres, radians) of known mountings, which are the true ones; the reference is not used.
    pub known: Option<[f64; 2]>,
}

/// Makes the frame bend only with roll and pitch, by this share of the simulator's default.
pub fn bend(scenario: &mut Scenario, share: f64) {
    let deformation = &mut scenario.deformation;
    deformation.enabled = true;
    deformation.rotation_deg_per_deg *= share;
    deformation.shift_m_per_deg *= share;
    deformation.shift_m_per_m_s2 = 0.0;
    (deformation.drift_deg, deformation.drift_m) = (0.0, 0.0);
}

impl Setup {
    /// A scenario with its reference, which is assumed to be free of shift and tilt.
    pub fn new(scenario: Scenario) -> Self {
        let mut joint = JointSettings::default();
        (joint.reference.shift_m, joint.reference.tilt_rad) = (0.0, 0.0);
        Self {
            scenario,
            project: Box::new(|_| ()),
            reference: Some((Vec3::zeros(), Vec3::zeros())),
            joint,
            drives: 1,
            keep: None,
            evaluate: false,
            known: None,
        }
    }
}

/// The results of both methods for a drive.
pub struct Run {
    /// True mountings; their means if they move.
    pub truth: Vec<BodyFromScanner>,
    pub two_steps: Outcome,
    pub one_piece: Outcome,
    pub joint: Joint,
    /// Errors of points of the joint adjustment and their standard deviations, world, metres.
    pub points: Vec<[Vec3; 2]>,
    /// Reasons why the joint adjustment is refused.
    pub refused: Vec<String>,
    /// Another drive: with the poses of its logs and the mountings of two steps, of the joint adjustment, and adjusted
    /// itself.
    pub evaluation: Option<[Outcome; 3]>,
}

impl Run {
    /// Simulates the first drive of a scenario into a folder and adjusts it.
    pub fn new(setup: &Setup, folder: &Path) -> Result<Self> {
        let mut scenario = setup.scenario.clone();
        scenario
            .drives
            .truncate(setup.drives + usize::from(setup.evaluate));
        let files = simulate(&scenario, folder, &Silent)?;
        let mut project = Project::read(&files.drives[0].project)?;
        project.joint = setup.joint.clone();
        let others = files.drives[1..setup.drives].iter().zip(2..);
        project.drives = others
            .map(|(drive, number)| OtherDrive {
                name: format!("drive-{number}"),
                project: drive.project.clone(),
            })
            .collect();
        (setup.project)(&mut project);
        let project = OpenProject::new(&project);
        let exact = true_poses(&files.drives[0])?;
        let truth = scenario.true_mountings();
        let mut rig = Rig::new(&project);
        if setup.known.is_some() {
            rig = rig.with_poses(&truth);
        }
        let reference = match &setup.reference {
            Some((shift_m, turn)) => moved(stages::reference(&project, &Silent)?, shift_m, turn),
            None => Vec::new(),
        };
        let begun = Instant::now();
        let poses = stages::poses(&project, &Silent)?;
        let mut samples = stages::samples(&project, &rig, poses.trajectory(), &Silent)?;
        if let Some((span_s, even)) = setup.keep {
            let start_s = poses.trajectory().span_s().0;
            for sample in &mut samples {
                let is_kept = |time_s: f64| (((time_s - start_s) / span_s) as i64 % 2 == 0) == even;
                *sample = sample.within(is_kept);
            }
        }
        let drive = Drive {
            name: "drive",
            project: &project,
            rig: &rig,
            poses: &poses,
            samples: &samples,
        };
        let Adjusted {
            start,
            two_seconds,
            joint,
            refused,
            seconds,
        } = match setup.known {
            Some(sigmas) => by_known_mountings(&drive, sigmas)?,
            None => from_two_steps(&drive, &reference, begun)?,
        };
        let check = Check {
            scenario: &scenario,
            samples: &samples,
            exact: &exact,
            truth: &truth,
            moving: true_mountings(&scenario, &files.drives[0])?,
            reference: &reference,
        };
        let two_steps = check.outcome(
            start.clone(),
            poses.trajectory(),
            &[0.0; 2],
            &[],
            two_seconds,
        );
        let late_s: Vec<f64> = joint
            .late_s
            .iter()
            .map(|l| l.map_or(0.0, |l| l.0))
            .collect();
        let adjusted = &joint.drives[0];
        let mut one_piece = check.outcome(
            joint.poses(),
            &adjusted.trajectory,
            &late_s,
            &adjusted.bending,
            seconds,
        );
        let points = check.point_errors(&joint, &late_s);
        let evaluation = setup.evaluate.then(|| {
            let other = &files.drives[setup.drives];
            let evaluation = OtherDrive {
                name: "evaluation".to_owned(),
                project: other.project.clone(),
            };
            let other_project = project.drive(evaluation.read(&project)?);
            let mut rig = rig.of_drive(&other_project).with_poses(&start);
            for (known, compliance) in rig.compliance.iter_mut().zip(&joint.compliance) {
                *known = Some(*compliance);
            }
            let poses = stages::poses(&other_project, &Silent)?;
            let samples = stages::samples(&other_project, &rig, poses.trajectory(), &Silent)?;
            rig.mountings.clone_from(&joint.mountings);
            let drive = Drive {
                name: &evaluation.name,
                project: &other_project,
                rig: &rig,
                poses: &poses,
                samples: &samples,
            };
            let adjusted = with_known_mountings(&drive, &joint.covariance, &Silent)?;
            let check = Check {
                scenario: &scenario,
                samples: &samples,
                exact: &true_poses(other)?,
                truth: &truth,
                moving: true_mountings(&scenario, other)?,
                reference: &[],
            };
            let by_load = clouds::bending(&rig, poses.trajectory()).into_iter();
            let by_load = by_load.map(|offsets| MovedMounting {
                sigmas: offsets.clone(),
                offsets,
            });
            let by_load: Vec<MovedMounting> = by_load.collect();
            let (own, late_s) = (poses.trajectory(), &[0.0; 2]);
            let drive = &adjusted.drives[0];
            Ok::<_, Error>([
                check.outcome(start, own, late_s, &[], 0.0),
                check.outcome(joint.poses(), own, late_s, &by_load, 0.0),
                check.outcome(
                    adjusted.poses(),
                    &drive.trajectory,
                    late_s,
                    &drive.bending,
                    0.0,
                ),
            ])
        });
        let evaluation = evaluation.transpose()?;
        let moving = &check.moving;
        let mut truth = truth.clone();
        let (mountings, bending) = (&mut one_piece.mountings, &joint.drives[0].bending);
        average_over_motion(&mut truth, mountings, moving, bending);
        Ok(Self {
            evaluation,
            truth,
            two_steps,
            one_piece,
            joint,
            points,
            refused,
        })
    }

    /// Errors (δp, δφ) of all mountings in body axes, metres and radians, of both methods.
    pub fn errors(&self) -> [DVector<f64>; 2] {
        [&self.two_steps, &self.one_piece]
            .map(|outcome| mounting_errors(&outcome.mountings, &self.truth).into())
    }

    /// Standard deviations of the mountings of the joint adjustment.
    pub fn sigmas(&self) -> DVector<f64> {
        self.joint.covariance.diagonal().map(f64::sqrt)
    }

    /// eᵀ C⁻¹ e of all errors of the mountings of the joint adjustment.
    pub fn chi_square(&self) -> Option<f64> {
        let [_, error] = self.errors();
        let factor = self.joint.covariance.clone().cholesky()?;
        Some(error.dot(&factor.solve(&error)))
    }

    /// Errors of the second scanner relative to the first, in the first one's frame, of both methods.
    pub fn relative_errors(&self) -> [DVector<f64>; 2] {
        let jacobian = self.relative_jacobian();
        self.errors().map(|error| &jacobian * error)
    }

    /// Their standard deviations.
    pub fn relative_sigmas(&self) -> DVector<f64> {
        let jacobian = self.relative_jacobian();
        let covariance = &jacobian * &self.joint.covariance * jacobian.transpose();
        covariance.diagonal().map(f64::sqrt)
    }

    /// Jacobian of the second scanner's pose in the first one's frame: t = R₁ᵀ (t₂ − t₁), R = R₁ᵀ R₂.
    fn relative_jacobian(&self) -> DMatrix<f64> {
        let arm = so3::hat(&(self.truth[1].translation_m - self.truth[0].translation_m));
        let back = self.truth[0].rotation.inverse().to_rotation_matrix();
        let back = back.matrix();
        let mut jacobian = DMatrix::zeros(SIX, 2 * SIX);
        let mut put = |row: usize, column: usize, part: &boresight::geometry::Mat3| {
            jacobian.view_mut((row, column), (3, 3)).copy_from(part);
        };
        put(0, 0, &-back);
        put(0, 3, &(back * arm));
        put(0, 6, back);
        put(3, 3, &-back);
        put(3, 9, back);
        jacobian
    }
}

/// Start and result of the adjustment.
struct Adjusted {
    start: Vec<BodyFromScanner>,
    two_seconds: f64,
    joint: Joint,
    refused: Vec<String>,
    seconds: f64,
}

fn from_two_steps(drive: &Drive<'_>, reference: &[Vec3], begun: Instant) -> Result<Adjusted> {
    let Drive {
        project,
        rig,
        poses,
        samples,
        ..
    } = drive;
    let (start, settings) = (&rig.mountings, &rig.settings(project));
    let calibration =
        stages::calibration(project, start, settings, poses, samples, reference, &Silent)?;
    let two_seconds = begun.elapsed().as_secs_f64();
    let report = report(drive, start, &calibration, reference, &Silent)?;
    let refused = report.refused;
    let joint = report.result;
    Ok(Adjusted {
        start: calibration.poses(),
        two_seconds,
        joint: joint.ok_or_else(|| Error::data(refused.join("; "), "see the case"))?,
        refused,
        seconds: report.seconds,
    })
}

/// Adjusts with the known mountings of the drive's rig, of these standard deviations, metres and radians.
fn by_known_mountings(drive: &Drive<'_>, [shift_m, turn_rad]: [f64; 2]) -> Result<Adjusted> {
    let sigma = |i: usize| if i % SIX < 3 { shift_m } else { turn_rad };
    let variances = DVector::from_fn(SIX * drive.rig.mountings.len(), |i, _| sigma(i).powi(2));
    let covariance = DMatrix::from_diagonal(&variances);
    let begun = Instant::now();
    let joint = with_known_mountings(drive, &covariance, &Silent)?;
    Ok(Adjusted {
        start: drive.rig.poses(),
        two_seconds: 0.0,
        refused: contradictions(&joint),
        joint,
        seconds: begun.elapsed().as_secs_f64(),
    })
}

fn moved(mut points: Vec<Vec3>, shift_m: &Vec3, turn: &Vec3) -> Vec<Vec3> {
    let centre = points.iter().sum::<Vec3>() / points.len().max(1) as f64;
    let rotation = Rotation::from_scaled_axis(*turn);
    for point in &mut points {
        *point = centre + rotation * (*point - centre) + shift_m;
    }
    points
}
