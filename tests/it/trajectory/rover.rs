//! Simulated drives of a rover, and whether standard deviations cover the errors over many of them.

use super::{Logs, Truth};
use crate::common::consistency::PoseErrors;
use boresight::geometry::heading::{heading_rad, wrap};
use boresight::geometry::{BodyAxes, Rotation, Vec3};
use boresight::sensor::{HeadingFix, ImuSample, PositionFix};
use boresight::trajectory::{
    HeadingSettings, ImuNoise, Nodes, PositionSettings, TrajectorySettings,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Position and attitude of a small rover on a wavy figure of eight: first at rest, then in motion.
fn rover(time_s: f64) -> (Vec3, Rotation) {
    // Smooth start: rate and acceleration of the path parameter vanish at 3 s.
    let t = (time_s - 3.0).max(0.0);
    let s = t * t * t / (t * t + 4.0) * 0.3;
    let p = Vec3::new(2.0 * s.sin(), 1.5 * (2.0 * s).sin(), 0.05 * (3.0 * s).sin());
    // The course, and some crabbing.
    let yaw = (3.0 * (2.0 * s).cos()).atan2(2.0 * s.cos()) + 0.1 * (2.0 * s).sin();
    let (roll, pitch) = (0.05 * (5.0 * s).sin(), 0.04 * (1.0 - (4.0 * s).cos()));
    (p, Rotation::from_euler_angles(roll, pitch, yaw))
}

/// A field robot at 0.2 to 0.5 m/s on a large figure of eight over uneven ground, first at rest.
pub fn slow_rover(time_s: f64) -> (Vec3, Rotation) {
    let t = (time_s - 3.0).max(0.0);
    let s = t * t * t / (t * t + 4.0) * 0.1;
    let p = Vec3::new(3.0 * s.sin(), 2.0 * (2.0 * s).sin(), 0.03 * (7.0 * s).sin());
    let yaw = (4.0 * (2.0 * s).cos()).atan2(3.0 * s.cos()) + 0.1 * (3.0 * s).sin();
    let (roll, pitch) = (0.05 * (9.0 * s).sin(), 0.04 * (1.0 - (7.0 * s).cos()));
    (p, Rotation::from_euler_angles(roll, pitch, yaw))
}

/// Parts of an interval of the IMU over which rates and forces are averaged.
const PARTS: u32 = 2;

/// A simulated minute: logs, and the truth at the nodes.
pub fn rover_drive(seed: u64) -> (Logs, Vec<Truth>) {
    simulated(seed, rover, 3000)
}

/// `count` IMU samples at 50 Hz along a motion and the other logs, and the truth at the nodes.
pub fn simulated(seed: u64, rover: fn(f64) -> (Vec3, Rotation), count: u32) -> (Logs, Vec<Truth>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut noise3 = |sigma: f64| Vec3::new(normal(), normal(), normal()) * sigma;
    let noise = ImuNoise {
        gyro_density: 1e-4,
        accel_density: 1e-3,
        gyro_bias_walk: 2e-5,
        accel_bias_walk: 1e-4,
    };
    let dt = 0.02;
    let gravity = Vec3::new(0.0, 0.0, 9.81);
    let (mut gyro_bias, mut accel_bias) = (noise3(0.02), noise3(0.1));
    let imu = (0..count)
        .map(|k| {
            let t = f64::from(k) * dt;
            // Means over the halves of the interval: what is left is a thousandth of the noise.
            let (mut gyro, mut force) = (Vec3::zeros(), Vec3::zeros());
            for part in 0..PARTS {
                let (a, b) = (
                    t + dt * f64::from(part) / f64::from(PARTS),
                    t + dt * f64::from(part + 1) / f64::from(PARTS),
                );
                let (m, e) = (0.5 * (a + b), 1e-3);
                let (middle, r) = rover(m);
                let acceleration = (rover(m + e).0 - middle * 2.0 + rover(m - e).0) / (e * e);
                gyro += (rover(a).1.inverse() * rover(b).1).scaled_axis() / dt;
                force += r.inverse() * (acceleration + gravity) / f64::from(PARTS);
            }
            gyro_bias += noise3(noise.gyro_bias_walk * dt.sqrt());
            accel_bias += noise3(noise.accel_bias_walk * dt.sqrt());
            ImuSample {
                time_s: t,
                gyro_rad_s: gyro + gyro_bias + noise3(noise.gyro_density / dt.sqrt()),
                accel_m_s2: force + accel_bias + noise3(noise.accel_density / dt.sqrt()),
            }
        })
        .collect();
    let lever = Vec3::new(0.1, -0.2, 0.8);
    let (prism_sigma, heading_sigma) = (0.004, 0.01);
    let span = dt * f64::from(count);
    // Offset by 3 ms, so that records lie between the nodes.
    let times = |rate: f64| {
        (0..)
            .map(move |k| 0.003 + f64::from(k) / rate)
            .take_while(move |t| *t < span)
    };
    let prism = times(7.0)
        .map(|t| {
            PositionFix::with_sigma(
                t,
                rover(t).0 + rover(t).1 * lever + noise3(prism_sigma),
                None,
            )
        })
        .collect();
    let heading = times(5.0)
        .map(|t| {
            HeadingFix::new(
                t,
                wrap(heading_rad(&rover(t).1) + noise3(heading_sigma).x),
                None,
            )
        })
        .collect();
    let settings = TrajectorySettings {
        axes: BodyAxes::Flu,
        gravity_m_s2: 9.81,
        imu: noise,
        positions: vec![PositionSettings::prism(prism_sigma, lever)],
        heading: HeadingSettings::aligned(heading_sigma),
        nodes: Nodes::default(),
        max_step_s: TrajectorySettings::MAX_STEP_S,
        estimate: Vec::new(),
        zero_velocity: true,
    };
    let logs = Logs {
        imu,
        prism,
        heading,
        settings,
    };
    (
        logs,
        (0..=count).map(|k| rover(f64::from(k) * dt)).collect(),
    )
}

#[test]
fn claimed_standard_deviations_cover_the_errors_of_many_drives() {
    // 40 drives of a minute have at least a few hundred independent errors of each kind: the share
    // within the 95 % interval is known to about 2 %, and the requirement allows 4 %.
    let mut errors = PoseErrors::default();
    for seed in 0..40 {
        let (logs, truth) = rover_drive(seed);
        let estimate = logs.estimate();
        assert!(
            estimate.solution.converged,
            "seed {seed}: {}",
            estimate.solution
        );
        for (node, truth) in estimate.trajectory.poses().iter().zip(&truth).step_by(25) {
            errors.add(node, truth);
        }
    }
    let share = errors.inside();
    println!("inside {share:.3?}, rms {:.3?}", errors.normalised());
    for x in share {
        assert!((x - 0.95).abs() <= 0.04, "{share:?}");
    }
}
