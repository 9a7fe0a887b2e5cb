//! Which verdicts on a result are shown where, through the real binary.

use std::fs;
use std::path::Path;

use crate::common::{on_project, rewrite_project, simulated};
use serde_json::Value;

/// Renames columns in the header of a log.
fn rename(folder: &Path, log: &str, names: &[(&str, &str)]) {
    let path = folder.join(log);
    let text = fs::read_to_string(&path).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let header: Vec<&str> = header
        .split(',')
        .map(|name| {
            names
                .iter()
                .find(|(from, _)| *from == name)
                .map_or(name, |(_, to)| to)
        })
        .collect();
    fs::write(&path, format!("{}\n{rows}", header.join(","))).unwrap();
}

fn codes(document: &Value) -> Vec<String> {
    let all = document["verdicts"].as_array().unwrap().iter();
    all.map(|verdict| verdict["code"].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn a_fault_is_printed_first_and_exits_with_3_under_strict() {
    let (_temp, drive) = simulated();
    let exchanged = [
        ("gyro_x_rad_s", "gyro_z_rad_s"),
        ("gyro_z_rad_s", "gyro_x_rad_s"),
        ("accel_x_m_s2", "accel_z_m_s2"),
        ("accel_z_m_s2", "accel_x_m_s2"),
    ];
    rename(&drive, "imu.csv", &exchanged);
    let run = on_project(&drive, "inspect", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let first = "result: not usable\n\n! According to gravity, the x axis of the IMU is vertical";
    assert!(run.out.starts_with(first), "{}", run.out);
    assert_eq!(on_project(&drive, "inspect", &["--strict"]).code, 3);
    let run = on_project(&drive, "inspect", &["--json"]);
    let document: Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(document["files"][0]["headline"], "unusable");
    assert_eq!(codes(&document["files"][0]), ["frame.body"]);
}

#[test]
fn wrong_units_are_refused_before_the_work_and_named_units_are_converted() {
    let (_temp, drive) = simulated();
    let names =
        ["x", "y", "z"].map(|axis| (format!("gyro_{axis}_rad_s"), format!("gyro_{axis}_deg_s")));
    let names = names
        .each_ref()
        .map(|(from, to)| (from.as_str(), to.as_str()));
    let path = drive.join("imu.csv");
    let plain = fs::read_to_string(&path).unwrap();
    let (header, rows) = plain.split_once('\n').unwrap();
    let rows = rows.lines().map(|row| {
        let cells = row.split(',').enumerate().map(|(i, cell)| match i {
            1..=3 => cell.parse::<f64>().unwrap().to_degrees().to_string(),
            _ => cell.to_owned(),
        });
        cells.collect::<Vec<_>>().join(",") + "\n"
    });
    fs::write(&path, format!("{header}\n{}", rows.collect::<String>())).unwrap();
    let run = on_project(&drive, "trajectory", &[]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("gyro_x_deg_s"), "{}", run.err);
    assert!(!drive.join("out/trajectory.csv").exists());
    rename(&drive, "imu.csv", &names);
    let run = on_project(&drive, "trajectory", &["--json"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let document: Value = serde_json::from_str(&run.out).unwrap();
    assert!(codes(&document).contains(&"trajectory.convergence".to_owned()));
}

#[test]
fn a_result_to_use_with_care_is_marked_in_the_calibration_file() {
    let (_temp, drive) = simulated();
    rewrite_project(&drive, |text| {
        text.to_owned() + "\n[acceptance]\nsigma_translation_m = 1e-6\n"
    });
    let run = on_project(&drive, "calibrate", &["--json"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let document: Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(document["headline"], "care");
    assert!(codes(&document).contains(&"mounting.sigma".to_owned()));
    let written = fs::read_to_string(drive.join("out/calibration.toml")).unwrap();
    assert!(written.starts_with("# usable with care\n# ! "), "{written}");
    let again = on_project(
        &drive,
        "georeference",
        &["--out", drive.join("clouds").to_str().unwrap()],
    );
    assert_eq!(again.code, 0, "{}", again.err);
    assert!(
        again.out.contains("calibration.toml is newer"),
        "{}",
        again.out
    );
}
