//! Absurd input: every command ends with a result or a clear error, in bounded time and memory.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::{boresight, project_of_logs, refused, rewrite};
use boresight::comparison::{ComparisonSettings, Normals, m3c2};
use boresight::geometry::Vec3;
use boresight::progress::Silent;

/// Runs the binary on files of a folder; it must fail, and its message is returned.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let run = refused(folder, arguments);
    let has_error = run.err.lines().any(|line| line.starts_with("error: "));
    assert!(has_error, "{}", run.err);
    run.err
}

/// Adds `by_s` to the first cell of every row below the header.
fn shift_times(path: &Path, by_s: f64) {
    rewrite(path, |text| {
        let (header, rows) = text.split_once('\n').unwrap();
        let mut shifted = format!("{header}\n");
        for row in rows.lines() {
            let (time, rest) = row.split_once(',').unwrap();
            let time_s: f64 = time.trim().parse().unwrap();
            let _ = writeln!(shifted, "{},{rest}", time_s + by_s);
        }
        shifted
    });
}

/// A drive with given poses: 30 s northwards with standard deviations, and the ground below as the
/// reference.
fn project_of_poses() -> tempfile::TempDir {
    let folder = project_of_logs();
    let at = |name: &str| folder.path().join(name);
    let half = 0.5f64.sqrt();
    let mut poses = "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n".to_owned();
    for i in 0..1500 {
        let time_s = f64::from(i) / 50.0;
        let _ = writeln!(poses, "{time_s},0,{},2,{half},{half},0,0", 0.5 * time_s);
    }
    fs::write(at("poses.csv"), poses).unwrap();
    let mut ground = "east_m,north_m,up_m\n".to_owned();
    for x in -60..120 {
        for y in 0..300 {
            let _ = writeln!(
                ground,
                "{},{},0.8",
                0.02 * f64::from(x),
                0.05 * f64::from(y)
            );
        }
    }
    fs::write(at("ground.csv"), ground).unwrap();
    rewrite(&at("project.toml"), |text| {
        let scanner = text.find("[[scanner]]").unwrap();
        format!(
            "[trajectory]\nfile = \"poses.csv\"\nsigma_position_m = 0.01\nsigma_rotation_deg = 0.05\n\
             {}\n[reference]\nfile = \"ground.csv\"\n[calibration]\nvoxel_sizes_m = [0.05]\n\
             neighbours = 20\n",
            &text[scanner..]
        )
    });
    folder
}

#[test]
fn positions_long_before_the_first_imu_sample_are_refused() {
    let folder = project_of_logs();
    shift_times(&folder.path().join("imu.csv"), 1000.0);
    let message = refusal(folder.path(), &["trajectory", "./project.toml", "--online"]);
    assert!(message.contains("do not overlap"), "{message}");
}

#[test]
fn noise_figures_with_implausible_times_suggest_another_unit() {
    let folder = project_of_logs();
    let path = folder.path().join("imu.csv");
    let scale_times = |factor: f64| {
        rewrite(&path, |text| {
            let (header, _) = text.split_once('\n').unwrap();
            let rows = (0..1500).map(|i| {
                let noise = [0.1, -0.2, 0.3, -0.1, 0.05][i % 5];
                let time_s = factor * i as f64 / 50.0;
                format!(
                    "{time_s:.9},0,0,{},0,0,{}\n",
                    1e-4 * noise,
                    -9.81 + 1e-3 * noise
                )
            });
            format!("{header}\n{}", rows.collect::<String>())
        });
    };
    scale_times(1e-6);
    let message = refusal(folder.path(), &["inspect", "./imu.csv", "--allan"]);
    assert!(message.contains("check the unit of the times"), "{message}");
    scale_times(1e3);
    let run = boresight(&["inspect", path.to_str().unwrap(), "--allan"]);
    assert!(
        run.out.contains("are these milliseconds?"),
        "{}{}",
        run.out,
        run.err
    );
}

#[test]
fn a_trajectory_over_centuries_is_accepted_and_one_over_millions_of_years_is_not() {
    let folder = project_of_poses();
    rewrite(&folder.path().join("poses.csv"), |text| {
        let (header, rows) = text.split_once('\n').unwrap();
        let (_, first) = rows.split_once('\n').unwrap().0.split_once(',').unwrap();
        format!("{header}\n-1e10,{first}\n{rows}")
    });
    let project = folder.path().join("project.toml");
    let run = boresight(&["run", project.to_str().unwrap(), "--quiet"]);
    assert_eq!(run.code, 0, "{}", run.err);
    rewrite(&folder.path().join("poses.csv"), |text| {
        text.replace("-1e10", "-1e15")
    });
    boresight(&["run", project.to_str().unwrap(), "--quiet"])
        .assert_failed_with(&["poses.csv", "a time of -1e15 s"]);
}

#[test]
fn more_than_255_scanners_have_their_numbers_in_the_clouds() {
    let folder = project_of_poses();
    rewrite(&folder.path().join("left.csv"), |text| {
        let few: Vec<&str> = text.lines().take(20).collect();
        few.join("\n") + "\n"
    });
    rewrite(&folder.path().join("project.toml"), |text| {
        let (poses, scanner) = text.split_once("[[scanner]]").unwrap();
        let (scanner, _) = scanner.split_once("[reference]").unwrap();
        let scanners = (0..300).map(|i| {
            let name = format!("\"s{i}\"");
            format!("[[scanner]]{}", scanner.replace("\"left\"", &name))
        });
        format!("{poses}{}", scanners.collect::<String>())
    });
    let project = folder.path().join("project.toml");
    let run = boresight(&["georeference", project.to_str().unwrap(), "--quiet"]);
    assert_eq!(run.code, 0, "{}", run.err);
    for (scanner, in_a_byte) in [(0, 0), (255, 255), (256, 255), (299, 255)] {
        let cloud = folder.path().join(format!("out/cloud-s{scanner}.laz"));
        let mut reader = las::Reader::from_path(cloud).unwrap();
        let mut points = las::PointDataBuilder::new()
            .for_header(reader.header())
            .build();
        reader.fill_points(1, &mut points).unwrap();
        // `user_data` and `point_source_id` of point format 6.
        let record = points.raw_bytes();
        assert_eq!(record[17], in_a_byte);
        assert_eq!(u16::from_le_bytes([record[20], record[21]]), scanner);
    }
}

#[test]
fn settings_that_would_fill_the_memory_are_refused() {
    let folder = project_of_poses();
    let project = folder.path().join("project.toml");
    rewrite(&project, |text| {
        text.replace("neighbours = 20", "neighbours = 100000")
    });
    let message = refusal(folder.path(), &["run", "./project.toml"]);
    assert!(
        message.contains("neighbours = 100000, expected 1000 or less"),
        "{message}"
    );
    let scenario = "drives = [{ passes = [{ board = 0, heading_deg = 90.0 }] }]\n\
                    [motion]\nscan_speed_m_s = 0.001\n[imu]\nrate_hz = 10000.0\n";
    fs::write(folder.path().join("slow.toml"), scenario).unwrap();
    let message = refusal(
        folder.path(),
        &["simulate", "--scenario", "./slow.toml", "--out", "./sim"],
    );
    assert!(message.contains("drive 1 may last"), "{message}");
}

#[test]
fn clouds_of_coinciding_points_are_compared_quickly() {
    const MANY: usize = 100_000;
    let place = Vec3::new(1.0, 2.0, 3.0);
    let reference = vec![place; MANY];
    let compared = vec![place + Vec3::new(0.0, 0.0, 0.01); MANY];
    // One distance is searched in cells, the other in trees.
    for max_distance_m in [0.1, 1.0] {
        let settings = ComparisonSettings {
            max_distance_m,
            ..ComparisonSettings::default()
        };
        for normals in [Normals::Fixed(Vec3::z()), Normals::UPWARDS] {
            let begun = Instant::now();
            let result = m3c2(
                &reference, &compared, &reference, normals, &settings, &Silent,
            );
            let result = result.unwrap();
            assert!(
                begun.elapsed() < Duration::from_secs(30),
                "{:?}",
                begun.elapsed()
            );
            assert_eq!(result.core.len(), MANY);
            let last = result.core[MANY - 1];
            if matches!(normals, Normals::Fixed(_)) {
                assert!((last.distance_m - 0.01).abs() < 1e-12);
                assert_eq!(last.reference_count, MANY as u32);
            } else {
                // A single place has no normal.
                assert!(last.distance_m.is_nan());
            }
        }
    }
}
