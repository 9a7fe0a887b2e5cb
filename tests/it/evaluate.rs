//! `boresight evaluate`: absolute and relative errors of a trajectory in files of several formats.

use std::fs;
use std::path::Path;

use boresight::format;
use boresight::geometry::so3::exp;
use boresight::geometry::{Vec3, WorldFromBody};
use boresight::sensor::PoseRecord;
use serde_json::Value;

use crate::common::boresight_at;

/// Twenty seconds at 20 Hz around a bend, turned about the vertical by `turn_rad`, moved by 10 m, and up by 3 mm in
/// every other pose.
fn drive(turn_rad: f64, wobble_m: f64) -> Vec<PoseRecord> {
    let turn = exp(&Vec3::new(0.0, 0.0, turn_rad));
    let pose = |i: u32| {
        let t = 0.05 * f64::from(i);
        let up_m = if i.is_multiple_of(2) {
            wobble_m
        } else {
            -wobble_m
        };
        let position = Vec3::new(2.0 * t, 3.0 * (0.4 * t).sin(), 0.2 * t.cos() + up_m);
        let rotation = turn * exp(&Vec3::new(0.0, 0.0, 0.3 * t));
        let shift = Vec3::new(10.0 * turn_rad.signum(), 0.0, 0.0);
        PoseRecord::new(
            500.0 + t,
            WorldFromBody::new(rotation, turn * position + shift),
        )
    };
    (0..400).map(pose).collect()
}

fn evaluated(folder: &Path, files: [&str; 2], more: &[&str]) -> (Value, String) {
    let arguments = [&["evaluate"], &files[..], &["--out", "out"], more].concat();
    let run = boresight_at(folder, &arguments);
    assert_eq!(run.code, 0, "{}{}", run.out, run.err);
    let json = boresight_at(folder, &[&arguments[..], &["--json"]].concat());
    (serde_json::from_str(&json.out).unwrap(), run.out)
}

#[test]
fn trajectories_of_all_formats_are_evaluated() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    format::write_trajectory(&at("reference.csv"), &drive(0.0, 0.0)).unwrap();
    format::write_tum(&at("estimate.tum"), &drive(0.7, 0.003)).unwrap();
    format::write_trajectory(&at("estimate.parquet"), &drive(0.7, 0.003)).unwrap();
    for estimate in ["estimate.tum", "estimate.parquet"] {
        let files = [estimate, "reference.csv"];
        for align in ["se3", "yaw"] {
            let (result, summary) = evaluated(temp.path(), files, &["--align", align]);
            let ate = &result["ate"];
            let rmse_m = ate["translation_m"]["rmse"].as_f64().unwrap();
            assert!((rmse_m - 0.003).abs() < 1e-5, "{align}: {result}");
            assert!(
                ate["rotation_deg"]["max"].as_f64().unwrap() < 0.01,
                "{result}"
            );
            assert_eq!(result["n"], 400);
            assert!(summary.contains("ATE, translation (mm)"), "{summary}");
            assert!(
                summary.contains("RPE over 1 s, translation (mm)"),
                "{summary}"
            );
        }
        // Poses an even number of intervals apart have the same wobble, an odd number twice.
        let (result, _) = evaluated(temp.path(), files, &["--over-s", "0.05"]);
        let relative_m = result["rpe"]["translation_m"]["mean"].as_f64().unwrap();
        assert!((relative_m - 0.006).abs() < 1e-5, "{result}");
        let (result, _) = evaluated(temp.path(), files, &["--over-m", "5"]);
        assert_eq!(result["rpe"]["over_m"], 5.0);
    }
    let files = ["estimate.tum", "reference.csv"];
    let (result, _) = evaluated(temp.path(), files, &["--align", "none"]);
    let rotation_deg = result["ate"]["rotation_deg"]["mean"].as_f64().unwrap();
    assert!(
        (rotation_deg - 0.7f64.to_degrees()).abs() < 0.01,
        "{result}"
    );
    let table = fs::read_to_string(at("out/trajectory-errors.csv")).unwrap();
    assert_eq!(table.lines().count(), 401);
    let page = fs::read_to_string(at("out/evaluation.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("ATE, translation"));
    // The name that other programs use.
    let run = boresight_at(
        temp.path(),
        &["compare-trajectories", files[0], files[1], "--out", "out"],
    );
    assert_eq!(run.code, 0, "{}", run.err);
}

#[test]
fn trajectories_without_common_time_are_refused_with_the_remedy() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    let late: Vec<PoseRecord> = drive(0.0, 0.0)
        .iter()
        .map(|pose| PoseRecord::new(pose.time_s + 100.0, pose.world_from_body))
        .collect();
    format::write_trajectory(&at("a.csv"), &late).unwrap();
    format::write_tum(&at("b.tum"), &drive(0.0, 0.0)).unwrap();
    let run = boresight_at(temp.path(), &["evaluate", "a.csv", "b.tum"]);
    assert!(
        run.code == 1 && run.err.contains("--time-offset-s"),
        "{}",
        run.err
    );
    let (result, _) = evaluated(
        temp.path(),
        ["a.csv", "b.tum"],
        &["--time-offset-s", "-100"],
    );
    assert!(
        result["ate"]["translation_m"]["max"].as_f64().unwrap() < 1e-5,
        "{result}"
    );
}
