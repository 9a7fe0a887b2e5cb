//! Drives in the coordinates of a map, in projects that state no origin.

use std::fs;
use std::path::Path;

use boresight::format::read_cloud;
use boresight::geometry::Vec3;
use boresight::project::mountings;
use serde_json::{Value, json};

use super::transcript::replay;
use crate::common::{change_project, names, on_project, rewrite, rewrite_project, simulated};

/// UTM zone 32, near Bonn.
const SHIFT_M: [f64; 3] = [350_000.0, 5_600_000.0, 60.0];

/// The origin that a run chooses there.
const ORIGIN_M: [f64; 3] = [350_000.0, 5_600_000.0, 0.0];

/// Moves the positions of a table, in columns 1 to 3, to UTM coordinates.
fn to_utm(table: &Path) {
    rewrite(table, |text| {
        let (header, rows) = text.split_once('\n').unwrap();
        let rows = rows.lines().map(|row| {
            let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
            for (cell, shift_m) in cells[1..].iter_mut().zip(SHIFT_M) {
                *cell = (cell.parse::<f64>().unwrap() + shift_m).to_string();
            }
            cells.join(",") + "\n"
        });
        format!("{header}\n{}", rows.collect::<String>())
    });
}

/// Moves the reference of a simulated field to UTM coordinates, as a table.
fn reference_to_utm(drive: &Path) {
    let mut text = String::from("east_m,north_m,up_m\n");
    for point in read_cloud(&drive.join("../tls.laz")).unwrap().points {
        let [east, north, up] = (point + Vec3::from(SHIFT_M)).into();
        text += &format!("{east},{north},{up}\n");
    }
    fs::write(drive.join("tls.csv"), text).unwrap();
    change_project(drive, "../tls.laz", "tls.csv");
}

/// Asserts that a cloud lies at the place of the drive.
fn assert_in_utm(cloud: &Path) {
    let points = read_cloud(cloud).unwrap().points;
    assert!(points.len() > 1000);
    let far_m = points
        .iter()
        .map(|point| (point - Vec3::from(SHIFT_M)).norm());
    assert!(far_m.fold(0.0, f64::max) < 20.0);
}

#[test]
fn a_run_without_an_origin_chooses_one_and_says_so() {
    let (_temp, drive) = simulated();
    let local = on_project(
        &drive,
        "run",
        &["--out", drive.join("local").to_str().unwrap()],
    );
    assert_eq!(local.code, 0, "{}", local.err);
    assert!(!local.err.contains("no origin"), "{}", local.err);

    to_utm(&drive.join("prism.csv"));
    reference_to_utm(&drive);
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let said = "the project states no origin: [350000.0, 5600000.0, 0.0] m is used";
    assert_eq!(run.err.matches(said).count(), 1, "{}", run.err);

    let out = drive.join("out");
    let result: Value =
        serde_json::from_slice(&fs::read(out.join("result.json")).unwrap()).unwrap();
    assert_eq!(result["origin_m"], json!(ORIGIN_M));
    let written = fs::read_to_string(out.join("project.toml")).unwrap();
    assert!(
        written.contains("origin_m = [350000.0, 5600000.0, 0.0]"),
        "{written}"
    );
    assert_in_utm(&out.join("cloud-left.laz"));
    assert_in_utm(&out.join("cloud-right.laz"));
    let [here, there] = ["local", "out"].map(|folder| {
        mountings(&drive.join(folder).join("calibration.toml"))
            .unwrap()
            .scanners
    });
    for ((name, here), (_, there)) in here.iter().zip(&there) {
        let (turn, shift) = there.perturbation_from(here);
        assert!(
            turn.norm() < 1e-5 && shift.norm() < 1e-5,
            "{name}: {turn} {shift}"
        );
    }
    let poses = fs::read_to_string(out.join("trajectory.csv")).unwrap();
    let first = poses.lines().nth(1).unwrap();
    assert!(
        first.contains(",34999") && first.contains(",560000"),
        "{first}"
    );
}

#[test]
fn each_command_chooses_an_origin_and_clouds_follow_the_data_of_any_origin() {
    let (_temp, drive) = simulated();
    to_utm(&drive.join("prism.csv"));
    rewrite_project(&drive, |text| {
        text.replace("[reference]\nfile = \"../tls.laz\"\n", "")
    });
    for command in ["trajectory", "calibrate", "georeference"] {
        let run = on_project(&drive, command, &[]);
        assert_eq!(run.code, 0, "{command}: {}", run.err);
        assert!(
            run.err.contains("states no origin"),
            "{command}: {}",
            run.err
        );
    }
    assert_in_utm(&drive.join("out/cloud-left.laz"));
    // An origin that is far from the data: a slip, or that of another field.
    change_project(
        &drive,
        "body = \"FRD\"\n",
        "body = \"FRD\"\norigin_m = [1.0, 2.0, 3.0]\n",
    );
    let elsewhere = drive.join("elsewhere");
    let run = on_project(
        &drive,
        "georeference",
        &["--out", elsewhere.to_str().unwrap()],
    );
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(!run.err.contains("states no origin"), "{}", run.err);
    assert_in_utm(&elsewhere.join("cloud-left.laz"));
    assert_eq!(
        names(&elsewhere),
        ["cloud-left.laz", "cloud-right.laz", "log.txt"]
    );
}

#[test]
fn logs_in_utm_with_foreign_headers_reach_a_result_by_the_advice_of_the_terminal() {
    let (_temp, drive) = simulated();
    fs::remove_file(drive.join("project.toml")).unwrap();
    to_utm(&drive.join("prism.csv"));
    let [known, foreign] = [
        "time_s,east_m,north_m,up_m",
        "Zeit,Rechtswert,Hochwert,Hoehe",
    ];
    rewrite(&drive.join("prism.csv"), |text| {
        text.replace(known, foreign)
    });
    replay("utm.txt", drive.parent().unwrap());
    assert_in_utm(&drive.join("out/cloud-left.laz"));
    assert!(drive.join("out/calibration.toml").is_file());
}
