//! `georeference` with the mountings and poses of an earlier run.

use std::fs;
use std::path::Path;

use crate::common::{
    self, boresight, on_project, project_of_logs, refused, rewrite_project, simulated,
};
use boresight::format;
use serde_json::Value;

const CLOUDS: [&str; 2] = ["cloud-left.laz", "cloud-right.laz"];

/// Whether the clouds in `a` have the bytes of those in `b`.
fn same_clouds(a: &Path, b: &Path) -> [bool; 2] {
    CLOUDS.map(|name| fs::read(a.join(name)).unwrap() == fs::read(b.join(name)).unwrap())
}

#[test]
fn the_results_of_a_run_give_its_clouds_again() {
    let (_temp, drive) = simulated();
    // Far from the origin, which shows whether it is applied exactly once.
    rewrite_project(&drive, |text| {
        assert!(!text.contains("origin_m"));
        text.replace("[frame]\n", "[frame]\norigin_m = [-1000, 250, 12.5]\n")
    });
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let out = drive.join("out");
    let (calibration, trajectory) = (out.join("calibration.toml"), out.join("trajectory.csv"));
    let given = |more: &[&str]| {
        let again = drive.join("again");
        let more = [more, &["--out", again.to_str().unwrap()]].concat();
        let run = on_project(&drive, "georeference", &more);
        assert_eq!(run.code, 0, "{}", run.err);
        (same_clouds(&out, &again), run.out)
    };
    let calibration = calibration.to_str().unwrap();
    let trajectory = trajectory.to_str().unwrap();
    let with_mountings = ["--calibration", calibration];
    let with_poses = ["--trajectory", trajectory];

    let (same, output) = given(&[with_mountings, with_poses].concat());
    assert_eq!(same, [true; 2]);
    let expected = format!(
        "2 clouds, placed with the mountings of {calibration}, on the poses of {trajectory}\n"
    );
    assert!(output.contains(&expected), "{output}");
    let (same, output) = given(&with_mountings);
    assert_eq!(same, [true; 2]);
    assert!(
        output.contains("on the trajectory estimated from its logs"),
        "{output}"
    );
    let (same, output) = given(&with_poses);
    assert_eq!(same, [false; 2]);
    assert!(output.contains("with the project's mountings"), "{output}");
    let (same, _) = given(&[]);
    assert_eq!(same, [false; 2]);

    // As on another drive of the same robot: without logs, and with the scanners in another order.
    let logs = ["imu.csv", "prism.csv", "heading.csv"];
    for log in logs {
        fs::remove_file(drive.join(log)).unwrap();
    }
    rewrite_project(&drive, |text| {
        let (left, right) = (
            text.find("[[scanner]]").unwrap(),
            text.rfind("[[scanner]]").unwrap(),
        );
        let end = text.find("[reference]").unwrap();
        let (head, tail) = (&text[..left], &text[end..]);
        let (left, right) = (&text[left..right], &text[right..end]);
        format!("{head}{right}\n{left}\n{tail}")
    });
    let more = [&with_mountings[..], &with_poses, &["--json"]].concat();
    let (same, output) = given(&more);
    // The numbers of the scanners differ, so the bytes differ; the points are the same.
    assert_eq!(same, [false; 2]);
    for name in CLOUDS {
        let [before, after] = [&out, &drive.join("again")]
            .map(|folder| format::read_cloud(&folder.join(name)).unwrap().points);
        assert_eq!(before, after, "{name}");
    }
    let output: Value = serde_json::from_str(&output).unwrap();
    assert_eq!(output["mountings_from"], calibration);
    assert_eq!(output["poses_from"], trajectory);
    assert!(output["clouds"][0].as_str().unwrap().ends_with(CLOUDS[1]));
}

#[test]
fn time_offsets_are_taken_from_the_calibration() {
    let (_temp, drive) = simulated();
    let run = on_project(&drive, "calibrate", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let calibration = drive.join("out/calibration.toml");
    let poses = drive.join("truth/trajectory.csv");
    let georeferenced = |out: &str| {
        let out = drive.join(out);
        let run = on_project(
            &drive,
            "georeference",
            &[
                "--calibration",
                calibration.to_str().unwrap(),
                "--trajectory",
                poses.to_str().unwrap(),
                "--verbose",
                "--out",
                out.to_str().unwrap(),
            ],
        );
        assert_eq!(run.code, 0, "{}", run.err);
        (out, run.err)
    };
    let (plain, output) = georeferenced("plain");
    assert!(!output.contains("time offset"), "{output}");
    common::rewrite(&calibration, |text| {
        let right = text.rfind("time_offset_s = 0.0").unwrap();
        format!(
            "{}time_offset_s = 0.25{}",
            &text[..right],
            &text[right + "time_offset_s = 0.0".len()..]
        )
    });
    let (later, output) = georeferenced("later");
    assert_eq!(same_clouds(&plain, &later), [true, false]);
    let expected = "scanner `right`: the time offset is 0.25 s, as in the calibration, not 0 s";
    assert!(output.contains(expected), "{output}");
}

#[test]
fn files_that_cannot_place_points_are_refused_with_the_reason() {
    let folder = project_of_logs();
    let at = |name: &str| folder.path().join(name);
    let scanner = |name: &str| {
        format!(
            "[[scanner]]\nname = \"{name}\"\nprofiles = \"elsewhere.bin\"\n\
             translation_m = [1, 2, 3]\nrotation_deg = [4, 5, 6]\n"
        )
    };
    let cases = [
        (
            "",
            "c.toml: found no scanners, not `left`, expected a [[scanner]] table for every",
        ),
        (
            &(scanner("right") + &scanner("rear")),
            "found only `right`, `rear`, not `left`, expected",
        ),
        (
            &scanner("left").replace("name", "nam"),
            "c.toml, line 2: found the unknown key `nam`",
        ),
        (
            &(scanner("left") + &scanner("left")),
            "c.toml, line 7: found the name \"left\" twice",
        ),
        (
            &scanner("left").replace("[4, 5, 6]", "[4, 5, nan]"),
            "c.toml, line 5: found rotation_deg = NaN, expected a finite number",
        ),
        (
            &format!("[imu]\nfile = \"imu.csv\"\n{}", scanner("left")),
            "c.toml, line 1: found the unknown key `imu`, expected `scanner`",
        ),
    ];
    let on = ["georeference", "./project.toml"];
    let with_calibration = [&on[..], &["--calibration", "./c.toml"]].concat();
    for (text, expected) in cases {
        fs::write(at("c.toml"), text).unwrap();
        let run = refused(folder.path(), &with_calibration);
        assert!(run.err.contains(expected), "{expected}: {}", run.err);
        assert_eq!(run.err.matches("error: ").count(), 1, "{}", run.err);
    }
    fs::remove_file(at("c.toml")).unwrap();
    let run = refused(folder.path(), &with_calibration);
    assert!(run.err.contains("c.toml: "), "{}", run.err);
    let with_poses = |name: &str| {
        let run = refused(folder.path(), &[&on[..], &["--trajectory", name]].concat());
        run.err
    };
    assert!(with_poses("./none.csv").contains("none.csv: "));
    assert!(with_poses("./left.csv").contains("left.csv, line 1: found"));
    fs::create_dir(at("folder")).unwrap();
    for flag in ["--calibration", "--trajectory"] {
        let run = refused(folder.path(), &[&on[..], &[flag, "./folder"]].concat());
        assert!(
            run.err
                .contains("folder: found a folder, expected a file of"),
            "{}",
            run.err
        );
    }
    // No cloud was begun.
    assert!(!at("out/cloud-left.laz").exists());

    // The logs of the project need not exist if poses are given.
    fs::write(at("c.toml"), scanner("left")).unwrap();
    fs::remove_file(at("imu.csv")).unwrap();
    fs::write(
        at("poses.csv"),
        "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n30,0,15,0,0,0,0,1\n",
    )
    .unwrap();
    let project = at("project.toml");
    let poses = at("poses.csv");
    let run = boresight(&[
        "georeference",
        project.to_str().unwrap(),
        "--trajectory",
        poses.to_str().unwrap(),
    ]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(at("out/cloud-left.laz").exists());
}
