use std::io::Write;
use std::path::{Path, PathBuf};

use super::*;
use crate::format::mutation::for_each_damaged;
use crate::geometry::so3::log;

const IMU_FILE: &str = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],\
    w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\r\n\
    1500000000000000001,0.1,-0.2,0.3,9.5,0.5,-1.25\r\n1500000000005000001,1,2,3,4,5,6\r\n";
const STATE_FILE: &str = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], \
    q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], \
    v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], \
    b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n\
    2000000000,1,2,3,0.5,0.5,0.5,0.5,4,5,6,.1,.2,.3,.4,.5,.6\n";
const POSE_FILE: &str = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],\
    q_RS_x [],q_RS_y [],q_RS_z []\n-1,1,2,3,0.8,0,0,0.6\n7,1,2,3,1,0,0,0\n";
const POSITION_FILE: &str =
    "#timestamp [ns],p_RS_R_z [m],p_RS_R_x [m],quality,p_RS_R_y [m]\n1000000,3,1,good,2\n";

fn with<T>(text: &str, read: impl Fn(&Input) -> T) -> T {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("data.csv");
    std::fs::write(&path, text).unwrap();
    read(&Input::from(&path))
}

#[test]
fn every_kind_is_detected_by_its_header_and_read() {
    for (text, kind) in [
        (IMU_FILE, Some(Kind::Imu)),
        (STATE_FILE, Some(Kind::State)),
        (POSE_FILE, Some(Kind::Pose)),
        (POSITION_FILE, Some(Kind::Position)),
        ("#timestamp [ns],filename\n", None),
        ("#timestamp [us],p_RS_R_x,p_RS_R_y,p_RS_R_z\n", None),
        ("time_s,east_m,north_m,up_m\n", None),
    ] {
        let header = text.lines().next().unwrap();
        assert_eq!(looks_like_header(header), kind, "{header}");
    }
    let imu = with(IMU_FILE, read_imu).unwrap();
    assert_eq!(imu.len(), 2);
    assert_eq!(imu[0].gyro_rad_s, Vec3::new(0.1, -0.2, 0.3));
    assert_eq!(imu[0].accel_m_s2, Vec3::new(9.5, 0.5, -1.25));
    assert_eq!(imu[1].time_s, 1_500_000_000.005);

    let state = with(STATE_FILE, read_poses).unwrap()[0];
    let pose = state.world_from_body;
    assert_eq!(
        (state.time_s, pose.translation_m),
        (2.0, Vec3::new(1.0, 2.0, 3.0))
    );
    // (0.5, 0.5, 0.5, 0.5) turns x to y, y to z and z to x.
    assert!((pose.rotation * Vec3::x() - Vec3::y()).norm() < 1e-15);
    assert_eq!(state.velocity_m_s, Some(Vec3::new(4.0, 5.0, 6.0)));
    let bias = state.bias.unwrap();
    assert_eq!(bias.gyro_rad_s, Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(bias.accel_m_s2, Vec3::new(0.4, 0.5, 0.6));

    let pose = with(POSE_FILE, read_poses).unwrap()[0];
    assert_eq!(
        (pose.time_s, pose.velocity_m_s, pose.bias),
        (-1e-9, None, None)
    );
    let x = pose.world_from_body.rotation * Vec3::x();
    assert!((x - Vec3::new(0.28, 0.96, 0.0)).norm() < 1e-15, "{x}");

    let prism = with(POSITION_FILE, read_positions).unwrap()[0];
    assert_eq!(
        (prism.time_s, prism.position_m),
        (1e-3, Vec3::new(1.0, 2.0, 3.0))
    );
}

#[test]
fn times_are_the_nearest_doubles() {
    let mut time_ns = 1_400_000_000_000_000_000_i64;
    for step in 0..10_000 {
        time_ns += 4_999_999 + 7919 * step;
        let text = format!("{}.{:09}", time_ns / 1_000_000_000, time_ns % 1_000_000_000);
        assert_eq!(seconds(time_ns), text.parse::<f64>().unwrap(), "{text}");
    }
    assert_eq!(seconds(i64::MIN), -9_223_372_036.854_776);
}

#[test]
fn errors_name_line_finding_and_expectation() {
    let text = |found: Result<Vec<ImuSample>>| found.unwrap_err().to_string();
    let e = text(with(POSE_FILE, read_imu));
    assert!(e.contains("line 1: found `#timestamp [ns],p_RS_R_x"), "{e}");
    assert!(
        e.contains("expected the header `#timestamp [ns],w_RS_S_x,"),
        "{e}"
    );
    for (from, to, message) in [
        ("0.1,", "0.1,0,", "line 2: found 8 values, expected 7"),
        (
            "00001,0.1",
            "00001.0,0.1",
            "line 2: found time `15000000000000000",
        ),
        (
            "00001,0.1",
            "00001,inf",
            "line 2: found `inf` in column w_RS_S_x",
        ),
        (
            "[rad s^-1]",
            "[deg s^-1]",
            "column w_RS_S_x in [deg s^-1], expected [rad s^-1]",
        ),
        ("[m s^-2]\r", "[m s^-2],w_RS_S_x\r", "column w_RS_S_x twice"),
    ] {
        let e = text(with(&IMU_FILE.replace(from, to), read_imu));
        assert!(e.contains(message), "{e}");
    }
    let header = IMU_FILE.lines().next().unwrap();
    assert!(text(with(header, read_imu)).contains("no IMU sample"));
    let e = with(&POSE_FILE.replace("0.8", "0.9"), read_poses).unwrap_err();
    assert!(e.to_string().contains("a quaternion of length 1.08"), "{e}");
    assert!(with(&POSE_FILE.replace("0.8", "1e200"), read_poses).is_err());
}

#[test]
fn damaged_files_do_not_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("data.csv");
    for valid in [IMU_FILE, STATE_FILE, POSE_FILE, POSITION_FILE] {
        for_each_damaged(&path, valid.as_bytes(), 1000, || {
            let _ = (
                read_imu(&Input::from(&path)),
                read_poses(&Input::from(&path)),
                read_positions(&Input::from(&path)),
            );
        });
    }
}

/// A folder of recorded data, if it exists.
fn recorded(folder: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("BORESIGHT_DATA").map_or_else(beside, PathBuf::from);
    let folder = root.join(folder);
    if !folder.is_dir() {
        // Not by a macro, whose lines are kept for tests that fail.
        let _ = writeln!(std::io::stderr(), "skipped: no {}", folder.display());
    }
    folder.is_dir().then_some(folder)
}

#[test]
fn recorded_files_agree_with_each_other() {
    if let Some(folder) = recorded("readers/euroc_5line_sample") {
        let at = |sensor: &str| folder.join(sensor).join("data.csv");
        let poses = read_poses(&Input::from(&at("state_groundtruth_estimate0"))).unwrap();
        let imu = read_imu(&Input::from(&at("imu0"))).unwrap();
        let prism = read_positions(&Input::from(&at("leica0"))).unwrap();
        assert_eq!([poses.len(), imu.len(), prism.len()], [5; 3]);
    }
    let Some(folder) = recorded("euroc_v2_03") else {
        return;
    };
    let at = |sensor: &str| folder.join(sensor).join("data.csv");
    let imu = read_imu(&Input::from(&at("imu0"))).unwrap();
    let truth = read_poses(&Input::from(&at("state_groundtruth_estimate0"))).unwrap();
    let vicon = read_poses(&Input::from(&at("vicon0"))).unwrap();
    assert!(vicon.iter().all(|pose| pose.bias.is_none()) && vicon.len() > 1000);
    // Rates and accelerations from differences of the poses agree with the IMU once its biases are
    // subtracted. This tests the sign of the biases, the direction of the rotation and the world's up.
    let (mut gyro, mut accel) = ([Vec3::zeros(); 2], [Vec3::zeros(); 2]);
    let mut count = 0.0;
    for pair in truth.windows(2) {
        let dt_s = pair[1].time_s - pair[0].time_s;
        let after = imu.partition_point(|sample| sample.time_s <= pair[0].time_s + 1e-6);
        let (Some(i), Some(bias), Some(v0), Some(v1)) = (
            after.checked_sub(1),
            pair[0].bias,
            pair[0].velocity_m_s,
            pair[1].velocity_m_s,
        ) else {
            continue;
        };
        if dt_s > 0.006 || (imu[i].time_s - pair[0].time_s).abs() > 1e-3 {
            continue;
        }
        let [r0, r1] = [0, 1].map(|i: usize| pair[i].world_from_body.rotation);
        let rate = log(&(r0.inverse() * r1)) / dt_s;
        let force = r0.inverse() * ((v1 - v0) / dt_s + Vec3::z() * 9.81);
        for (sign, s) in [1.0, -1.0].into_iter().enumerate() {
            gyro[sign] += imu[i].gyro_rad_s - bias.gyro_rad_s * s - rate;
            accel[sign] += imu[i].accel_m_s2 - bias.accel_m_s2 * s - force;
        }
        count += 1.0;
    }
    assert!(count > 1000.0);
    let [with, against] = gyro.map(|sum| (sum / count).norm());
    assert!(
        with < 2e-3 && with < 0.1 * against,
        "{with} {against} rad/s"
    );
    let [with, against] = accel.map(|sum| (sum / count).norm());
    assert!(with < 0.05 && with < 0.5 * against, "{with} {against} m/s²");
}
