//! Text logs and poses as people have them.

use std::fs;
use std::path::{Path, PathBuf};

use boresight::format::{self, Input, inspect};
use boresight::geometry::{BodyAxes, Projection};
use boresight::pipeline::{OpenProject, stages};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::sensor::{FixQuality, Observations, PoseRecord};
use boresight::simulation::{Scenario, simulate};

use crate::common::{boresight, data, on_project, project_of_logs};

/// A sample file.
pub fn sample(name: &str) -> PathBuf {
    data("field_cases").join(name)
}

/// The notes of an inspection, one below the other.
pub fn notes(path: &Path) -> String {
    inspect(path).unwrap().notes.join("\n")
}

fn positions(name: &str) -> (boresight::sensor::Positions, String) {
    let input = Input::from(&sample(name));
    let crs = Projection::new("EPSG:25832").unwrap();
    let read = format::read_projected_positions(&input, &Observations::AsFound, Some(&crs));
    (read.unwrap(), input.remarks().join("\n"))
}

fn poses(name: &str) -> (Vec<PoseRecord>, String) {
    let input = Input::from(&sample(name));
    (
        format::read_trajectory(&input).unwrap(),
        input.remarks().join("\n"),
    )
}

const GNSS: &str = r#"
[frame]
crs = "EPSG:25832"
origin_m = [352000.0, 5646000.0, 100.0]
[imu]
file = "imu.csv"
[gnss]
file = "gnss.nmea"
sigma_m = 0.005
lever_arm_m = [0.1, 0.05, -0.55]
[heading]
file = "heading.csv"
"#;

#[test]
fn float_solutions_never_count_as_fixed_ones() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = Scenario::demo();
    scenario.drives.truncate(1);
    // Only the logs are read.
    scenario.profiles.rate_hz = 1.0;
    (
        scenario.reference.board_spacing_m,
        scenario.reference.soil_spacing_m,
    ) = (0.1, 0.1);
    let files = simulate(&scenario, folder.path(), &Silent).unwrap();
    let drive = &files.drives[0].folder;
    fs::copy(
        sample("nmea-rtk-quality/gnss.nmea"),
        drive.join("gnss.nmea"),
    )
    .unwrap();
    let project = Project::parse(GNSS.to_owned(), &drive.join("gnss.toml")).unwrap();
    let truth = format::read_trajectory(drive.join("truth/trajectory.csv").as_path()).unwrap();
    let estimated = stages::poses(&OpenProject::new(&project), &Silent).unwrap();
    let nodes = estimated.trajectory().poses();
    let mut squares = 0.0;
    for (node, truth) in nodes.iter().zip(&truth) {
        assert!((node.time_s - truth.time_s).abs() < 1e-9);
        let at_m = truth.world_from_body.translation_m;
        let error_m = (node.world_from_body.translation_m - at_m).norm();
        let sigma_m = node.sigma.unwrap().position_m.norm();
        assert!(error_m < 4.0 * sigma_m, "{error_m} {sigma_m}");
        squares += error_m * error_m;
    }
    let rms_m = (squares / nodes.len() as f64).sqrt();
    assert!(rms_m < 0.010, "{rms_m}");

    let (found, _) = positions("nmea-rtk-quality/gnss.nmea");
    let floats = found.qualities.iter().filter(|q| **q == FixQuality::Float);
    assert_eq!((found.fixes.len(), floats.count()), (2347, 210));
    let notes = notes(&sample("nmea-rtk-quality/gnss.nmea"));
    assert!(notes.contains("2137 fixed, 210 float"), "{notes}");
}

#[test]
fn accuracies_of_gst_are_those_of_their_position() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nmea");
    let gga = |time: &str| format!("$GNGGA,{time},5043.5,N,00705.5,E,5,17,0.7,104.5,M,47.1,M,,\n");
    let gst = |time: &str| format!("$GNGST,{time},0.1,0.1,0.1,0,0.2,0.3,0.4\n");
    let text = [
        gga("120000"),
        gst("120000"),
        gst("120001"),
        gga("120001"),
        gga("120002"),
    ];
    fs::write(&path, text.concat()).unwrap();
    let crs = Projection::new("EPSG:25832").unwrap();
    let read = format::read_projected_positions(&path, &Observations::AsFound, Some(&crs)).unwrap();
    let up_m = |i: usize| read.fixes[i].covariance_m2.map(|c| c.m33.sqrt());
    assert!((up_m(0).unwrap() - 0.4).abs() < 1e-12);
    assert!((up_m(1).unwrap() - 0.4).abs() < 1e-12);
    assert_eq!(up_m(2), None);
}

#[test]
fn a_date_before_the_receiver_knew_it_is_left_out() {
    let (found, remarks) = positions("nmea-date-before-fix/zda_gps_before_fix.nmea");
    let times_s: Vec<f64> = found.fixes.iter().map(|fix| fix.time_s).collect();
    assert_eq!(times_s, [1_691_572_511.0]);
    assert!(
        remarks.contains("1 dated before the receiver knew the date"),
        "{remarks}"
    );
}

#[test]
fn sentences_with_a_wrong_checksum_are_counted() {
    let (found, remarks) = positions("nmea-checksum/corrupt.nmea");
    assert_eq!(found.fixes.len(), 40);
    assert!(remarks.contains("20 with a wrong checksum"), "{remarks}");
    let run = boresight(&[
        "inspect",
        sample("nmea-checksum/corrupt.nmea").to_str().unwrap(),
    ]);
    assert!(run.out.contains("20 with a wrong checksum"), "{}", run.out);
}

#[test]
fn a_missing_geoid_separation_is_named() {
    let path = sample("nmea_no_geoid/ge.nmea");
    boresight(&["inspect", path.to_str().unwrap()]).assert_failed_with(&[
        "5 positions (GGA) without the separation of geoid and ellipsoid",
        "set the receiver to write it",
    ]);
}

#[test]
fn euroc_without_its_header_has_nanoseconds_and_the_scalar_first() {
    let (found, remarks) = poses("euroc_headerless/e8nh.csv");
    assert_eq!(found.len(), 5);
    assert_eq!(
        found[1].time_s - found[0].time_s,
        1_700_000_000.1 - 1_700_000_000.0
    );
    let rotation = found[0].world_from_body.rotation;
    assert!((rotation.w - 0.7302967).abs() < 1e-7 && (rotation.i - 0.1825742).abs() < 1e-7);
    assert!(remarks.contains("there is no header"), "{remarks}");
    // The same numbers between blanks are those of TUM in nanoseconds.
    let (found, remarks) = poses("tum_headed/ns.tum");
    assert_eq!(found[0].time_s, 1.7e9);
    assert!((found[0].world_from_body.rotation.w - 0.7302967).abs() < 1e-7);
    assert!(remarks.contains("units of 1e-9 s"), "{remarks}");
    let (found, _) = poses("tum/tum3.txt");
    assert!((found[0].time_s - 1_403_636_579.763_555_5).abs() < 1e-6);
}

#[test]
fn impossible_times_and_coordinates_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, text: &str, expected: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        boresight(&["inspect", path.to_str().unwrap()]).assert_failed_with(&[expected]);
    };
    let row = "1700000000000000000 1 2 3 4 5\n";
    refused("wide.txt", &row.repeat(3), "a coordinate of 1.7e18 m");
    refused(
        "heading.csv",
        "time_s,heading_deg\n1700000000000000000,1\n",
        "1.7e18 s: nanoseconds?",
    );
    refused(
        "points.csv",
        "east_m,north_m,up_m\n1,2e12,3\n",
        "a coordinate of 2e12 m",
    );
}

#[test]
fn headers_of_poses_name_their_columns() {
    for (name, count, w) in [
        ("tum_headed/hw.csv", 5, 0.7302967),
        ("tum/tum1.txt", 2, 1.0),
        ("tum/tum4.csv", 2, 1.0),
        ("formats-refused/geoslam_traj.txt", 2, 1.0),
        ("formats-refused/geoslam_h.txt", 2, 1.0),
    ] {
        let (found, _) = poses(name);
        assert_eq!(found.len(), count, "{name}");
        assert!(
            (found[0].world_from_body.rotation.w - w).abs() < 1e-7,
            "{name}"
        );
    }
}

#[test]
fn poses_with_a_repeated_time_or_without_numbers_are_left_out_and_counted() {
    for (name, count, expected) in [
        (
            "dup_poses/dup.tum",
            5,
            "1 of 6 poses left out: 1 with the time",
        ),
        ("dup_poses/nan.tum", 5, "left out: 1, the first in line 6"),
        (
            "dup_poses/o2.bag",
            4,
            "1 of 5 poses left out: 1 with the time",
        ),
    ] {
        let (found, remarks) = poses(name);
        assert_eq!(found.len(), count, "{name}");
        assert!(remarks.contains(expected), "{name}: {remarks}");
    }
}

#[test]
fn the_height_of_the_reflector_is_added() {
    for (name, up_m) in [("gsi1.gsi", 96.777), ("prism_hr1.5.gsi", 2.546)] {
        let path = sample("gsi-reflector-height").join(name);
        let input = Input::from(&path);
        let found = format::read_positions(&input, &Observations::AsFound).unwrap();
        assert!((found.fixes[0].position_m.z - up_m).abs() < 1e-9, "{name}");
        let remarks = input.remarks().join("\n");
        assert!(remarks.contains("word 87"), "{remarks}");
    }
}

#[test]
fn the_end_of_file_of_dos_is_no_line() {
    let text = fs::read(sample("gsi-reflector-height/gsi1.gsi")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gsi");
    fs::write(&path, [&text[..], b"\x1a"].concat()).unwrap();
    let found = format::read_positions(&path, &Observations::AsFound).unwrap();
    assert_eq!(found.fixes.len(), 2);
    // This one holds angles and a distance without a time.
    let path = sample("gsi-ctrl-z/gsi3.gsi");
    boresight(&["inspect", path.to_str().unwrap()]).assert_failed_with(&["words 81, 82 and 83"]);
}

/// Subtracts a number from the first column of a table, modulo a week.
fn on_another_week(path: &Path, by_s: f64) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let mut out = format!("{}\n", lines.next().unwrap());
    for line in lines {
        let (time, rest) = line.split_once(',').unwrap();
        let time_s: f64 = time.trim().parse().unwrap();
        out += &format!("{:.3},{rest}\n", (time_s - by_s).rem_euclid(604_800.0));
    }
    fs::write(path, out).unwrap();
}

#[test]
fn seconds_of_the_week_that_start_again_are_continued_and_named() {
    let folder = project_of_logs();
    let folder = folder.path();
    // The week ends in the middle of the drive. The prism is tracked only after that.
    let prism = fs::read_to_string(folder.join("prism.csv")).unwrap();
    let (header, rows) = prism.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().skip(80).collect();
    fs::write(
        folder.join("prism.csv"),
        format!("{header}\n{}\n", rows.join("\n")),
    )
    .unwrap();
    for name in ["imu.csv", "prism.csv", "left.csv"] {
        on_another_week(&folder.join(name), 15.0);
    }
    let run = on_project(folder, "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for expected in [
        "imu: the times start again at 0 after 604799.98 s",
        "prism: the log and that of the IMU lie on both sides",
        "604800 s are added",
    ] {
        assert!(run.err.contains(expected), "{expected}\n{}", run.err);
    }
    // Points before and after the end of the week are placed on the poses.
    let table = folder.join("out/trajectory.csv");
    let kept = format::read_trajectory(&table).unwrap();
    assert!(kept[0].time_s < 604_800.0 && kept[kept.len() - 1].time_s > 604_800.0);
    let notes = notes(&folder.join("imu.csv"));
    assert!(notes.contains("they are continued past that"), "{notes}");
}

#[test]
fn poses_of_the_week_are_continued() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tum");
    let text =
        "604799.8 0 0 0 0 0 0 1\n604799.9 1 0 0 0 0 0 1\n0 2 0 0 0 0 0 1\n0.1 3 0 0 0 0 0 1\n";
    fs::write(&path, text).unwrap();
    let input = Input::from(&path);
    let found = format::read_trajectory(&input).unwrap();
    assert_eq!(found[3].time_s, 604_800.1);
    assert!(
        input
            .remarks()
            .join("")
            .contains("start again at 0 after 604799.9 s")
    );
    let sbet = folder.path().join("a.sbet");
    let crs = Projection::new("EPSG:25832").unwrap();
    let at = |i: usize| boresight::geometry::Vec3::new(364e3 + i as f64, 5_621e3, 100.0);
    let mut poses = found.clone();
    for (i, (pose, time_s)) in poses
        .iter_mut()
        .zip([604_799.8, 604_799.9, 604_800.0, 604_800.1])
        .enumerate()
    {
        pose.time_s = time_s;
        pose.world_from_body.translation_m = at(i);
    }
    format::write_sbet(&sbet, &poses, &crs).unwrap();
    let mut bytes = fs::read(&sbet).unwrap();
    for (record, time_s) in [(2, 0.0f64), (3, 0.1)] {
        bytes[record * 136..record * 136 + 8].copy_from_slice(&time_s.to_le_bytes());
    }
    fs::write(&sbet, bytes).unwrap();
    let found = format::read_projected_trajectory(&sbet, BodyAxes::Flu, Some(&crs)).unwrap();
    assert_eq!(found[3].time_s, 604_800.1);
}

#[test]
fn the_epochs_of_clocks_are_named() {
    let folder = project_of_logs();
    let path = folder.path().join("prism.csv");
    let text = fs::read_to_string(&path).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let rows = rows.lines().map(|row| {
        let (time, rest) = row.split_once(',').unwrap();
        format!(
            "{},{rest}\n",
            time.trim().parse::<f64>().unwrap() + 1_315_964_782.0
        )
    });
    fs::write(&path, format!("{header}\n{}", rows.collect::<String>())).unwrap();
    on_project(folder.path(), "trajectory", &[])
        .assert_failed_with(&["1315964782 s between Unix time and adjusted GPS time"]);
}
