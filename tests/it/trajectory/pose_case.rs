//! A simulated drive of five minutes with the sensors of the paper, with ground truth.

use super::{Logs, Truth, difference, difference_of_sigmas, quaternion, vec3};
use crate::common::consistency::PoseErrors;
use crate::common::{self, tables::numbers};
use boresight::geometry::heading::wrap;
use boresight::geometry::{BodyAxes, Vec3};
use boresight::sensor::{HeadingFix, ImuSample, PositionFix};
use boresight::trajectory::{Estimate, PoseGradient};
use boresight::trajectory::{
    HeadingSettings, ImuNoise, Nodes, PositionSettings, TrajectorySettings,
};
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

/// Rows per second of the IMU log and of the truth.
pub const IMU_HZ: f64 = 100.0;

pub fn pose_case() -> Logs {
    let folder = common::data("pose_case");
    let parameters = std::fs::read(folder.join("params.json")).expect("parameters");
    let parameters: serde_json::Value = serde_json::from_slice(&parameters).expect("JSON");
    let parameter = |key: &str| parameters[key].as_f64().expect("a number");
    let imu = numbers(&folder.join("imu.npy"))
        .iter()
        .enumerate()
        .map(|(k, r)| ImuSample {
            time_s: k as f64 / IMU_HZ,
            gyro_rad_s: vec3(r, 0),
            accel_m_s2: vec3(r, 3),
        })
        .collect();
    let prism = numbers(&folder.join("prism.csv"))
        .iter()
        .map(|r| PositionFix::with_sigma(r[0], vec3(r, 1), None))
        .collect();
    let heading = numbers(&folder.join("heading.csv"))
        .iter()
        .map(|r| HeadingFix::new(r[0], wrap(FRAC_PI_2 - r[1]), None))
        .collect();
    let settings = TrajectorySettings {
        axes: BodyAxes::Flu,
        gravity_m_s2: parameter("gravity_mps2"),
        imu: ImuNoise {
            gyro_density: parameter("gyro_noise_density"),
            accel_density: parameter("accel_noise_density"),
            gyro_bias_walk: parameter("gyro_bias_rw"),
            accel_bias_walk: parameter("accel_bias_rw"),
        },
        positions: vec![PositionSettings::prism(
            parameter("sigma_prism_m"),
            Vec3::new(0.20, 0.05, 1.50),
        )],
        heading: HeadingSettings::aligned(parameter("sigma_heading_rad")),
        nodes: Nodes::default(),
        max_step_s: TrajectorySettings::MAX_STEP_S,
        estimate: Vec::new(),
        zero_velocity: true,
    };
    Logs {
        imu,
        prism,
        heading,
        settings,
    }
}

/// True poses of the drive.
pub fn truth() -> Vec<Truth> {
    numbers(&common::data("pose_case/truth.npy"))
        .iter()
        .map(|r| (vec3(r, 0), quaternion(r, 3)))
        .collect()
}

#[test]
fn the_simulated_drive_is_as_accurate_as_it_can_be_and_the_sigmas_say_so() {
    let estimates = [Nodes::Imu, Nodes::Prism].map(|nodes| {
        let mut logs = pose_case();
        logs.settings.nodes = nodes;
        assert_accurate(&logs)
    });
    // Sparse nodes ignore the IMU noise between a node and the fixes after it.
    let [dense, sparse] = estimates.each_ref().map(|e| &e.trajectory);
    let (position_m, rotation_rad) = difference(dense, sparse);
    let sigma = difference_of_sigmas(sparse, dense);
    println!(
        "sparse against dense nodes: {:.3} µm, {:.1e} rad, sigmas {sigma:.1e}",
        position_m * 1e6,
        rotation_rad
    );
    assert!(position_m < 1e-6, "{position_m}");
    assert!(rotation_rad < 1e-6, "{rotation_rad}");
    assert!(sigma < 1e-3, "{sigma}");
}

fn assert_accurate(logs: &Logs) -> Estimate {
    let begun = Instant::now();
    let estimate = logs.estimate();
    println!(
        "{} in {:.3} s",
        estimate.solution,
        begun.elapsed().as_secs_f64()
    );
    assert!(estimate.solution.converged);
    let (nodes, truth) = (estimate.trajectory.poses(), truth());
    assert_eq!(nodes.len(), truth.len());
    let mut errors = PoseErrors::default();
    for (k, (node, truth)) in nodes.iter().zip(&truth).enumerate() {
        assert!((node.time_s - k as f64 / IMU_HZ).abs() < 1e-6);
        errors.add(node, truth);
    }
    let (position_mm, tilt_deg, yaw_deg) =
        (errors.position_mm(), errors.tilt_deg(), errors.yaw_deg());
    let share = errors.inside();
    assert_functionals_agree_with_marginals(&estimate);
    println!(
        "position {position_mm:.4} mm, tilt {tilt_deg:.5}°, yaw {yaw_deg:.5}°, inside {share:?}"
    );
    // gtsam's batch solution: 1.52 mm, 0.0055°, 0.021°.
    assert!(position_mm <= 1.46, "{position_mm}");
    assert!(tilt_deg <= 0.0057, "{tilt_deg}");
    assert!(yaw_deg <= 0.022, "{yaw_deg}");
    // Tilt and yaw errors change over minutes: one drive has few independent ones, and all of them may
    // lie inside. `rover` judges them over many drives.
    let position = share[..3].iter().sum::<f64>() / 3.0;
    let all = share.iter().sum::<f64>() / 6.0;
    assert!((position - 0.95).abs() <= 0.04, "{position}");
    assert!((all - 0.95).abs() <= 0.04, "{all}");
    estimate
}

/// Forward substitution and back-recursion compute the same standard deviations by different
/// arithmetic and differ by rounding alone, here with weights from 1 to 1e12.
fn assert_functionals_agree_with_marginals(estimate: &Estimate) {
    let nodes = estimate.trajectory.poses();
    let chosen = [0, nodes.len() / 3, nodes.len() - 1];
    let mut gradient = PoseGradient::new(12, nodes.len());
    for (k, &node) in chosen.iter().enumerate() {
        // Position along the world's axes; rotation about east = first row of world_from_body δφ.
        let r = nodes[node].world_from_body.rotation.to_rotation_matrix();
        let mut block = [0.0; 12 * 6];
        for axis in 0..3 {
            block[(4 * k + axis) * 6 + 3 + axis] = 1.0;
            block[(4 * k + 3) * 6 + axis] = r[(0, axis)];
        }
        gradient.add(node, &block);
    }
    let begun = Instant::now();
    let covariance = estimate.covariance.of_functional(&gradient);
    println!("12 functionals in {:.4} s", begun.elapsed().as_secs_f64());
    for (k, &node) in chosen.iter().enumerate() {
        let sigma = nodes[node].sigma.expect("standard deviations");
        let p = sigma.position_m;
        for (i, expected) in [p.x, p.y, p.z, sigma.rotation_rad.x].iter().enumerate() {
            let sigma = covariance[(4 * k + i, 4 * k + i)].sqrt();
            assert!((sigma / expected - 1.0).abs() < 1e-5, "{sigma} {expected}");
        }
    }
}
