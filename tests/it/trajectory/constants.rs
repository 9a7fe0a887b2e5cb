//! Constants estimated together with the poses: recovered where the drive determines them, reported
//! as undetermined where it does not.

use super::rover::{rover_drive, simulated};
use super::{Logs, difference, rms};
use crate::common::consistency::twin;
use boresight::geometry::heading::wrap;
use boresight::geometry::{Rotation, Vec3};
use boresight::simulation::{Drive, Scenario, Scene};
use boresight::trajectory::Constant;
use boresight::trajectory::{Estimate, EstimatedConstant};

/// The largest of some tens of normalised errors exceeds this in one of a few hundred runs.
const TENS_OF_DRAWS: f64 = 4.0;

fn estimated<'a>(estimate: &'a Estimate, name: &str) -> &'a EstimatedConstant {
    let all = &estimate.solution.constants;
    all.iter()
        .find(|c| c.name == name)
        .unwrap_or_else(|| panic!("{name} in {all:?}"))
}

/// The error of a constant in standard deviations, and its sigma; fails if it is undetermined.
fn normalised(estimate: &Estimate, name: &str, truth: f64) -> (f64, f64) {
    let c = estimated(estimate, name);
    let sigma = c.sigma.unwrap_or_else(|| panic!("{c:?}"));
    println!(
        "{name}: {:.6} {}, truth {truth:.6}, sigma {sigma:.1e}, {:+.2} sigma",
        c.value,
        c.unit,
        (c.value - truth) / sigma
    );
    ((c.value - truth) / sigma, sigma)
}

#[test]
fn constants_that_the_motion_determines_are_recovered() {
    let (latency_s, offset_rad, gravity_off) = (0.08, 0.03, -0.05);
    let arm_off = Vec3::new(0.05, 0.03, -0.04);
    for seed in 60..64 {
        let (mut logs, _) = rover_drive(seed);
        let [arm, gravity] = [
            logs.settings.positions[0].lever_arm_m,
            Vec3::repeat(logs.settings.gravity_m_s2),
        ];
        for fix in &mut logs.prism {
            fix.time_s += latency_s;
        }
        for fix in &mut logs.heading {
            fix.heading_rad = wrap(fix.heading_rad - offset_rad);
        }
        logs.settings.positions[0].lever_arm_m += arm_off;
        logs.settings.gravity_m_s2 += gravity_off;
        logs.settings.estimate = vec![
            Constant::TimeOffset(0),
            Constant::LeverArm(0),
            Constant::HeadingOffset,
            Constant::Gravity,
        ];
        let estimate = logs.estimate();
        assert!(estimate.solution.converged, "{}", estimate.solution);
        // The sigma must be small compared with the error put in, or nothing was recovered.
        for (name, truth, off) in [
            ("prism.time_offset", -latency_s, latency_s),
            ("prism.lever_arm.x", arm.x, arm_off.x),
            ("prism.lever_arm.y", arm.y, arm_off.y),
            ("prism.lever_arm.z", arm.z, arm_off.z),
            ("heading.mounting_offset", offset_rad, offset_rad),
            ("frame.gravity", gravity.x, gravity_off),
        ] {
            let (error, sigma) = normalised(&estimate, name, truth);
            assert!(error.abs() < TENS_OF_DRAWS, "{name}: {error}");
            assert!(sigma < off.abs() / 2.0, "{name}: {sigma}");
        }
    }
}

#[test]
fn the_scale_of_the_gyroscope_is_recovered() {
    let scale = Vec3::new(0.985, 1.012, 1.01);
    for seed in 60..64 {
        let (mut logs, _) = rover_drive(seed);
        for sample in &mut logs.imu {
            sample.gyro_rad_s.component_mul_assign(&scale);
        }
        logs.settings.estimate = vec![Constant::GyroScale];
        let estimate = logs.estimate();
        assert!(estimate.solution.converged, "{}", estimate.solution);
        for (axis, truth) in ["x", "y", "z"].iter().zip(scale.iter()) {
            let name = format!("imu.gyro_scale_factor.{axis}");
            let (error, sigma) = normalised(&estimate, &name, *truth);
            assert!(error.abs() < TENS_OF_DRAWS, "{name}: {error}");
            assert!(sigma < 0.005, "{name}: {sigma}");
        }
    }
}

#[test]
fn the_scale_of_the_imu_noise_is_recovered() {
    for scale in [1.0, 3.0] {
        let (mut logs, _) = rover_drive(70);
        // The noise is `scale` times that of the settings.
        logs.settings.imu.gyro_density /= scale;
        logs.settings.imu.accel_density /= scale;
        logs.settings.estimate = vec![Constant::ImuNoiseScale];
        let (error, sigma) = normalised(&logs.estimate(), "imu.noise_scale", scale);
        assert!(error.abs() < TENS_OF_DRAWS, "{error}");
        assert!(sigma < 0.2 * scale, "{sigma}");
    }
}

/// The constant is reported as undetermined and keeps the project's value, and the poses are those
/// estimated without it.
fn assert_undetermined(logs: &mut Logs, constant: Constant, name: &str, project: f64) {
    logs.settings.estimate = Vec::new();
    let plain = logs.estimate();
    logs.settings.estimate = vec![constant];
    let estimate = logs.estimate();
    let c = estimated(&estimate, name);
    println!("{c:?}");
    assert_eq!(c.sigma, None);
    assert_eq!(c.value, project);
    let (apart, _) = difference(&plain.trajectory, &estimate.trajectory);
    println!("poses apart by {apart:.1e} m");
    assert!(apart < 1e-6, "{apart}");
}

#[test]
fn a_heading_offset_without_headings_is_not_invented() {
    let (mut logs, _) = rover_drive(71);
    logs.heading.clear();
    logs.settings.heading.mounting_offset_rad = 0.02;
    assert_undetermined(
        &mut logs,
        Constant::HeadingOffset,
        "heading.mounting_offset",
        0.02,
    );
}

#[test]
fn a_time_offset_of_a_body_at_rest_is_not_invented() {
    let at_rest = |_| {
        let attitude = Rotation::from_euler_angles(0.02, -0.01, 0.7);
        (Vec3::new(1.0, 2.0, 0.1), attitude)
    };
    let (mut logs, _) = simulated(72, at_rest, 1500);
    assert_undetermined(&mut logs, Constant::TimeOffset(0), "prism.time_offset", 0.0);
}

#[test]
fn the_error_of_a_prism_that_turns_with_the_incidence_is_recovered() {
    const AMPLITUDE_M: f64 = 0.003;
    let mut scenario = Scenario::demo();
    scenario.seed = 73;
    scenario.prism.incidence_bias_m = AMPLITUDE_M;
    let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
    let (mut logs, truth) = twin(&scenario, &drive, 0);
    logs.settings.positions[0].station_m = Some(scenario.prism.station_m.into());
    let rmse_m = |estimate: &Estimate| {
        let nodes = estimate.trajectory.poses().iter().zip(&truth);
        rms(nodes.map(|(n, (p, _))| (n.world_from_body.translation_m - p).norm()))
    };
    let without_m = rmse_m(&logs.estimate());
    logs.settings.estimate = vec![Constant::IncidenceBias(0)];
    let estimate = logs.estimate();
    let with_m = rmse_m(&estimate);
    println!(
        "{:.3} mm without the bias estimated, {:.3} mm with",
        without_m * 1e3,
        with_m * 1e3
    );
    for (name, truth) in [
        ("along_cos", AMPLITUDE_M),
        ("along_sin", 0.0),
        ("across_cos", 0.0),
        ("across_sin", AMPLITUDE_M),
        ("up_cos", 0.0),
        ("up_sin", 0.0),
    ] {
        let (error, sigma) = normalised(&estimate, &format!("prism.incidence_bias.{name}"), truth);
        assert!(error.abs() < TENS_OF_DRAWS, "{name}: {error}");
        assert!(sigma < AMPLITUDE_M / 4.0, "{name}: {sigma}");
    }
    assert!(with_m < without_m, "{with_m} {without_m}");
}
