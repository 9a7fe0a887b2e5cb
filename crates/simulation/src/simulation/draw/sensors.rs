//! The sensors of the trajectory, and the reference.

use super::super::scenario::Scenario;
use super::draws::Draws;

/// Draws the IMU, from a cheap MEMS to a fibre gyro.
pub(super) fn imu(draws: &mut Draws, scenario: &mut Scenario) {
    let imu = &mut scenario.imu;
    imu.rate_hz = draws.pick(&[50.0, 100.0, 200.0, 400.0]);
    imu.gyro_noise_deg_sqrt_h = draws.log_uniform((0.005, 0.6));
    imu.accel_noise_ug_sqrt_hz = draws.log_uniform((8.0, 200.0));
    // Instabilities come with the noise, within a factor.
    imu.gyro_bias_instability_deg_h = imu.gyro_noise_deg_sqrt_h * draws.log_uniform((10.0, 100.0));
    imu.accel_bias_instability_ug = imu.accel_noise_ug_sqrt_hz * draws.log_uniform((0.1, 1.0));
    imu.gyro_bias_sigma_rad_s = draws.log_uniform((1e-5, 3e-3));
    imu.accel_bias_sigma_m_s2 = draws.log_uniform((1e-3, 5e-2));
    if draws.chance(0.3) {
        imu.vibration_m_s2 = draws.log_uniform((0.01, 0.5));
        imu.vibration_hz = draws.uniform((15.0, 120.0));
    }
}

/// Draws the positions: a prism, or an antenna whose errors last. Lasting errors are stated in the project.
pub(super) fn positions(draws: &mut Draws, scenario: &mut Scenario) {
    let height_m = scenario.motion.imu_height_m;
    let prism = &mut scenario.prism;
    let is_prism = draws.chance(0.6);
    if is_prism {
        prism.rate_hz = draws.log_uniform((1.0, 20.0));
        prism.sigma_m = draws.log_uniform((0.001, 0.01));
    } else {
        prism.rate_hz = draws.pick(&[1.0, 5.0, 10.0, 20.0]);
        prism.sigma_m = draws.log_uniform((0.003, 0.01));
        prism.sigma_correlated_m = draws.uniform((0.005, 0.02));
        prism.correlation_s = draws.log_uniform((20.0, 200.0));
    }
    let [x, y, _] = draws.normals(0.3 * height_m);
    prism.lever_arm_m = [x, y, -draws.uniform((0.1, 0.8))];
    if draws.chance(0.3) {
        let mut from = 20.0;
        for _ in 0..draws.count(1, 3) {
            from += draws.uniform((10.0, 60.0));
            let to = from + draws.log_uniform((2.0, 20.0));
            prism.lost_s.push([from, to]);
            from = to;
        }
    }
    scenario.project.states_errors = true;
    prism.latency_s = latency(draws);
}

/// Draws a delay of time stamps, which the project states.
fn latency(draws: &mut Draws) -> f64 {
    if draws.chance(0.3) {
        draws.log_uniform((0.002, 0.1))
    } else {
        0.0
    }
}

/// Draws the headings, if there are any.
pub(super) fn heading(draws: &mut Draws, scenario: &mut Scenario) {
    let heading = &mut scenario.heading;
    heading.enabled = draws.chance(0.7);
    heading.rate_hz = draws.pick(&[1.0, 5.0, 10.0]);
    heading.sigma_deg = draws.log_uniform((0.1, 1.5));
    if draws.chance(0.5) {
        heading.sigma_correlated_deg = draws.log_uniform((0.05, 0.5));
        heading.correlation_s = draws.log_uniform((10.0, 100.0));
    }
    heading.latency_s = latency(draws);
}

/// Draws the reference, if there is one, and its shift, of which the project states the standard deviation.
pub(super) fn reference(draws: &mut Draws, scenario: &mut Scenario) {
    let reference = &mut scenario.reference;
    reference.enabled = draws.chance(0.6);
    reference.sigma_m = draws.log_uniform((3e-4, 3e-3));
    let sigma_m = draws.log_uniform((3e-4, 5e-3));
    reference.offset_m = draws.normals(sigma_m);
    scenario.project.sigma_reference_m = sigma_m;
}
