//! Drives of the simulated robot over its field, with truth at the nodes.

use super::Logs;
use boresight::geometry::{Rotation, Vec3};
use boresight::project::{HeadingSettings, ImuNoise, PositionSettings, TrajectorySettings};
use boresight::simulation::{Drive, Scenario, simulate_heading, simulate_imu, simulate_prism};

const STANDARD_GRAVITY: f64 = 9.806_65;

/// The logs of a drive with settings that know its sensors, and the true poses.
pub fn twin(scenario: &Scenario, drive: &Drive, index: usize) -> (Logs, Vec<(Vec3, Rotation)>) {
    let imu = simulate_imu(scenario, drive, index);
    let noise = &scenario.imu;
    let root = noise.bias_time_s.sqrt();
    let micro_g = 1e-6 * STANDARD_GRAVITY;
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
    let truth = imu.truth.iter().map(|record| {
        let pose = record.world_from_body;
        (pose.translation.vector, pose.rotation)
    });
    let truth = truth.collect();
    let logs = Logs {
        imu: imu.samples,
        prism: simulate_prism(scenario, drive, index),
        heading: simulate_heading(scenario, drive, index),
        settings,
    };
    (logs, truth)
}
