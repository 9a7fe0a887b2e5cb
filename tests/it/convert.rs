//! `boresight convert`: the results of a run in the formats of other programs and back.

use std::fs;
use std::path::Path;

use crate::common::{boresight, on_project, refused, simulated};
use boresight::format::{inspect, read_cloud, read_trajectory};
use boresight::geometry::Vec3;

fn converted(folder: &Path, input: &str, output: &str, more: &[&str]) -> String {
    let at = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (input, output) = (at(input), at(output));
    // Files that an earlier conversion wrote are replaced.
    let run = boresight(&[&["convert", &input, &output, "--force"], more].concat());
    assert_eq!(run.code, 0, "{output}: {}", run.err);
    run.out
}

#[test]
fn results_of_a_run_are_read_back_from_every_format() {
    let (_temp, drive) = simulated();
    let run = on_project(&drive, "georeference", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let run = on_project(&drive, "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let out = drive.join("out");
    let cloud = read_cloud(&out.join("cloud-left.laz")).unwrap();
    let sorted = |points: &[Vec3]| {
        let mut rows: Vec<[i64; 3]> = points
            .iter()
            .map(|p| [p.x, p.y, p.z].map(|v| (v * 1e5).round() as i64))
            .collect();
        rows.sort_unstable();
        rows
    };
    for name in ["a.las", "a.laz", "a.copc.laz", "a.e57", "a.ply", "a.csv"] {
        converted(&out, "cloud-left.laz", name, &[]);
        let back = read_cloud(&out.join(name)).unwrap();
        assert_eq!(sorted(&back.points), sorted(&cloud.points), "{name}");
        let mut times = back.time_s;
        times.sort_by(f64::total_cmp);
        // The reader of E57 gives no times.
        assert!(name == "a.e57" || times == cloud.time_s, "{name}");
    }
    if cfg!(feature = "parquet") {
        converted(&out, "cloud-left.laz", "a.parquet", &[]);
        let back = read_cloud(&out.join("a.parquet")).unwrap();
        assert_eq!(back, cloud);
        converted(&out, "trajectory.csv", "t.parquet", &[]);
        let poses = read_trajectory(&out.join("t.parquet")).unwrap();
        assert_eq!(poses, read_trajectory(&out.join("trajectory.csv")).unwrap());
    }
    // The values have the same names in every format.
    for name in ["a.laz", "a.copc.laz"] {
        let columns = inspect(&out.join(name)).unwrap().to_string();
        assert!(
            columns.contains("scanner, profile, pose_sigma_m"),
            "{columns}"
        );
    }
    let header = fs::read_to_string(out.join("a.csv")).unwrap();
    assert!(
        header.starts_with("east_m,north_m,up_m,time_s,intensity,scanner,profile,pose_sigma_m\n")
    );

    converted(&out, "trajectory.csv", "t.tum", &[]);
    let poses = read_trajectory(&out.join("trajectory.csv")).unwrap();
    let tum = read_trajectory(&out.join("t.tum")).unwrap();
    assert!(
        tum.iter()
            .zip(&poses)
            .all(|(a, b)| a.world_from_body == b.world_from_body)
    );
    // To latitudes and longitudes and back.
    let crs = ["--crs", "+proj=tmerc +lat_0=50.7 +lon_0=7.1 +ellps=GRS80"];
    converted(&out, "trajectory.csv", "t.sbet", &crs);
    converted(&out, "t.sbet", "back.csv", &crs);
    let back = read_trajectory(&out.join("back.csv")).unwrap();
    assert_eq!(back.len(), poses.len());
    for (a, b) in back.iter().zip(&poses) {
        let (a, b) = (&a.world_from_body, &b.world_from_body);
        assert!((a.translation_m - b.translation_m).norm() < 1e-4);
        assert!(a.rotation.angle_to(&b.rotation) < 1e-6);
    }

    let run = on_project(&drive, "calibrate", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for name in ["../project.toml", "../out/calibration.toml"] {
        for target in ["m.urdf", "m.launch.py", "m.yaml"] {
            let summary = converted(&out, name, target, &["--body", "base"]);
            assert!(summary.contains("2 scanners on a body with"), "{summary}");
            let text = fs::read_to_string(out.join(target)).unwrap();
            assert!(
                ["base", "left", "right"]
                    .iter()
                    .all(|word| text.contains(word))
            );
        }
        converted(&out, name, "m.json", &["--scanner", "right"]);
        assert!(
            fs::read_to_string(out.join("m.json"))
                .unwrap()
                .contains("filters.transformation")
        );
    }
}

/// Unix times return from LAZ, which stores GPS time; mountings turn with the axes of the body.
#[test]
fn times_are_converted_there_and_back_and_mountings_follow_the_body_axes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let rows = ["1,2,3,1763900000.25", "1.5,2,3,1763900000.5"];
    let text = format!("east_m,north_m,up_m,time_s\n{}\n", rows.join("\n"));
    fs::write(at("a.csv"), &text).unwrap();
    for between in ["b.laz", "b.copc.laz", "b.las"] {
        converted(folder.path(), "a.csv", between, &[]);
        converted(folder.path(), between, "c.csv", &[]);
        let back = fs::read_to_string(at("c.csv")).unwrap();
        for (line, row) in back.lines().skip(1).zip(rows) {
            let (cells, expected) = (line.split(','), row.split(','));
            let number = |cell: &str| cell.parse::<f64>().unwrap();
            let coordinates = cells.clone().zip(expected.clone()).take(4);
            assert!(
                coordinates
                    .clone()
                    .all(|(a, b)| (number(a) - number(b)).abs() < 1e-9),
                "{line}"
            );
        }
    }

    let (_temp, drive) = simulated();
    let matrix = |more: &[&str]| {
        converted(
            &drive,
            "project.toml",
            "m.json",
            &[&["--scanner", "left"], more].concat(),
        );
        let text = fs::read_to_string(drive.join("m.json")).unwrap();
        let text = text
            .split("\"matrix\": \"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .to_owned();
        text.split(' ')
            .map(|cell| cell.parse::<f64>().unwrap())
            .collect::<Vec<_>>()
    };
    let (frd, flu) = (matrix(&[]), matrix(&["--axes", "FLU"]));
    for (at, (a, b)) in frd.iter().zip(&flu).enumerate() {
        let sign = if [1, 2].contains(&(at / 4)) {
            -1.0
        } else {
            1.0
        };
        assert!((a - sign * b).abs() < 1e-12, "{at}: {a} {b}");
    }
}

#[test]
fn conversions_that_are_not_possible_are_refused_with_the_reason() {
    let (_temp, drive) = simulated();
    let refuses = |arguments: &[&str], expected: &[&str]| {
        let error = refused(&drive, arguments).err;
        for word in expected {
            assert!(error.contains(word), "{error}");
        }
    };
    refuses(
        &["convert", "./left.bin", "./left.e57"],
        &["left.e57", ".copc.laz"],
    );
    refuses(&["convert", "./missing.laz", "./a.ply"], &["missing.laz"]);
    refuses(
        &["convert", "./project.toml", "./a.json"],
        &["left, right", "--scanner"],
    );
    refuses(
        &["convert", "./truth/trajectory.csv", "./a.sbet"],
        &["trajectory.csv", "--crs"],
    );
    refuses(
        &[
            "convert",
            "./truth/trajectory.csv",
            "./a.sbet",
            "--crs",
            "EPSG:4326",
        ],
        &["EPSG:4326"],
    );
    refuses(
        &[
            "convert",
            "./truth/trajectory.csv",
            "./truth/trajectory.csv",
        ],
        &["is an input"],
    );
    refuses(
        &["convert", "./imu.csv", "./imu.urdf"],
        &["imu.csv: ", "cannot be written as"],
    );
    refuses(
        &["convert", "./project.toml", "./a.json", "--scanner", "top"],
        &["no scanner `top`, only left, right"],
    );
    refuses(
        &[
            "convert",
            "./truth/trajectory.csv",
            "./a.tum",
            "--crs",
            "EPSG:25832",
        ],
        &["--crs does not apply"],
    );
    assert!(!drive.join("a.sbet").exists() && !drive.join("a.json").exists());
}
