//! The digital twin: its files, its ground truth and what it guarantees.

mod errors;
mod field;
mod golden;
mod lidar;

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::files;

use boresight::format;
use boresight::geometry::BodyAxes;
use boresight::progress::Silent;
use boresight::simulation::{Drive, Profiler, Scenario, Scene, Surface, simulate};

/// The demo at a fraction of its rates.
fn small() -> Scenario {
    let mut scenario = Scenario::demo();
    scenario.profiles.rate_hz = 3.0;
    scenario.profiles.width = 64;
    scenario.reference.board_spacing_m = 0.02;
    scenario.reference.soil_spacing_m = 0.05;
    scenario
}

/// The bytes of every file below a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = files(folder).into_iter();
    files
        .map(|(path, bytes)| (path.display().to_string(), bytes))
        .collect()
}

#[test]
fn one_and_two_threads_write_the_same_bytes() {
    let written = [1, 2].map(|threads| {
        let folder = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| simulate(&small(), folder.path(), &Silent))
            .unwrap();
        contents(folder.path())
    });
    let names: Vec<&String> = written[0].keys().collect();
    let mut expected = vec!["scenario.toml".to_owned(), "tls.laz".to_owned()];
    for drive in 1..=3 {
        for file in [
            "imu.csv",
            "prism.csv",
            "heading.csv",
            "left.bin",
            "right.bin",
            "project.toml",
            "truth/trajectory.csv",
            "truth/mounting.toml",
            "truth/scene.toml",
        ] {
            expected.push(format!("drive-{drive}/{file}"));
        }
    }
    expected.sort();
    assert_eq!(names, expected.iter().collect::<Vec<_>>());
    for (name, bytes) in &written[0] {
        assert!(*bytes == written[1][name], "{name} differs");
    }
    let scenario: Scenario =
        toml::from_str(std::str::from_utf8(&written[0]["scenario.toml"]).unwrap()).unwrap();
    assert_eq!(scenario, small());
}

#[test]
fn recorded_points_lie_on_the_scene_at_the_true_poses() {
    for body in [BodyAxes::Frd, BodyAxes::Flu] {
        let mut scenario = Scenario { body, ..small() };
        // Flying points are wrong by design.
        scenario.profiles.edge_lost_flying = [1.0, 0.0];
        scenario.drives.truncate(2);
        let folder = tempfile::tempdir().unwrap();
        let files = simulate(&scenario, folder.path(), &Silent).unwrap();
        let scene = Scene::new(&scenario);
        let drive = &files.drives[1];
        let truth = format::read_trajectory(&drive.folder.join("truth/trajectory.csv")).unwrap();
        let truth = boresight::trajectory::Trajectory::new(truth).unwrap();
        let mut seen = 0;
        for (name, body_from_scanner) in ["left", "right"].iter().zip(scenario.true_mountings()) {
            let path = drive.folder.join(format!("{name}.bin"));
            let mut reader = format::open_profiles(&path).unwrap();
            let (mut chunk, mut squares, mut count, mut worst) = (Vec::new(), 0.0, 0, 0.0f64);
            while reader.next_chunk(&mut chunk).unwrap() {
                for point in &chunk {
                    let pose = truth.pose_at(point.time_s).unwrap() * body_from_scanner;
                    let distance = scene.distance_m(&pose.map(&point.position_m));
                    squares += distance * distance;
                    worst = worst.max(distance);
                    count += 1;
                }
            }
            seen += count;
            let rms = (squares / f64::from(count)).sqrt();
            println!(
                "{body:?} {name}: {count} points, rms {:.3} mm, worst {:.2} mm",
                rms * 1e3,
                worst * 1e3
            );
            // Noise of 0.1 to 0.3 mm along the ray, less along the normal.
            assert!(rms > 0.0001 && rms < 0.0003, "{rms}");
            assert!(worst < 0.002, "{worst}");
        }
        assert_eq!(seen as u64, drive.points);
        // The fan reaches from 1° to 71° off the vertical, and level ground lies within its range up
        // to 40°: 56 %, more over boards.
        let share = f64::from(seen) / (drive.profiles as f64 * 64.0);
        assert!(share > 0.45 && share < 0.7, "{share}");
    }
}

#[test]
fn every_drive_scans_every_board_twice_at_different_headings() {
    let scenario = small();
    let scene = Scene::new(&scenario);
    for index in 0..3 {
        let drive = Drive::new(&scenario, &scene, index, 0.0);
        let profiler = Profiler::new(&scenario, &scene, &drive, index);
        for board in 0..scene.boards.len() {
            // Times at which either scanner sees the board, grouped into passes.
            let mut passes: Vec<(Vec<f64>, [f64; 4])> = Vec::new();
            let mut last = f64::NEG_INFINITY;
            for k in 0..profiler.count() {
                for scanner in 0..2 {
                    let time_s = profiler.time_s(scanner, k);
                    for ray in profiler.ideal(scanner, k).iter().flatten() {
                        if ray.hit.surface != Surface::Board(board) || ray.cosine < 0.26 {
                            continue;
                        }
                        if time_s > last + 2.0 {
                            passes.push((Vec::new(), [f64::MAX, f64::MIN, f64::MAX, f64::MIN]));
                        }
                        last = time_s;
                        let pose =
                            drive.at(time_s).world_from_body * scenario.true_mountings()[scanner];
                        let [u, v, w] = scene.boards[board].coordinates_m(&pose.map(&ray.point_m));
                        assert!(w.abs() < 1e-9);
                        let (times, extent) = passes.last_mut().unwrap();
                        times.push(time_s);
                        *extent = [
                            extent[0].min(u),
                            extent[1].max(u),
                            extent[2].min(v),
                            extent[3].max(v),
                        ];
                    }
                }
            }
            // A pass sees nearly the whole board.
            let headings: Vec<f64> = passes
                .iter()
                .filter(|(_, e)| e[1] - e[0] > 0.85 && e[3] - e[2] > 0.85)
                .map(|(times, _)| {
                    let forward = drive.at(times[times.len() / 2]).velocity_m_s;
                    forward.x.atan2(forward.y).to_degrees()
                })
                .collect();
            println!("drive {} board {board}: headings {headings:.0?}", index + 1);
            let widest = headings
                .iter()
                .flat_map(|a| {
                    headings
                        .iter()
                        .map(move |b| (a - b).to_radians().cos().acos().to_degrees())
                })
                .fold(0.0, f64::max);
            assert!(
                headings.len() >= 2 && widest > 45.0,
                "drive {index} board {board}: {headings:?}"
            );
        }
    }
}

#[test]
fn the_demo_covers_the_boards_at_five_millimetres() {
    let scenario = Scenario::demo();
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 0, 0.0);
    let profiler = Profiler::new(&scenario, &scene, &drive, 0);
    let mounting = scenario.true_mountings();
    let mut cells = vec![vec![false; 200 * 200]; scene.boards.len()];
    for k in 0..profiler.count() {
        for (scanner, body_from_scanner) in mounting.iter().enumerate() {
            let pose = drive.at(profiler.time_s(scanner, k)).world_from_body * *body_from_scanner;
            for ray in profiler.ideal(scanner, k).iter().flatten() {
                if let Surface::Board(b) = ray.hit.surface {
                    let [u, v, _] = scene.boards[b].coordinates_m(&pose.map(&ray.point_m));
                    let cell = |c: f64| (((c + 0.5) * 200.0) as usize).min(199);
                    cells[b][cell(v) * 200 + cell(u)] = true;
                }
            }
        }
    }
    for (board, cells) in cells.iter().enumerate() {
        let share = cells.iter().filter(|seen| **seen).count() as f64 / cells.len() as f64;
        println!("board {board}: {:.1} % of the 5 mm cells", 100.0 * share);
        assert!(share > 0.95, "board {board}: {share}");
    }
}

#[test]
fn the_project_holds_what_a_user_knows_and_not_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    simulate(&small(), folder.path(), &Silent).unwrap();
    let read = |name: &str| -> toml::Table {
        std::fs::read_to_string(folder.path().join(name))
            .unwrap()
            .parse()
            .unwrap()
    };
    let project = read("drive-1/project.toml");
    assert_eq!(project["frame"]["body"].as_str(), Some("FRD"));
    assert_eq!(
        project["imu"]["gyro_noise_deg_sqrt_h"].as_float(),
        Some(0.15)
    );
    assert_eq!(project["prism"]["lever_arm_m"][2].as_float(), Some(-0.55));
    assert_eq!(project["heading"]["sigma_deg"].as_float(), Some(0.7));
    assert_eq!(project["reference"]["file"].as_str(), Some("../tls.laz"));
    assert_eq!(project["scanner"][0]["profiles"].as_str(), Some("left.bin"));
    // Initial values of Table I, not the truth.
    assert_eq!(
        project["scanner"][0]["translation_m"][0].as_float(),
        Some(1.2)
    );
    assert_eq!(
        project["scanner"][1]["rotation_deg"][0].as_float(),
        Some(145.0)
    );
    assert_eq!(
        project["evaluation"][1]["project"].as_str(),
        Some("../drive-3/project.toml")
    );
    assert!(!read("drive-2/project.toml").contains_key("evaluation"));
    let truth = read("drive-1/truth/mounting.toml");
    assert_eq!(
        truth["scanner"][0]["translation_m"][0].as_float(),
        Some(1.254)
    );
    assert_eq!(
        truth["scanner"][1]["rotation_deg"][2].as_float(),
        Some(91.705)
    );
    assert_eq!(
        read("drive-3/truth/scene.toml")["board"]
            .as_array()
            .unwrap()
            .len(),
        5
    );
}

#[test]
fn a_scenario_may_give_only_what_differs_and_no_unknown_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let load = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Scenario::load(path.to_str().unwrap())
    };
    let scenario = load("seed = 7\n[deformation]\nenabled = true\n").unwrap();
    assert!(scenario.deformation.enabled && scenario.seed == 7);
    assert_eq!(scenario.boards, Scenario::demo().boards);
    for (text, needle) in [
        ("seed = 1\nspeed = 2.0\n", "line 2"),
        ("[imu]\nrate_hz = -5.0\n", "imu.rate_hz is -5"),
        ("[profiles]\nwidth = 1\n", "profiles.width is 1"),
        ("[prism]\nrate_hz = nan\n", "prism.rate_hz is NaN"),
        (
            "[prism]\nlost_s = [[5.0, 4.0]]\n",
            "prism.lost_s from 5 to 4",
        ),
        ("[lidar]\nrange_m = [5.0, 2.0]\n", "lidar.range_m is empty"),
        ("[lidar]\nrings = 0\n", "lidar.rings is 0"),
        (
            "[plants]\ncount_per_m2 = -1.0\n",
            "plants.count_per_m2 is -1",
        ),
        (
            "[prism]\noutlier_share = 1.5\n",
            "prism.outlier_share is 1.5",
        ),
        (
            "[heading]\ncorrelation_s = 0.0\n",
            "heading.correlation_s is 0",
        ),
        (
            "[[drives]]\npasses = [{board = 9, heading_deg = 0.0}]\n",
            "board 9",
        ),
    ] {
        let error = load(text).unwrap_err().to_string();
        assert!(error.contains(needle), "{error}");
    }
    assert_eq!(Scenario::load("full").unwrap().profiles.width, 1920);
}

/// Prints how large the files of the demo are and how long they take; writes 120 MB.
#[test]
#[ignore = "just acceptance"]
fn the_demo_holds_enough_points() {
    let folder = tempfile::tempdir().unwrap();
    let started = std::time::Instant::now();
    let files = simulate(&Scenario::demo(), folder.path(), &Silent).unwrap();
    println!("{:.1} s", started.elapsed().as_secs_f64());
    println!("{files:#?}");
    let bytes: usize = contents(folder.path())
        .iter()
        .map(|(name, bytes)| {
            println!("{name}: {}", bytes.len());
            bytes.len()
        })
        .sum();
    println!("{:.1} MB", bytes as f64 / 1e6);
    assert!(files.drives.iter().all(|drive| drive.points > 1_500_000));
}

/// The paper's rates over one board; writes half a gigabyte.
#[test]
#[ignore = "just acceptance"]
fn about_half_the_rays_return_at_full_rates_over_one_board() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = Scenario::full();
    scenario.drives.truncate(1);
    scenario.drives[0].passes.truncate(1);
    let started = std::time::Instant::now();
    let files = simulate(&scenario, folder.path(), &Silent).unwrap();
    println!("{:.1} s, {files:#?}", started.elapsed().as_secs_f64());
    // 200 profiles of 1920 rays a second and scanner, about half of which return.
    let rate = files.drives[0].points as f64 / (files.drives[0].profiles as f64 * 1920.0);
    assert!((0.4..0.8).contains(&rate), "{rate}");
    assert!(
        files
            .reference
            .is_some_and(|reference| reference.points > 40_000_000)
    );
}
