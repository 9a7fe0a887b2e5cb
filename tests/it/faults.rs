//! Bad input ends in one clear error, tested with the real binary.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{
    Run, boresight, change_project, on_project, project_of_logs, replace_logs, rewrite_project,
};

/// Rewrites the log `name`, whose rows start with a time, row by row.
fn change_rows(folder: &Path, name: &str, change: impl Fn(usize, &str) -> String) {
    let path = folder.join(name);
    let text = fs::read_to_string(&path).unwrap();
    let mut changed = String::new();
    for (index, line) in text.lines().enumerate() {
        let line = if index == 0 {
            line.to_owned()
        } else {
            change(index + 1, line)
        };
        let _ = writeln!(changed, "{line}");
    }
    fs::write(path, changed).unwrap();
}

fn shift_times(folder: &Path, name: &str, shift_s: f64) {
    change_rows(folder, name, |_, line| {
        let (time, rest) = line.split_once(',').unwrap();
        format!("{:.3},{rest}", time.parse::<f64>().unwrap() + shift_s)
    });
}

/// Asserts that the run failed with one error that contains every one of `expected`, and left no result.
fn assert_one_error(folder: &Path, run: &Run, expected: &[&str]) {
    assert_failed_once(run, expected);
    for result in RESULTS {
        assert!(!folder.join("out").join(result).exists(), "{result}");
    }
}

/// As [`assert_one_error`], of a run that failed with its scans and keeps the trajectory.
fn assert_trajectory_kept(folder: &Path, run: &Run, expected: &[&str]) {
    assert_failed_once(run, expected);
    for result in RESULTS {
        let is_kept = ["trajectory.csv", "report.html"].contains(&result);
        assert_eq!(
            folder.join("out").join(result).exists(),
            is_kept,
            "{result}"
        );
    }
}

const RESULTS: [&str; 4] = [
    "result.json",
    "trajectory.csv",
    "calibration.toml",
    "report.html",
];

fn assert_failed_once(run: &Run, expected: &[&str]) {
    run.assert_failed_with(expected);
    assert_eq!(run.err.matches("error: ").count(), 1, "{}", run.err);
}

#[test]
fn a_prism_log_that_does_not_overlap_the_imu_is_named_with_the_gap() {
    let folder = project_of_logs();
    shift_times(folder.path(), "prism.csv", 1000.0);
    for command in ["trajectory", "run"] {
        // The IMU ends at 29.98 s, the prism starts at 1000.01 s.
        let run = on_project(folder.path(), command, &[]);
        assert_one_error(
            folder.path(),
            &run,
            &["do not overlap", "the gap is 970.0", "time_offset_s"],
        );
    }
}

#[test]
fn a_time_offset_in_the_project_makes_the_logs_overlap() {
    let folder = project_of_logs();
    shift_times(folder.path(), "prism.csv", 1000.0);
    let with_offset = "file = \"prism.csv\"\ntime_offset_s = -1000.0";
    change_project(folder.path(), "file = \"prism.csv\"", with_offset);
    let run = on_project(folder.path(), "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(folder.path().join("out/trajectory.csv").exists());
}

#[test]
fn profiles_outside_the_trajectory_are_named_with_the_scanner() {
    let folder = project_of_logs();
    shift_times(folder.path(), "left.csv", 500.0);
    for command in ["calibrate", "georeference", "run"] {
        let run = on_project(folder.path(), command, &[]);
        let expected = ["left", "do not overlap", "time_offset_s"];
        match command {
            "run" => assert_trajectory_kept(folder.path(), &run, &expected),
            _ => assert_one_error(folder.path(), &run, &expected),
        }
    }
}

#[test]
fn an_empty_cloud_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (full, empty) = (
        folder.path().join("full.csv"),
        folder.path().join("empty.csv"),
    );
    let header = "east_m, north_m, up_m\n";
    let mut plane = header.to_owned();
    for i in 0..400 {
        let _ = writeln!(
            plane,
            "{:.2}, {:.2}, 0",
            f64::from(i / 20) * 0.01,
            f64::from(i % 20) * 0.01
        );
    }
    fs::write(&full, plane).unwrap();
    for content in ["", header] {
        fs::write(&empty, content).unwrap();
        for pair in [[&full, &empty], [&empty, &full]] {
            let run = boresight(&[
                "compare",
                pair[0].to_str().unwrap(),
                pair[1].to_str().unwrap(),
            ]);
            assert_one_error(folder.path(), &run, &["empty.csv"]);
        }
    }
}

#[test]
fn a_reference_without_points_is_named() {
    let folder = project_of_logs();
    rewrite_project(folder.path(), |text| {
        format!("{text}\n[reference]\nfile = \"tls.csv\"\n")
    });
    fs::write(folder.path().join("tls.csv"), "east_m, north_m, up_m\n").unwrap();
    let run = on_project(folder.path(), "run", &[]);
    assert_one_error(folder.path(), &run, &["tls.csv"]);
}

#[test]
fn a_value_that_is_not_a_number_is_named_with_its_line() {
    for (name, line) in [("imu.csv", 700), ("prism.csv", 77), ("left.csv", 5000)] {
        let run_with = |value: &str| {
            let folder = project_of_logs();
            change_rows(folder.path(), name, |number, row| {
                if number == line {
                    let (rest, _) = row.rsplit_once(',').unwrap();
                    format!("{rest}, {value}")
                } else {
                    row.to_owned()
                }
            });
            let run = on_project(folder.path(), "run", &[]);
            (folder, run)
        };
        for wrong in ["inf", "1.2.3"] {
            let (folder, run) = run_with(wrong);
            let place = format!("{name}, line {line}: ");
            match name {
                "left.csv" => assert_trajectory_kept(folder.path(), &run, &[&place]),
                _ => assert_one_error(folder.path(), &run, &[&place]),
            }
        }
        for missing in ["nan", ""] {
            let (_folder, run) = run_with(missing);
            assert_eq!(run.code, 0, "{}", run.err);
            let left_out = format!("needed left out: 1, the first in line {line}");
            assert!(run.err.contains(&left_out), "{name} {missing}: {}", run.err);
        }
    }
}

#[test]
fn a_pose_out_of_the_order_of_time_is_left_out_and_named() {
    let folder = project_of_logs();
    let run = on_project(folder.path(), "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    fs::rename(
        folder.path().join("out/trajectory.csv"),
        folder.path().join("poses.csv"),
    )
    .unwrap();
    change_rows(folder.path(), "poses.csv", |number, row| {
        let (_, rest) = row.split_once(',').unwrap();
        if number == 90 {
            format!("0.5,{rest}")
        } else {
            row.to_owned()
        }
    });
    replace_logs(folder.path(), "[trajectory]\nfile = \"poses.csv\"\n");
    let run = on_project(folder.path(), "georeference", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(
        run.err.contains("1 out of the order of time"),
        "{}",
        run.err
    );
}

#[test]
fn a_log_that_ends_in_the_middle_of_a_row_is_named() {
    let folder = project_of_logs();
    let path = folder.path().join("imu.csv");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
    let run = on_project(folder.path(), "trajectory", &[]);
    assert_one_error(folder.path(), &run, &["imu.csv, line 1501"]);
}

/// A run ends by itself, whatever the data; here within a minute.
#[test]
fn a_run_on_a_scene_that_determines_nothing_ends() {
    let folder = project_of_logs();
    let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .args([
            "run",
            folder.path().join("project.toml").to_str().unwrap(),
            "--quiet",
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > Duration::from_secs(60) {
            child.kill().unwrap();
            panic!("still running after a minute");
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(matches!(status.code(), Some(0 | 1)), "{status:?}");
}
