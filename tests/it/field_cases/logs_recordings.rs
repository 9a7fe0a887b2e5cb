//! Recordings of ROS as people have them, and positions of other programs.

use std::fs;
use std::path::Path;

use boresight::format::{self, Input, PointTimes, inspect};
use boresight::geometry::Projection;
use boresight::project::Project;
use boresight::sensor::{FixQuality, Observations};

use super::logs::{notes, sample};
use crate::common::{boresight, data, on_project};

/// The times of all points of a recording, and the remarks.
pub fn times_s(input: &Input) -> (Vec<f64>, String) {
    let mut reader = format::open_profiles(input).unwrap();
    let (mut times_s, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        times_s.extend(chunk.iter().map(|point| point.time_s));
    }
    (times_s, input.remarks().join("\n"))
}

#[track_caller]
fn assert_near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

/// Times of the points of three clouds, 0.1 s apart, with six points each.
fn even_s() -> Vec<f64> {
    let start_s = |i: usize| 1_700_000_001.0 + i as f64 / 60.0;
    (0..18).map(start_s).collect()
}

#[test]
fn times_of_points_are_known_by_many_names() {
    for name in ["time_offset_f32.mcap", "time_offset_ns_i32.mcap"] {
        let input = Input::from(&sample("points-time-field-unknown").join(name));
        assert_near(&times_s(&input).0, &even_s());
    }
}

#[test]
fn recordings_give_their_poses_points_and_errors_to_inspect() {
    for (name, count) in [
        ("od_ok.mcap", 3),
        ("t_u32_ns.mcap", 18),
        ("imu_nan1.mcap", 19),
        ("nf_nan_status0.mcap", 3),
    ] {
        let path = sample("inspect-rows-0").join(name);
        assert_eq!(inspect(&path).unwrap().count, count, "{name}");
    }
    let left_out = notes(&sample("inspect-rows-0/imu_nan1.mcap"));
    assert!(
        left_out.contains("1 of 20 messages of /imu left out"),
        "{left_out}"
    );
    let path = sample("inspect-rows-0/crc_none_flip.mcap");
    boresight(&["inspect", path.to_str().unwrap()])
        .assert_failed_with(&["byte 30", "a chunk whose checksum differs"]);
}

#[test]
fn times_before_the_stamp_are_unwrapped() {
    let path = sample("points-time-wrapped/t_u32_ns_neg_wrapped.mcap");
    let (found, remarks) = times_s(&Input::from(&path));
    assert_eq!(found.len(), 18);
    assert!((found[0] - 1_700_000_000.995).abs() < 1e-6);
    assert!(found[17] < 1_700_000_001.29);
    assert!(remarks.contains("taken for negative ones"), "{remarks}");
}

#[test]
fn microseconds_are_asked_for() {
    let path = sample("point_time_us/us.bag");
    boresight(&["inspect", path.to_str().unwrap()]).assert_failed_with(&[
        "0.100 s apart",
        "point_time_unit",
        "\"us\" or \"ns\"",
    ]);
    let answered = PointTimes {
        field: None,
        unit_s: Some(1e-6),
    };
    let (found, _) = times_s(&Input::from(&path).with_point_times(answered));
    let span_s = found[found.len() - 1] - found[0];
    assert!((0.4..0.5).contains(&span_s), "{span_s}");
}

#[test]
fn one_bad_message_costs_one_message() {
    for (name, count, expected) in [
        ("od_dup.mcap", 3, "1 of 4 poses left out"),
        (
            "od_zeroquat_first.mcap",
            2,
            "1 of 3 messages of /odom left out",
        ),
    ] {
        let input = Input::from(&sample("one-bad-message").join(name));
        assert_eq!(
            format::read_trajectory(&input).unwrap().len(),
            count,
            "{name}"
        );
        let remarks = input.remarks().join("\n");
        assert!(remarks.contains(expected), "{name}: {remarks}");
    }
    // One of five clouds has the stamp of another one.
    let (found, remarks) = times_s(&Input::from(&sample("one-bad-message/backwards.mcap")));
    assert_eq!(found.len(), 24);
    assert!(
        found.is_sorted() && remarks.contains("1 of 5 messages"),
        "{remarks}"
    );
}

#[test]
fn a_damaged_chunk_costs_its_messages_and_is_named() {
    let path = sample("mcap-chunk-damaged/flip.mcap");
    let input = Input::from(&path);
    assert_eq!(format::read_imu(&input).unwrap().len(), 194);
    let remarks = input.remarks().join("\n");
    assert!(
        remarks.contains("damaged places of the recording left out: 1"),
        "{remarks}"
    );
    assert!(remarks.contains("byte 4543"), "{remarks}");
    // The power failed, and the file system kept zeros.
    let folder = tempfile::tempdir().unwrap();
    let zeroed = folder.path().join("zeros.mcap");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2 + 1000;
    bytes[middle..].fill(0);
    fs::write(&zeroed, &bytes).unwrap();
    let input = Input::from(&zeroed);
    assert!(format::read_imu(&input).unwrap().len() > 50);
    let remarks = input.remarks().join("\n");
    assert!(
        remarks.contains("damaged places of") || remarks.contains("cut off"),
        "{remarks}"
    );
    // A file that is cut says so.
    fs::write(&zeroed, &fs::read(&path).unwrap()[..middle]).unwrap();
    let notes = notes(&zeroed);
    assert!(
        notes.contains(&format!("cut off at byte {middle}")),
        "{notes}"
    );
}

#[test]
fn positions_of_rtklib_and_emlid_have_quality_and_accuracy() {
    let crs = Projection::new("EPSG:25832").unwrap();
    for (name, first_s) in [
        ("rtk.pos", 1_691_572_500.0),
        ("rtk_tow.pos", 1_691_572_500.0),
        ("rtk_tow_nohead.pos", 1_691_572_500.0),
        ("emlid.LLH", 1_691_572_500.0),
        ("comma.pos", 33_300.0),
    ] {
        let input = Input::from(&sample("formats-refused").join(name));
        let as_found = Observations::AsFound;
        let found = format::read_projected_positions(&input, &as_found, Some(&crs)).unwrap();
        assert_eq!(found.fixes.len(), 3, "{name}");
        assert_eq!(found.fixes[0].time_s, first_s, "{name}");
        assert_eq!(found.fixes[0].position_m.z, 95.2771);
        let sigma_m = found.fixes[0].covariance_m2.unwrap().m33.sqrt();
        assert!((sigma_m - 0.0101).abs() < 1e-12, "{name}");
        let last = if name.starts_with("rtk_tow") {
            FixQuality::Fixed
        } else {
            FixQuality::Float
        };
        assert_eq!(
            found.qualities,
            [FixQuality::Fixed, FixQuality::Fixed, last]
        );
    }
}

#[test]
fn headings_of_two_antennas_have_their_pitch() {
    for (name, count, heading_deg, pitch_deg) in [
        ("ptnl_avr.nmea", 2, 149.4688, 0.0134),
        ("ksxt.nmea", 1, 341.33, -1.2),
    ] {
        let path = sample("formats-refused").join(name);
        let found = format::read_heading(&path).unwrap();
        assert_eq!(found.len(), count, "{name}");
        assert_eq!(found[0].time_s, 1_691_572_510.0, "{name}");
        assert!((found[0].heading_rad.to_degrees() - heading_deg).abs() < 1e-9);
        assert!((found[0].pitch_rad.unwrap().to_degrees() - pitch_deg).abs() < 1e-9);
    }
    // A GGK gives the position, above the ellipsoid.
    let crs = Projection::new("EPSG:25832").unwrap();
    let path = sample("formats-refused/ptnl_avr.nmea");
    let found = format::read_projected_positions(&path, &Observations::AsFound, Some(&crs));
    assert_eq!(found.unwrap().fixes[0].position_m.z, 95.277);
}

#[test]
fn points_without_times_of_their_own_are_named() {
    let recording = data("ros/plain.mcap");
    let (_, remarks) = times_s(&Input::from(&format!("{}#/untimed", recording.display())));
    assert!(remarks.contains("have no times of their own"), "{remarks}");
    let (_, remarks) = times_s(&Input::from(&format!("{}#/ouster", recording.display())));
    assert!(!remarks.contains("have no times of their own"), "{remarks}");
    assert!(
        remarks.contains("8 points at the origin of the scanner"),
        "{remarks}"
    );
}

#[test]
fn accelerations_in_g_have_a_key_of_the_project() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(
        sample("imu-in-g-bag/imu_g.mcap"),
        folder.path().join("imu.mcap"),
    )
    .unwrap();
    let rows = (0..18).map(|i| format!("{:.1},{i},0,0\n", 1_700_000_000.1 + 0.1 * f64::from(i)));
    let prism = format!("time_s,east_m,north_m,up_m\n{}", rows.collect::<String>());
    fs::write(folder.path().join("prism.csv"), prism).unwrap();
    let project = |unit: &str| {
        let text = format!(
            "[frame]\nbody = \"FLU\"\n[imu]\nfile = \"imu.mcap\"\n{unit}[prism]\nfile = \"prism.csv\"\n\
             lever_arm_m = [0, 0, 0.5]\n"
        );
        fs::write(folder.path().join("project.toml"), text).unwrap();
        on_project(folder.path(), "trajectory", &[])
    };
    project("").assert_failed_with(&["the log is in g", "accel_unit = \"g\""]);
    let run = project("accel_unit = \"g\"\n");
    assert!(!run.err.contains("the log is in g"), "{}", run.err);
    let inspected = on_project(folder.path(), "inspect", &[]);
    assert_eq!(inspected.code, 0, "{}", inspected.err);
}

#[test]
fn salvage_takes_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let path = sample("mcap-chunk-damaged/flip.mcap");
    let run = boresight(&[
        "salvage",
        path.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.out.contains("kept 194 records"), "{}", run.out);
    let input = Input::from(&out.join("flip.mcap"));
    assert_eq!(format::read_imu(&input).unwrap().len(), 194);
    assert!(input.remarks().is_empty(), "{:?}", input.remarks());
}

#[test]
fn the_folder_of_a_split_recording_stands_for_it() {
    let folder = data("ros/split");
    let run = boresight(&["inspect", folder.to_str().unwrap()]);
    assert!(
        run.out.contains("/imu (sensor_msgs/Imu, 12 messages)"),
        "{}",
        run.out
    );
    let topic = format!("{}#/odom", folder.display());
    let found = inspect(Path::new(&topic)).unwrap();
    // The size is that of both files, not of their list.
    assert_eq!((found.count, found.bytes), (12, 4896 + 4974));
    let files = format::files_of(Path::new(&topic));
    assert_eq!(files.len(), 3);
    assert!(files.iter().all(|file| file.is_file()), "{files:?}");
    // `init` lists the recording once, and a project finds the files of the folder.
    let drive = tempfile::tempdir().unwrap();
    let copy = drive.path().join("bag");
    fs::create_dir(&copy).unwrap();
    for entry in fs::read_dir(&folder).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), copy.join(entry.file_name())).unwrap();
    }
    let made = boresight::pipeline::init(drive.path()).unwrap();
    assert_eq!(made.files.len(), 1);
    assert!(
        made.text.contains("file = \"bag/metadata.yaml#/topic\""),
        "{}",
        made.text
    );
    let text = r#"
        [frame]
        body = "FLU"
        [trajectory]
        file = "bag#/odom"
        [[scanner]]
        name = "left"
        profiles = "bag#/velodyne"
        translation_m = [0.0, 0.0, 0.0]
        rotation_deg = [0.0, 0.0, 0.0]
    "#;
    let project = Project::parse(text.to_owned(), &drive.path().join("project.toml")).unwrap();
    project.check_files().unwrap();
    let files = project.files().into_iter();
    let parts = files.filter(|file| file.ends_with("drive_1.db3.zstd"));
    assert_eq!(parts.count(), 2);
}

#[test]
fn the_noise_of_sensor_yaml_becomes_keys_of_the_project() {
    let folder = tempfile::tempdir().unwrap();
    let imu = folder.path().join("imu0");
    fs::create_dir(&imu).unwrap();
    let header = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],\
                  a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";
    let row = |i: u64| {
        format!(
            "{},0,0,0.1,0,0,9.8\n",
            1_700_000_000_000_000_000 + i * 5_000_000
        )
    };
    let rows: String = (0..200).map(row).collect();
    fs::write(imu.join("data.csv"), header.to_owned() + &rows).unwrap();
    // Noise of the data set, which is that of an ADIS16448.
    let noise = "sensor_type: imu\nrate_hz: 200\ngyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]\n\
                 gyroscope_random_walk: 1.9393e-05\naccelerometer_noise_density: 2.0000e-3\n\
                 accelerometer_random_walk: 3.0000e-3\n";
    fs::write(imu.join("sensor.yaml"), noise).unwrap();
    let made = boresight::pipeline::init(folder.path()).unwrap();
    for key in [
        "file = \"imu0/data.csv\"\n",
        "gyro_noise_deg_sqrt_h = 0.583317\n",
        "accel_noise_ug_sqrt_hz = 203.943\n",
        "gyro_bias_walk_rad_s_sqrt_s = 1.9393e-5\n",
        "accel_bias_walk_m_s2_sqrt_s = 0.003\n",
    ] {
        assert!(made.text.contains(key), "{}", made.text);
    }
    assert_eq!(made.files.len(), 2);
    assert_eq!(made.files[0].count, Some(200));
    let span_s = made.files[0].span_s.unwrap();
    assert!((span_s[1] - span_s[0] - 0.995).abs() < 1e-6);
    assert!(
        made.files[1].serves.contains("noise of the IMU"),
        "{:?}",
        made.files[1]
    );
}
