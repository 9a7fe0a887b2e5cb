//! Logs with flaws, with other axes, with outages or without headings: estimated where possible, and
//! refused with a clear message where not.

use super::rover::rover_drive;
use super::{Logs, rms};
use boresight::geometry::{BodyAxes, Rotation, Vec3};

fn refusal(logs: &Logs) -> String {
    logs.try_estimate().expect_err("refused").to_string()
}

fn assert_names(logs: &Logs, words: &[&str]) {
    let message = refusal(logs);
    for word in words {
        assert!(message.contains(word), "no '{word}' in: {message}");
    }
}

#[test]
fn flaws_are_reported_with_their_place_and_size() {
    let good = || rover_drive(1).0;
    let mut logs = good();
    logs.imu[41].accel_m_s2.y = f64::NAN;
    assert_names(&logs, &["IMU log", "record 42", "0.820000 s"]);
    let mut logs = good();
    logs.prism[3].position_m.x = f64::INFINITY;
    assert_names(&logs, &["prism log", "record 4"]);
    let mut logs = good();
    logs.heading[2].sigma_rad = Some(0.0);
    assert_names(&logs, &["heading log", "record 3"]);
    let mut logs = good();
    logs.imu[10].time_s = f64::NAN;
    assert_names(&logs, &["IMU log", "time of record 11"]);
    let mut logs = good();
    logs.imu[1000..].iter_mut().for_each(|s| s.time_s += 200.0);
    assert_names(
        &logs,
        &["IMU log", "gap of 200.020 s", "19.980 s", "220.000 s"],
    );
    let mut logs = good();
    logs.prism.iter_mut().for_each(|f| f.time_s += 100.0);
    assert_names(&logs, &["IMU log", "prism log", "the gap is 40.003 s"]);
    let mut logs = good();
    logs.heading.iter_mut().for_each(|f| f.time_s -= 1000.0);
    assert_names(&logs, &["heading log", "do not overlap"]);
    let mut logs = good();
    logs.prism.truncate(4);
    assert_names(&logs, &["only 4 prism fixes", "at least 5"]);
    let mut logs = good();
    logs.imu.truncate(1);
    assert_names(&logs, &["IMU log holds 1 samples"]);
    let mut logs = good();
    logs.imu.clear();
    assert_names(&logs, &["IMU log holds 0 samples"]);
    let mut logs = good();
    logs.settings.positions[0].sigma_m = Vec3::zeros();
    assert_names(&logs, &["prism sigma is 0"]);
}

#[test]
fn a_body_at_rest_without_headings_is_refused() {
    let mut logs = rover_drive(1).0;
    logs.heading.clear();
    logs.prism.retain(|f| f.time_s < 3.0);
    assert_names(
        &logs,
        &["no headings", "heading of the body is not determined"],
    );
}

#[test]
fn fixes_outside_the_time_span_of_the_imu_are_ignored_and_counted() {
    let (mut logs, _) = rover_drive(1);
    logs.imu.drain(..500);
    let before = logs.prism.iter().filter(|f| f.time_s < 10.0).count();
    let estimate = logs.estimate();
    assert!(estimate.solution.converged);
    let prism = estimate.solution.sensor("prism").expect("a prism");
    assert_eq!(prism.ignored, before);
    assert_eq!(prism.count, logs.prism.len() - before);
    assert_eq!(estimate.trajectory.poses().len(), logs.imu.len() + 1);
}

#[test]
fn frd_axes_give_the_same_trajectory_as_flu_axes() {
    let (flu, _) = rover_drive(2);
    let (mut frd, _) = rover_drive(2);
    let swap = |v: Vec3| Vec3::new(v.x, -v.y, -v.z);
    for sample in &mut frd.imu {
        sample.gyro_rad_s = swap(sample.gyro_rad_s);
        sample.accel_m_s2 = swap(sample.accel_m_s2);
    }
    frd.settings.axes = BodyAxes::Frd;
    frd.settings.positions[0].lever_arm_m = swap(frd.settings.positions[0].lever_arm_m);
    let flu_from_frd = Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    let (a, b) = (flu.estimate(), frd.estimate());
    for (a, b) in a.trajectory.poses().iter().zip(b.trajectory.poses()) {
        let (a, b) = (a.world_from_body, b.world_from_body);
        // Both end within a few percent of a standard deviation (1 mm, 1e-3 rad) of the minimum.
        assert!((a.translation_m - b.translation_m).norm() < 2e-5);
        assert!((a.rotation * flu_from_frd).angle_to(&b.rotation) < 2e-6);
    }
}

#[test]
fn an_outage_of_the_prism_is_bridged_and_its_sigma_grows() {
    let (mut logs, truth) = rover_drive(3);
    logs.prism.retain(|f| !(20.0..30.0).contains(&f.time_s));
    let estimate = logs.estimate();
    assert!(estimate.solution.converged);
    let nodes = estimate.trajectory.poses();
    let sigma = |time_s: f64| {
        nodes[(time_s / 0.02) as usize]
            .sigma
            .expect("sigma")
            .position_m
    };
    assert!(sigma(25.0).norm() > 3.0 * sigma(15.0).norm());
    let normalised = (1000..1500).step_by(25).map(|i| {
        let miss = nodes[i].world_from_body.translation_m - truth[i].0;
        miss.component_div(&nodes[i].sigma.expect("sigma").position_m)
            .norm()
    });
    // Three coordinates: the root mean square is √3 where the sigmas are right, but the errors within
    // one outage are nearly a single draw, whose 99.9 % point is 4.03.
    assert!(rms(normalised) < 4.03);
}

#[test]
fn without_headings_the_motion_determines_the_yaw_within_its_sigma() {
    let (mut logs, truth) = rover_drive(4);
    logs.heading.clear();
    let estimate = logs.estimate();
    let mut worst = 0.0f64;
    for (node, (_, r)) in estimate.trajectory.poses().iter().zip(&truth).step_by(100) {
        let miss = (node.world_from_body.rotation * r.inverse())
            .scaled_axis()
            .z
            .abs();
        let sigma = node.sigma.expect("sigma").rotation_rad.z;
        assert!(sigma < 1f64.to_radians());
        worst = worst.max(miss / sigma);
    }
    println!(
        "without headings: {}, worst yaw {worst:.2} sigma",
        estimate.solution
    );
    assert!(estimate.solution.converged);
    // Were the 61 errors independent, one drive in 35 would exceed 3.5 sigma; they are correlated.
    assert!(worst < 3.5, "{worst}");
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    let (logs, _) = rover_drive(5);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| logs.estimate().trajectory)
    };
    assert_eq!(run(1), run(2));
}
