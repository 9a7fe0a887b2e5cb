//! Simulated drives with settings that know their sensors, and errors beside their covariances.

use boresight::geometry::{Rotation, Vec3};
use boresight::simulation::Scenario;
use boresight::trajectory::{Estimate, PoseGradient};
use boresight::trajectory::{HeadingSettings, ImuNoise, PositionSettings, TrajectorySettings};
use nalgebra::DVector;

const STANDARD_GRAVITY: f64 = 9.806_65;

/// Settings that know the sensors of a scenario.
pub fn settings_of(scenario: &Scenario) -> TrajectorySettings {
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
    settings
}

/// eᵀ Σ⁻¹ e of position, tilt and yaw of a node; `None` where a covariance is not positive.
pub fn squares(found: &Estimate, truth: &[(Vec3, Rotation)], node: usize) -> Option<[f64; 3]> {
    let pose = found.trajectory.nodes()[node].world_from_body;
    let (position, rotation) = &truth[node];
    let turn = (pose.rotation * rotation.inverse()).scaled_axis();
    let shift = pose.translation_m - position;
    // δp in the world; the rotation about the world's axes is world_from_body δφ.
    let r = pose.rotation.to_rotation_matrix();
    let mut gradient = PoseGradient::new(6, found.covariance.nodes());
    let block = gradient.block_mut(node);
    for axis in 0..3 {
        block[axis * 6 + 3 + axis] = 1.0;
        for column in 0..3 {
            block[(3 + axis) * 6 + column] = r[(axis, column)];
        }
    }
    let covariance = found.covariance.of_functional(&gradient);
    let error = DVector::from_vec(vec![shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]);
    let square = |from: usize, count: usize| {
        let e = error.rows(from, count).into_owned();
        let c = covariance.view((from, from), (count, count)).into_owned();
        c.cholesky().map(|c| e.dot(&c.solve(&e)))
    };
    Some([square(0, 3)?, square(3, 2)?, square(5, 1)?])
}
