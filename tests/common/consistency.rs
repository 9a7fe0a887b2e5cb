//! Simulated drives with settings that match their sensors, and pose errors compared with their
//! covariances; shared by tests and examples.
#![allow(dead_code)] // tests and examples use their parts

use boresight::Result;
use boresight::geometry::{Rotation, Vec3, WorldFromBody};
use boresight::progress::Silent;
use boresight::sensor::STANDARD_GRAVITY_M_S2;
use boresight::sensor::{HeadingFix, ImuSample, PoseRecord, PositionFix};
use boresight::simulation::{Drive, Scenario, simulate_heading, simulate_imu, simulate_prism};
use boresight::trajectory::{Estimate, MotionLogs, PoseGradient, estimate};
use boresight::trajectory::{HeadingSettings, ImuNoise, PositionSettings, TrajectorySettings};
use nalgebra::DVector;

/// Settings that match the sensors of a scenario.
pub fn settings_of(scenario: &Scenario) -> TrajectorySettings {
    let noise = &scenario.imu;
    let root = noise.bias_time_s.sqrt();
    let micro_g = 1e-6 * STANDARD_GRAVITY_M_S2;
    let mut settings = TrajectorySettings::new(
        scenario.body,
        ImuNoise {
            gyro_density: noise.gyro_noise_deg_sqrt_h.to_radians() / 60.0,
            accel_density: noise.accel_noise_ug_sqrt_hz * micro_g,
            gyro_bias_walk: noise.gyro_bias_instability_deg_h.to_radians() / 3600.0 / root,
            accel_bias_walk: noise.accel_bias_instability_ug * micro_g / root,
        },
        PositionSettings::prism(scenario.prism.sigma_m, scenario.lever_arm_m()),
        HeadingSettings::aligned(scenario.heading.sigma_deg.to_radians()),
    );
    settings.gravity_m_s2 = scenario.gravity_m_s2;
    let prism = &mut settings.positions[0];
    prism.sigma_correlated_m = Vec3::repeat(scenario.prism.sigma_correlated_m);
    prism.correlation_s = scenario.prism.correlation_s;
    settings.heading.sigma_correlated_rad = scenario.heading.sigma_correlated_deg.to_radians();
    settings.heading.correlation_s = scenario.heading.correlation_s;
    settings
}

/// The input of `estimate`.
#[derive(Clone)]
pub struct Logs {
    pub imu: Vec<ImuSample>,
    pub prism: Vec<PositionFix>,
    pub heading: Vec<HeadingFix>,
    pub settings: TrajectorySettings,
}

impl Logs {
    pub fn estimate(&self) -> Estimate {
        self.try_estimate().expect("a trajectory")
    }

    pub fn try_estimate(&self) -> Result<Estimate> {
        estimate(&self.motion(), &self.settings, &Silent)
    }

    pub fn motion(&self) -> MotionLogs<'_> {
        MotionLogs {
            imu: &self.imu,
            positions: std::slice::from_ref(&self.prism),
            heading: &self.heading,
        }
    }
}

/// True position and attitude of the body.
pub type Truth = (Vec3, Rotation);

/// The logs of a drive of the simulated robot with settings that match its sensors, and the truth at
/// the nodes.
pub fn twin(scenario: &Scenario, drive: &Drive, index: usize) -> (Logs, Vec<Truth>) {
    let imu = simulate_imu(scenario, drive, index);
    let truth = imu.truth.iter().map(|record| {
        let pose = record.world_from_body;
        (pose.translation_m, pose.rotation)
    });
    let truth = truth.collect();
    let logs = Logs {
        imu: imu.samples,
        prism: simulate_prism(scenario, drive, index),
        heading: simulate_heading(scenario, drive, index),
        settings: settings_of(scenario),
    };
    (logs, truth)
}

/// Error of a pose: shift and rotation vector, both in the world.
pub fn error(world_from_body: &WorldFromBody, truth: &Truth) -> (Vec3, Vec3) {
    let shift = world_from_body.translation_m - truth.0;
    let turn = world_from_body.rotation * truth.1.inverse();
    (shift, turn.scaled_axis())
}

pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(s, n), x| (s + x * x, n + 1));
    (sum / f64::from(count)).sqrt()
}

/// Errors of many poses, also in units of their standard deviations.
#[derive(Default)]
pub struct PoseErrors {
    /// Metres.
    pub shift: Vec<Vec3>,
    /// Radians.
    pub turn: Vec<Vec3>,
    /// In standard deviations: east, north, up, then the rotations about these axes.
    pub sigmas: Vec<[f64; 6]>,
}

impl PoseErrors {
    pub fn add(&mut self, pose: &PoseRecord, truth: &Truth) {
        let sigma = pose.sigma.expect("standard deviations");
        let (shift, turn) = error(&pose.world_from_body, truth);
        let a = shift.component_div(&sigma.position_m);
        let b = turn.component_div(&sigma.rotation_rad);
        self.shift.push(shift);
        self.turn.push(turn);
        self.sigmas.push([a.x, a.y, a.z, b.x, b.y, b.z]);
    }

    pub fn position_mm(&self) -> f64 {
        rms(self.shift.iter().map(|d| d.norm())) * 1e3
    }

    pub fn tilt_deg(&self) -> f64 {
        rms(self.turn.iter().map(|d| d.xy().norm())).to_degrees()
    }

    pub fn yaw_deg(&self) -> f64 {
        rms(self.turn.iter().map(|d| d.z)).to_degrees()
    }

    /// Root mean squares of the errors in standard deviations.
    pub fn normalised(&self) -> [f64; 6] {
        std::array::from_fn(|i| rms(self.sigmas.iter().map(|s| s[i])))
    }

    /// Shares of the errors that lie inside the 95 % bounds.
    pub fn inside(&self) -> [f64; 6] {
        std::array::from_fn(|i| {
            let inside = self.sigmas.iter().filter(|s| s[i].abs() < 1.96).count();
            inside as f64 / self.sigmas.len() as f64
        })
    }
}

pub const EPOCHS: usize = 20;

/// [`squares`] at epochs spread over a drive.
pub fn squares_at_epochs(estimate: &Estimate, truth: &[Truth]) -> Option<[[f64; 3]; EPOCHS]> {
    let nodes = estimate.trajectory.poses().len();
    let mut all = [[0.0; 3]; EPOCHS];
    for (number, epoch) in all.iter_mut().enumerate() {
        let node = (2 * number + 1) * nodes / (2 * EPOCHS);
        *epoch = squares(estimate, &truth[node], node)?;
    }
    Some(all)
}

/// Bounds of the mean of `draws` χ² variables with `degrees` of freedom each, at the normal quantile
/// `z` on either side (Wilson and Hilferty 1931).
pub fn band(degrees: f64, draws: f64, z: f64) -> [f64; 2] {
    let all = degrees * draws;
    let spread = 2.0 / (9.0 * all);
    [-z, z].map(|z| degrees * (1.0 - spread + z * spread.sqrt()).powi(3))
}

/// eᵀ Σ⁻¹ e of position, tilt and yaw of a node; `None` if a covariance is not positive definite.
fn squares(estimate: &Estimate, truth: &Truth, node: usize) -> Option<[f64; 3]> {
    let pose = estimate.trajectory.poses()[node].world_from_body;
    let (shift, turn) = error(&pose, truth);
    // δp in the world; the rotation about the world's axes is world_from_body δφ.
    let r = pose.rotation.to_rotation_matrix();
    let mut gradient = PoseGradient::new(6, estimate.covariance.nodes());
    let block = gradient.block_mut(node);
    for axis in 0..3 {
        block[axis * 6 + 3 + axis] = 1.0;
        for column in 0..3 {
            block[(3 + axis) * 6 + column] = r[(axis, column)];
        }
    }
    let covariance = estimate.covariance.of_functional(&gradient);
    let error = DVector::from_vec(vec![shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]);
    let square = |from: usize, count: usize| {
        let e = error.rows(from, count).into_owned();
        let c = covariance.view((from, from), (count, count)).into_owned();
        c.cholesky().map(|c| e.dot(&c.solve(&e)))
    };
    Some([square(0, 3)?, square(3, 2)?, square(5, 1)?])
}
