//! Measurements of the IMU.

use std::f64::consts::{SQRT_2, TAU};

use super::drive::Drive;
use super::random::{Purpose, normal3, stream};
use super::scenario::Scenario;
use super::sensors::ImuSettings;
use crate::geometry::Vec3;
use crate::sensor::{ImuBias, ImuSample, PoseRecord, STANDARD_GRAVITY_M_S2};

/// Nodes and weights of four-point Gauss-Legendre quadrature on (0, 1).
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// The readings of a drive and the truth at their times.
#[derive(Debug, Clone, PartialEq)]
pub struct Inertial {
    /// Sample k is the mean over [t_k, t_k+1).
    pub samples: Vec<ImuSample>,
    /// Truth at each t_k and at the end of the last interval, biases included.
    pub truth: Vec<PoseRecord>,
}

/// The mean of a vibration over each interval: √2 σ sin(2π f t + φ), with a phase for each axis.
struct Vibration {
    amplitude_m_s2: f64,
    rate_rad_s: f64,
    phases_rad: [f64; 3],
}

impl Vibration {
    fn new(settings: &ImuSettings) -> Self {
        Self {
            amplitude_m_s2: SQRT_2 * settings.vibration_m_s2,
            rate_rad_s: TAU * settings.vibration_hz,
            phases_rad: [0.0, 1.0, 2.0].map(|axis| axis * TAU / 3.0),
        }
    }

    fn mean_m_s2(&self, start_s: f64, duration_s: f64) -> Vec3 {
        let turn_rad = self.rate_rad_s * duration_s;
        let mean = |phase_rad: f64| {
            let start_rad = self.rate_rad_s * start_s + phase_rad;
            self.amplitude_m_s2 * (start_rad.cos() - (start_rad + turn_rad).cos()) / turn_rad
        };
        Vec3::from(self.phases_rad.map(mean))
    }
}

/// Simulates the IMU: mean specific force and rate of each interval, plus a vibration, plus a
/// bias random walk, plus white noise of density n, whose mean over the interval has standard deviation n/√Δt.
pub fn simulate_imu(scenario: &Scenario, drive: &Drive, drive_index: usize) -> Inertial {
    let settings = &scenario.imu;
    let dt = 1.0 / settings.rate_hz;
    let on = if settings.noise { 1.0 } else { 0.0 };
    let gyro_density = on * settings.gyro_noise_deg_sqrt_h.to_radians() / 60.0;
    let accel_density = on * settings.accel_noise_ug_sqrt_hz * 1e-6 * STANDARD_GRAVITY_M_S2;
    let walk = on * (dt / settings.bias_time_s).sqrt();
    let gyro_walk = walk * settings.gyro_bias_instability_deg_h.to_radians() / 3600.0;
    let accel_walk = walk * settings.accel_bias_instability_ug * 1e-6 * STANDARD_GRAVITY_M_S2;

    let mut rng = stream(scenario.seed, Purpose::Imu, drive_index as u64, 0);
    let mut bias = ImuBias {
        gyro_rad_s: normal3(&mut rng) * (on * settings.gyro_bias_sigma_rad_s),
        accel_m_s2: normal3(&mut rng) * (on * settings.accel_bias_sigma_m_s2),
    };
    let (start, end) = drive.span_s;
    let count = ((end - start) * settings.rate_hz).floor() as usize;
    let time = |k: usize| start + k as f64 * dt;
    let vibration = Vibration::new(settings);
    let record = |k: usize, bias: ImuBias| {
        let state = drive.at(time(k));
        PoseRecord {
            time_s: time(k),
            world_from_body: state.world_from_body,
            velocity_m_s: Some(state.velocity_m_s),
            bias: Some(bias),
            sigma: None,
        }
    };
    let mut result = Inertial {
        samples: Vec::with_capacity(count),
        truth: Vec::with_capacity(count + 1),
    };
    for k in 0..count {
        let (mut gyro, mut accel) = (Vec3::zeros(), Vec3::zeros());
        for (node, weight) in GAUSS {
            let state = drive.at(time(k) + node * dt);
            gyro += state.rate_rad_s * weight;
            accel += state.specific_force_m_s2(scenario.gravity_m_s2) * weight;
        }
        accel += vibration.mean_m_s2(time(k), dt);
        result.truth.push(record(k, bias));
        result.samples.push(ImuSample {
            time_s: time(k),
            gyro_rad_s: gyro * (1.0 + settings.gyro_scale)
                + bias.gyro_rad_s
                + normal3(&mut rng) * (gyro_density / dt.sqrt()),
            accel_m_s2: accel + bias.accel_m_s2 + normal3(&mut rng) * (accel_density / dt.sqrt()),
        });
        bias.gyro_rad_s += normal3(&mut rng) * gyro_walk;
        bias.accel_m_s2 += normal3(&mut rng) * accel_walk;
    }
    result.truth.push(record(count, bias));
    result
}

#[cfg(test)]
mod tests {
    use super::super::scene::Scene;
    use super::*;
    use crate::geometry::so3;

    #[test]
    fn ideal_readings_integrate_to_the_truth() {
        let mut scenario = Scenario::demo();
        scenario.imu.noise = false;
        let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
        let imu = simulate_imu(&scenario, &drive, 0);
        let dt = 0.01;
        let gravity = Vec3::new(0.0, 0.0, -scenario.gravity_m_s2);
        // From 20 s on the robot moves; one minute of plain strapdown integration.
        let from = 2000;
        let first = &imu.truth[from];
        let mut rotation = first.world_from_body.rotation;
        let mut velocity = first.velocity_m_s.expect("truth has velocities");
        let mut position = first.world_from_body.translation_m;
        for sample in &imu.samples[from..from + 6000] {
            let middle = rotation * so3::exp(&(sample.gyro_rad_s * (0.5 * dt)));
            let acceleration = middle * sample.accel_m_s2 + gravity;
            position += velocity * dt + acceleration * (0.5 * dt * dt);
            velocity += acceleration * dt;
            rotation *= so3::exp(&(sample.gyro_rad_s * dt));
        }
        let last = &imu.truth[from + 6000].world_from_body;
        let error = (position - last.translation_m).norm();
        let tilt = rotation.angle_to(&last.rotation);
        println!("after 60 s: {:.3} mm, {:.2e} rad", error * 1e3, tilt);
        assert!(error < 5e-3 && tilt < 2e-6, "{error} m, {tilt} rad");
    }

    #[test]
    fn a_vibration_is_averaged_over_each_interval() {
        let mut scenario = Scenario::demo();
        scenario.imu.noise = false;
        let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
        let still = simulate_imu(&scenario, &drive, 0);
        (scenario.imu.vibration_m_s2, scenario.imu.vibration_hz) = (0.5, 30.0);
        let shaken = simulate_imu(&scenario, &drive, 0);
        let pairs = shaken.samples.iter().zip(&still.samples);
        let sum: f64 = pairs
            .map(|(a, b)| (a.accel_m_s2 - b.accel_m_s2).norm_squared())
            .sum();
        let rms = (sum / (3.0 * still.samples.len() as f64)).sqrt();
        // The mean of a sine over an interval: sin(π f Δt) / (π f Δt).
        let x = std::f64::consts::PI * 0.3;
        assert!((rms - 0.5 * x.sin() / x).abs() < 1e-3, "{rms}");
    }

    #[test]
    fn noise_has_the_strength_of_the_datasheet() {
        let scenario = Scenario::demo();
        let mut ideal = scenario.clone();
        ideal.imu.noise = false;
        let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
        let (noisy, ideal) = (
            simulate_imu(&scenario, &drive, 0),
            simulate_imu(&ideal, &drive, 0),
        );
        let mut sum = [0.0; 2];
        for ((a, b), truth) in noisy.samples.iter().zip(&ideal.samples).zip(&noisy.truth) {
            let bias = truth.bias.expect("truth has biases");
            sum[0] += (a.gyro_rad_s - b.gyro_rad_s - bias.gyro_rad_s).norm_squared();
            sum[1] += (a.accel_m_s2 - b.accel_m_s2 - bias.accel_m_s2).norm_squared();
        }
        let density = sum.map(|s| (s / (3.0 * noisy.samples.len() as f64) / 100.0).sqrt());
        // 0.15 °/√h and 57 µg/√Hz; 3 × 25,000 values scatter by 0.3 %.
        assert!((density[0] / 4.3633e-5 - 1.0).abs() < 0.015, "{density:?}");
        assert!((density[1] / 5.5898e-4 - 1.0).abs() < 0.015, "{density:?}");
    }
}
