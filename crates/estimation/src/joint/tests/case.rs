//! Three seconds over a curved surface: an IMU, a prism, headings, a profile scanner and a 3-D
//! scanner.

use crate::calibration::{Mounting, ScannerSample};
use crate::geometry::heading::heading_rad;
use crate::geometry::so3::{exp, log};
use crate::geometry::{BodyAxes, BodyFromScanner, Rotation, Vec3, WorldFromBody};
use crate::joint::bend::Bends;
use crate::joint::layout::{Groups, REFERENCE};
use crate::joint::motion::Motion;
use crate::joint::problem::JointProblem;
use crate::joint::state::State;
use crate::joint::surfel::{
    Association, Assumed, Gates, Grid, ReferenceCells, SharedPlane, associate,
};
use crate::joint::{
    ChainMotion, CorrectedPoses, CorrelatedError, JointDrive, JointInput, JointSettings,
    MountingMotion, Rung, Scans,
};
use crate::progress::Silent;
use crate::sensor::{FrameLog, HeadingFix, ImuSample, PoseRecord, PoseSigma, PositionFix};
use crate::surface::{Profile, ProfilePoint};
use crate::trajectory::{
    Constant, Estimate, HeadingSettings, ImuNoise, MotionLogs, PositionSettings, Trajectory,
    TrajectorySettings, estimate,
};
use nalgebra::DMatrix;

pub const GRAVITY: f64 = 9.81;
pub const SPAN_S: f64 = 3.0;
pub const SURFEL_M: f64 = 0.15;
/// Noise of the points along their rays, metres.
const RANGE_SIGMA_M: f64 = 2e-4;

/// Numbers of mean 0 and standard deviation 1 from a linear congruential generator, the same on
/// every platform: sums of four uniform ones.
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    let mut uniform = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    move || (0..4).map(|_| uniform()).sum::<f64>() * 0.75_f64.sqrt()
}

/// The surface: not a plane, so that mountings are determined, but flat within a surfel to a tenth of a
/// millimetre.
pub fn height_m(x: f64, y: f64) -> f64 {
    0.15 * (0.9 * x + 0.5 * y).sin() + 0.12 * (1.0 * y - 0.8 * x + 0.4).cos()
}

/// The pose of the body: it turns, rolls and pitches above the same square metre.
pub fn pose_at(t: f64) -> WorldFromBody {
    let about = |axis: Vec3, angle: f64| exp(&(axis * angle));
    let rotation = about(Vec3::z(), 0.9 * t)
        * about(Vec3::y(), 0.08 * (2.3 * t).sin())
        * about(Vec3::x(), 0.1 * (1.9 * t + 1.0).sin());
    let position_m = Vec3::new(
        0.35 * (2.1 * t).sin(),
        0.25 * (1.7 * t + 0.5).sin(),
        1.0 + 0.03 * (3.0 * t).sin(),
    );
    WorldFromBody::new(rotation, position_m)
}

fn imu() -> Vec<ImuSample> {
    let dt = 0.01;
    let position = |t: f64| pose_at(t).translation_m;
    let sample = |k: i32| {
        let t = f64::from(k) * dt;
        let (from, to) = (pose_at(t), pose_at(t + dt));
        let middle = pose_at(t + 0.5 * dt);
        let h = 1e-3;
        let at = t + 0.5 * dt;
        let accel = (position(at + h) + position(at - h) - position(at) * 2.0) / (h * h);
        ImuSample {
            time_s: t,
            gyro_rad_s: log(&(from.rotation.inverse() * to.rotation)) / dt,
            accel_m_s2: middle.rotation.inverse() * (accel + Vec3::z() * GRAVITY),
        }
    };
    let samples: Vec<ImuSample> = (0..(SPAN_S / dt).round() as i32).map(sample).collect();
    let mut next = noise(7);
    let mut three = |sigma: f64| Vec3::from_fn(|_, _| next() * sigma);
    let noisy = samples.into_iter().map(|sample| ImuSample {
        gyro_rad_s: sample.gyro_rad_s + three(IMU.gyro_density / dt.sqrt()),
        accel_m_s2: sample.accel_m_s2 + three(IMU.accel_density / dt.sqrt()),
        ..sample
    });
    noisy.collect()
}

const IMU: ImuNoise = ImuNoise {
    gyro_density: 5e-5,
    accel_density: 6e-4,
    gyro_bias_walk: 1e-6,
    accel_bias_walk: 1e-5,
};
const PRISM_SIGMA_M: f64 = 0.002;
const HEADING_SIGMA_RAD: f64 = 0.005;

/// The trajectory from the logs. Fixes do not coincide with samples of the IMU, so nodes do not either.
pub fn estimated(constants: &[Constant]) -> Estimate {
    let arm_m = Vec3::new(0.3, -0.2, 0.8);
    let mut next = noise(3);
    let imu = imu();
    let prism: Vec<PositionFix> = (0..14)
        .map(|k| {
            let t = 0.1037 + 0.2 * f64::from(k);
            let off_m = Vec3::from_fn(|_, _| next() * PRISM_SIGMA_M);
            PositionFix::with_sigma(t, pose_at(t).map(&arm_m) + off_m, None)
        })
        .collect();
    let heading: Vec<HeadingFix> = (0..20)
        .map(|k| {
            let t = 0.052 + 0.15 * f64::from(k);
            let off_rad = next() * HEADING_SIGMA_RAD;
            HeadingFix::new(t, heading_rad(&pose_at(t).rotation) + off_rad, None)
        })
        .collect();
    let mut settings = TrajectorySettings::new(
        BodyAxes::Flu,
        IMU,
        PositionSettings::prism(PRISM_SIGMA_M, arm_m),
        HeadingSettings::aligned(HEADING_SIGMA_RAD),
    );
    settings.gravity_m_s2 = GRAVITY;
    settings.estimate = constants.to_vec();
    let logs = MotionLogs {
        imu: &imu,
        positions: &[prism],
        heading: &heading,
    };
    estimate(&logs, &settings, &Silent).expect("a trajectory")
}

/// Correlated errors of the prism and of the heading.
pub fn correlated() -> [Option<CorrelatedError>; 2] {
    let error = |sigma: &[f64]| CorrelatedError {
        sigma: sigma.to_vec(),
        correlation_s: 2.0,
    };
    [
        Some(error(&[0.002, 0.001, 0.003])),
        Some(error(&[HEADING_SIGMA_RAD])),
    ]
}

/// A trajectory from a file: the true one, its poses at 20 Hz, slowly wrong.
pub fn given() -> Trajectory {
    let poses = (0..=60).map(|k| {
        let t = 0.05 * f64::from(k);
        let turn_rad = Vec3::new(0.4, -0.3, 0.5) * (1e-3 * (0.7 * t).cos());
        let shift_m = Vec3::new(0.002, -0.001, 0.0015) * (0.9 * t).sin();
        PoseRecord {
            sigma: Some(PoseSigma {
                position_m: Vec3::new(0.003, 0.002, 0.004),
                rotation_rad: Vec3::repeat(1e-3),
            }),
            ..PoseRecord::new(t, pose_at(t).perturbed(&turn_rad, &shift_m))
        }
    });
    Trajectory::new(poses.collect()).expect("times increase")
}

/// The true mountings of the profile scanner `left` and the 3-D scanner `lidar`.
pub fn truth() -> Vec<Mounting> {
    let quarter = Rotation::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let left = exp(&Vec3::new(0.15, 0.05, 0.1)) * quarter;
    let lidar = exp(&Vec3::new(-0.1, 0.08, -0.4));
    vec![
        Mounting::new(
            "left",
            BodyFromScanner::new(left, Vec3::new(0.2, 0.15, 0.1)),
        ),
        Mounting::new(
            "lidar",
            BodyFromScanner::new(lidar, Vec3::new(-0.1, -0.2, 0.05)),
        ),
    ]
}

/// Mountings off by a millimetre or two and as many milliradians.
pub fn start() -> Vec<Mounting> {
    let mut all = truth();
    let off = [
        (Vec3::new(1.0, -1.5, 0.5), Vec3::new(-1.0, 1.2, 1.5)),
        (Vec3::new(-0.8, 0.6, -0.7), Vec3::new(0.9, 1.0, -1.1)),
    ];
    for (mounting, (shift, turn)) in all.iter_mut().zip(off) {
        let pose = mounting.body_from_scanner;
        mounting.body_from_scanner = pose.perturbed(&(turn * 1e-3), &(shift * 1e-3));
    }
    all
}

/// The point that a scanner sees along a ray, in its own frame, metres.
fn hit_m(time_s: f64, mounting: &BodyFromScanner, ray: &Vec3) -> Vec3 {
    let world_from_scanner = pose_at(time_s) * *mounting;
    let miss = |range: f64| {
        let hit = world_from_scanner.map(&(ray * range));
        hit.z - height_m(hit.x, hit.y)
    };
    // Rays point down: the height that is missing is about the range that is missing.
    ray * (0..60).fold(1.0, |range, _| range + miss(range))
}

/// Samples of both scanners: 27 points in each of 60 profiles per second, and 1300 points per second
/// that are each a profile of its own.
pub fn samples() -> Vec<ScannerSample> {
    let left = truth()[0].body_from_scanner;
    samples_with(|_| left)
}

/// The same with a profile scanner whose mounting depends on time.
pub fn samples_with(left_at: impl Fn(f64) -> BodyFromScanner) -> Vec<ScannerSample> {
    let mut next = noise(11);
    let lidar = truth()[1].body_from_scanner;
    let mut samples = [ScannerSample::default(), ScannerSample::default()];
    let mut add = |sample: &mut ScannerSample, time_s: f64, new: bool, hit_m: Vec3| {
        if new {
            let world_from_body = pose_at(time_s);
            sample.profiles.push(Profile {
                time_s,
                world_from_body,
            });
        }
        sample.points.push(ProfilePoint {
            profile: sample.profiles.len() as u32 - 1,
            position_m: hit_m * (1.0 + RANGE_SIGMA_M * next() / hit_m.norm()),
            count: 1 + sample.points.len() as u32 % 3,
        });
    };
    for profile in 0..180 {
        let time_s = 0.0041 + f64::from(profile) / 60.2;
        for beam in -13..=13 {
            let angle = 0.03 * f64::from(beam);
            let ray = Vec3::new(angle.sin(), 0.0, -angle.cos());
            let hit_m = hit_m(time_s, &left_at(time_s), &ray);
            add(&mut samples[0], time_s, beam == -13, hit_m);
        }
    }
    for point in 0..3900 {
        let time_s = 0.0023 + f64::from(point) / 1301.3;
        let (a, b) = ((61.0 * time_s).sin(), (97.0 * time_s + 1.0).sin());
        let ray = Vec3::new(0.35 * a, 0.35 * b, -1.0).normalize();
        let hit_m = hit_m(time_s, &lidar, &ray);
        add(&mut samples[1], time_s, true, hit_m);
    }
    samples.into()
}

/// A scan of the surface from elsewhere, with a point every 12 mm.
pub fn reference() -> Vec<Vec3> {
    let mut next = noise(13);
    let grid = (0..14_400).map(|i| (f64::from(i % 120), f64::from(i / 120)));
    grid.map(|(i, j)| {
        let (x, y) = (0.012 * i - 0.72, 0.012 * j - 0.72);
        Vec3::new(x, y, height_m(x, y) + 3e-4 * next())
    })
    .collect()
}

/// The data that a problem borrows.
pub struct Case {
    pub samples: Vec<ScannerSample>,
    pub reference: Vec<Vec3>,
    pub motion: Box<dyn Motion>,
    pub mountings: Vec<Mounting>,
    pub estimate_latency: Vec<bool>,
    pub settings: JointSettings,
    /// σ of the reference's surface errors, metres.
    pub surface_m: f64,
    pub known: Option<DMatrix<f64>>,
}

impl Case {
    /// The three kinds of rigid mountings, with their names.
    pub fn all() -> [(&'static str, Self); 3] {
        [
            ("all kinds of rows", Self::full()),
            ("logs and scans", Self::plain()),
            ("poses from a file", Self::from_file()),
        ]
    }

    /// Logs with constants and correlated errors, a reference, latencies: every kind of row.
    pub fn full() -> Self {
        let constants = [Constant::LeverArm(0), Constant::HeadingOffset];
        let estimate = estimated(&constants);
        let motion = ChainMotion::new(&estimate.covariance, vec!["prism".into()], &correlated());
        Self {
            reference: reference(),
            estimate_latency: vec![true, true],
            surface_m: 2e-4,
            ..Self::with_motion(Box::new(motion))
        }
    }

    /// Logs and scans, nothing else.
    pub fn plain() -> Self {
        let estimate = estimated(&[]);
        let motion = ChainMotion::new(&estimate.covariance, vec!["prism".into()], &[]);
        Self::with_motion(Box::new(motion))
    }

    /// Poses from a file.
    pub fn from_file() -> Self {
        let motion = CorrectedPoses::new(&given(), 2.0).expect("poses with standard deviations");
        Self {
            reference: reference(),
            ..Self::with_motion(Box::new(motion))
        }
    }

    /// Logs and scans of mountings that bend and move.
    pub fn moving() -> Self {
        let mut case = Self::plain();
        case.settings.mounting = MountingMotion {
            least: Rung::DenseKnots,
            most: Rung::DenseKnots,
        };
        case
    }

    fn with_motion(motion: Box<dyn Motion>) -> Self {
        Self {
            samples: samples(),
            reference: Vec::new(),
            motion,
            mountings: start(),
            estimate_latency: vec![false, false],
            // With three seconds of data, Huber's weights matter, and converge by a fifth per step.
            settings: JointSettings {
                max_iterations: 500,
                ..JointSettings::default()
            },
            surface_m: 0.0,
            known: None,
        }
    }

    pub fn input(&self) -> JointInput<'_> {
        JointInput {
            mountings: self.mountings.clone(),
            initial: &self.mountings,
            held: &[],
            known: self.known.as_ref(),
            compliance: &[],
            estimate_latency: self.estimate_latency.clone(),
            drives: vec![JointDrive {
                name: "drive".into(),
                motion: self.motion.boxed(),
                scans: Scans {
                    samples: self.samples.iter().collect(),
                },
                frame: Some(FrameLog {
                    rows: vec![
                        (0.0, [20.0, 0.0]),
                        (0.4 * SPAN_S, [25.0, 0.0]),
                        (SPAN_S, [24.0, 0.0]),
                    ],
                    columns: 1,
                }),
            }],
            reference: &self.reference,
        }
    }

    pub fn associated(&self, input: &JointInput<'_>, misfit_m: f64) -> Association {
        self.associated_at(input, misfit_m, Vec::new())
    }

    /// The association with the rows of keyframes only: one of `keyframe_steps` steps for each scanner.
    pub fn associated_at(
        &self,
        input: &JointInput<'_>,
        misfit_m: f64,
        keyframe_steps: Vec<usize>,
    ) -> Association {
        let state = self.state();
        associate(
            &[input.drives[0].scans.clone()],
            &state.motions,
            &state.poses(),
            None,
            &state.late_s,
            &[ReferenceCells::new(
                &self.reference,
                Grid::aligned(SURFEL_M),
                [0.0; REFERENCE],
            )],
            &Gates {
                misfit_m,
                patch_m: 0.3,
                keyframe_steps,
            },
        )
    }

    /// The start, without surfels.
    pub fn state(&self) -> State {
        State {
            motions: vec![self.motion.boxed()],
            mountings: self.mountings.clone(),
            bends: Bends::new(
                self.settings.mounting.least,
                std::slice::from_ref(&self.motion),
                &self.mountings,
                &[],
                &self.input().frames(),
            )
            .unwrap(),
            late_s: vec![0.0; self.mountings.len()],
            shapes: Vec::new(),
            patches: Vec::new(),
            planes: Vec::new(),
            reference: [0.0; REFERENCE],
        }
    }

    /// The problem with all points within 20 mm of their surfels, and its start.
    pub fn problem<'a>(&'a self, input: &'a JointInput<'a>) -> (JointProblem<'a>, State) {
        self.problem_of(input, self.associated(input, 0.005))
    }

    /// As [`Self::problem`], where every third surfel without a reference is assumed to lie in one plane.
    pub fn problem_with_plane<'a>(
        &'a self,
        input: &'a JointInput<'a>,
    ) -> (JointProblem<'a>, State) {
        let mut association = self.associated(input, 0.005);
        let surfels = association.surfels.iter_mut();
        for surfel in surfels.filter(|surfel| surfel.prior.is_none()).step_by(3) {
            surfel.assumed = Assumed {
                sigma: [100.0, 0.01, 0.01],
                plane: Some(0),
            };
            let axes = surfel.axes;
            association.planes = vec![SharedPlane { axes }];
        }
        self.problem_of(input, association)
    }

    fn problem_of<'a>(
        &'a self,
        input: &'a JointInput<'a>,
        association: Association,
    ) -> (JointProblem<'a>, State) {
        let mut state = self.state();
        state.shapes = vec![Vec3::zeros(); association.surfels.len()];
        state.patches = vec![0.0; association.patches];
        state.planes = vec![[0.0; 2]; association.planes.len()];
        let problem = JointProblem::new(
            input,
            &self.settings,
            association,
            Groups::new(input),
            &state,
            self.surface_m,
        );
        (problem, state)
    }
}
