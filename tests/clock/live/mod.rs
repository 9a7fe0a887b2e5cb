//! A simulated drive, played through all interfaces at once, recorded, and processed like the drive's original files.

mod faults;
mod twin;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::common::{self, boresight};
use boresight::format;
use boresight::geometry::Vec3;
use boresight::sensor::{Observations, PoseRecord, ScanPoint, TotalStation, VerticalAngle};
use boresight::trajectory::Trajectory;

/// Recorded distances and angles are rounded to 0.01 mm and 1e-7°; with noise of 5 mm, no two positions are closer.
const ROUNDED_M: f64 = 3e-5;

/// Plays a recording and records it again.
fn replay(recording: &Path, speed: &str, out: &Path) {
    let [from, to] = [recording, out].map(|path| path.to_str().unwrap());
    let run = boresight(&["replay", from, "--speed", speed, "--out", to, "--quiet"]);
    assert_eq!(run.code, 0, "{}", run.err);
}

fn points(profiles: &Path) -> Vec<ScanPoint> {
    let mut reader = format::open_profiles(profiles).unwrap();
    let (mut chunk, mut all) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        all.extend_from_slice(&chunk);
    }
    all
}

/// The poses that the command `trajectory` estimates.
fn poses(project: &Path) -> Vec<PoseRecord> {
    let out = project.join("out-poses");
    let run = boresight(&[
        "trajectory",
        project.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(run.code, 0, "{}", run.err);
    format::read_trajectory(&out.join("trajectory.csv")).unwrap()
}

/// Root mean square and largest distance between the positions of two drives where they overlap, metres; the second
/// begins `later_s` later.
fn apart(first: &[PoseRecord], second: &[PoseRecord], later_s: f64) -> (f64, f64) {
    let second = Trajectory::new(second.to_vec()).unwrap();
    let squares: Vec<f64> = first
        .iter()
        .filter_map(|pose| {
            let other = second.pose_at(pose.time_s + later_s)?;
            Some((other.translation_m - pose.world_from_body.translation_m).norm_squared())
        })
        .collect();
    assert!(2 * squares.len() > first.len());
    let largest = squares.iter().copied().fold(0.0, f64::max).sqrt();
    (
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt(),
        largest,
    )
}

/// Differences between a recording and the recording that was played.
struct Compared {
    /// Median and 99.9 % quantile of the deviations of the prism's times from their median delay, seconds.
    station_s: [f64; 2],
    /// The same for profiles.
    scanner_s: [f64; 2],
    /// Share of the distances that were recorded.
    distances: f64,
}

/// Median and 99.9 % quantile of the deviations from the median.
fn quantiles(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let middle = values[values.len() / 2];
    values
        .iter_mut()
        .for_each(|value| *value = (*value - middle).abs());
    values.sort_by(f64::total_cmp);
    [0.5, 0.999].map(|p| values[((values.len() - 1) as f64 * p) as usize])
}

/// Compares a recording with the recording that was played.
fn compare(played: &Path, recorded: &Path) -> Compared {
    for name in ["ins.sbg", "compass.nmea", "left.gocator", "right.gocator"] {
        let [sent, logged] = [played, recorded].map(|folder| fs::read(folder.join(name)).unwrap());
        assert!(
            sent == logged,
            "{name}: {} of {} bytes",
            logged.len(),
            sent.len()
        );
    }
    let times = |folder: &Path| -> Vec<(f64, Vec3)> {
        let instrument = TotalStation {
            station_m: Vec3::zeros(),
            orientation_rad: 0.0,
            vertical: VerticalAngle::Zenith,
            reflector_constant_m: 0.0,
            sigma_distance_m: 0.001,
            sigma_distance_ppm: 1.0,
            sigma_angle_rad: 5e-6,
            sigma_prism_m: 0.005,
        };
        let how = Observations::Polar(instrument);
        let positions = format::read_positions(&folder.join("station.csv"), &how).unwrap();
        let fixes = positions.fixes.iter();
        fixes.map(|fix| (fix.time_s, fix.position_m)).collect()
    };
    let [sent, logged] = [played, recorded].map(times);
    let station = sent.iter().filter_map(|(time_s, position_m)| {
        let same = logged
            .iter()
            .find(|(_, other_m)| (other_m - position_m).norm() < ROUNDED_M)?;
        Some(same.0 - time_s)
    });
    let station: Vec<f64> = station.collect();
    let distances = station.len() as f64 / sent.len() as f64;
    let [sent, logged] = [played, recorded].map(|folder| points(&folder.join("left.gocator")));
    assert_eq!(sent.len(), logged.len());
    let scanner = sent.iter().zip(&logged).map(|(sent, logged)| {
        assert_eq!(sent.position_m, logged.position_m);
        logged.time_s - sent.time_s
    });
    Compared {
        station_s: quantiles(station),
        scanner_s: quantiles(scanner.collect()),
        distances,
    }
}

/// Time from sending to stamping the pieces of a log, milliseconds of real time: median and 99.9 % quantile. Playing
/// begins after a second of real time.
fn arrivals_ms(played: &Path, recorded: &Path, log: &str, speed: f64) -> [f64; 2] {
    let ends = |folder: &Path| -> Vec<(usize, f64)> {
        let mut end = 0;
        let pieces = format::Pieces::open(&folder.join(log)).unwrap();
        let ends = pieces.map(|(bytes, at_s)| {
            end += bytes;
            (end, at_s)
        });
        ends.collect()
    };
    let stamped = ends(recorded);
    let mut delays: Vec<f64> = ends(played)
        .into_iter()
        .map(|(end, sent_s)| {
            let arrived_s = stamped[stamped.partition_point(|(other, _)| *other < end)].1;
            1e3 * ((arrived_s - sent_s) / speed - 1.0)
        })
        .collect();
    summary_ms(&mut delays)
}

/// Median and 99.9 % quantile of milliseconds, rounded to 0.01.
fn summary_ms(delays: &mut [f64]) -> [f64; 2] {
    delays.sort_by(f64::total_cmp);
    [0.5, 0.999].map(|p| {
        let delay_ms = delays[((delays.len() - 1) as f64 * p) as usize];
        (1e2 * delay_ms).round() / 1e2
    })
}

/// The same for the distances of a total station, which was switched on when playing began.
fn distances_ms(recorded: &Path, speed: f64) -> [f64; 2] {
    let rows = format::station_rows(&recorded.join("station.csv")).unwrap();
    let delays = rows
        .iter()
        .map(|row| 1e3 * (row.monotonic_s - row.instrument_time_s.unwrap()) / speed);
    summary_ms(&mut delays.collect::<Vec<f64>>())
}

/// A drive of a single pass, as playing takes a fifth of its duration, and the folder in which it is.
fn one_pass() -> (tempfile::TempDir, PathBuf) {
    let temp = tempfile::tempdir().unwrap();
    let [scenario, out] = ["scenario.toml", "field"].map(|name| temp.path().join(name));
    let second = ", { board = 0, heading_deg = 270.0 }";
    assert!(common::TINY_SCENARIO.contains(second));
    fs::write(&scenario, common::TINY_SCENARIO.replace(second, "")).unwrap();
    let [from, to] = [&scenario, &out].map(|path| path.to_str().unwrap());
    let run = boresight(&["simulate", "--scenario", from, "--out", to]);
    assert_eq!(run.code, 0, "{}", run.err);
    (temp, out.join("drive-1"))
}

#[test]
fn a_recording_gives_the_trajectory_of_the_original_files() {
    let (temp, drive) = one_pass();
    let recording = temp.path().join("recording");
    twin::record(&drive.join("project.toml"), &recording);
    let original = poses(&drive);
    let recorded = poses(&recording);
    let later_s = recorded[0].time_s - original[0].time_s;
    // The only difference is the delay of the station's times; the drive is slower than 1 m/s.
    let (rms_m, largest_m) = apart(&original, &recorded, later_s);
    assert!(
        rms_m < 1.5 * twin::STATION_DELAY_S && largest_m < 0.01,
        "{rms_m} {largest_m}"
    );
    // The scanners' clocks are mapped to the common time, up to their delay.
    let original = points(&drive.join("left.bin"));
    let recorded = points(&recording.join("left.gocator"));
    assert_eq!(original.len(), recorded.len());
    let offset_s = recorded[0].time_s - original[0].time_s;
    for (original, recorded) in original.iter().zip(&recorded) {
        let step_m = 1e-9 * f64::from(twin::STEP_NM);
        assert!((original.position_m - recorded.position_m).amax() < 0.51 * step_m);
        assert!((recorded.time_s - original.time_s - offset_s).abs() < 2e-5);
    }

    // `inspect` reports the clocks.
    let inspected = || {
        boresight(&[
            "inspect",
            recording.join("project.toml").to_str().unwrap(),
            "--json",
        ])
        .out
    };
    let text = inspected();
    assert!(
        text.contains("recording.sensor_clock") && text.contains("left: its clock differs by"),
        "{text}"
    );
    assert!(
        !text.contains("recording.clock\"") && !text.contains("imu: its clock"),
        "{text}"
    );
    common::rewrite(&recording.join("clock.csv"), |text| {
        text.replacen("1,\n", "1,0.5\n", 1)
    });
    let text = inspected();
    assert!(
        text.contains("recording.clock\"") && text.contains("was set by +0.500 s"),
        "{text}"
    );
    // The system clock is no longer trusted, so that all sensors are on their times of arrival.
    assert!(text.contains("imu: its clock"), "{text}");
    common::rewrite(&recording.join("clock.csv"), |text| {
        text.replacen("1,0.5\n", "1,\n", 1)
    });

    let again = temp.path().join("again");
    let begun = Instant::now();
    replay(&recording, "5", &again);
    assert!(begun.elapsed().as_secs_f64() < 60.0);
    let compared = compare(&recording, &again);
    assert!(
        compared.distances > 0.9,
        "{} of the distances",
        compared.distances
    );
    // At five times the speed, a millisecond of real time is 5 ms of the recording.
    assert!(compared.station_s[0] < 0.01 && compared.scanner_s[0] < 0.01);
}

/// The demo's drive at real time and twenty times as fast; prints the table of docs/record.md.
#[test]
#[ignore = "just acceptance"]
fn the_demo_drive_is_recorded_through_all_interfaces() {
    let temp = tempfile::tempdir().unwrap();
    let data = temp.path().join("data");
    let run = boresight(&["simulate", "--out", data.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    let drive = data.join("drive-1");
    let recording: PathBuf = temp.path().join("recording");
    twin::record(&drive.join("project.toml"), &recording);
    common::rewrite(&drive.join("project.toml"), |text| {
        let end = text.find("[[evaluation]]").unwrap_or(text.len());
        text[..end].to_owned()
    });
    let mountings = |project: &Path| -> serde_json::Value {
        let run = boresight(&["run", project.to_str().unwrap(), "--json", "--quiet"]);
        assert_eq!(run.code, 0, "{}", run.err);
        serde_json::from_str(&run.out).unwrap()
    };
    let original = mountings(&drive);
    println!("the original files: {}", line(&original, &original));
    let ideal = mountings(&recording);
    println!("the recording that is played: {}", line(&ideal, &original));
    for speed in ["1", "20"] {
        let again = temp.path().join(format!("again-{speed}"));
        replay(&recording, speed, &again);
        let compared = compare(&recording, &again);
        for log in ["ins.sbg", "compass.nmea", "left.gocator"] {
            let [median, late] = arrivals_ms(&recording, &again, log, speed.parse().unwrap());
            println!(
                "{speed} times, {log}: stamped after {median} ms (median), {late} ms (99.9 %)"
            );
        }
        let [median, late] = distances_ms(&again, speed.parse().unwrap());
        println!(
            "{speed} times, distances: stamped after {median} ms (median), {late} ms (99.9 %)"
        );
        let ms = |seconds: [f64; 2]| seconds.map(|s| (1e5 * s).round() / 100.0);
        println!(
            "{speed} times: {:.1} % of the distances; stamps off by (median, 99.9 %, ms of the recording) prism {:?}, \
             profiles {:?}; {}",
            100.0 * compared.distances,
            ms(compared.station_s),
            ms(compared.scanner_s),
            line(&mountings(&again), &ideal)
        );
    }
}

/// The headline of a result, and its largest differences from expected mountings.
fn line(result: &serde_json::Value, expected: &serde_json::Value) -> String {
    let mut largest = [0.0_f64; 2];
    for name in ["left", "right"] {
        let pose = |result: &serde_json::Value, key: &str| -> Vec<f64> {
            let values = result["scanners"][name]["body_from_scanner"][key]
                .as_array()
                .unwrap();
            values.iter().map(|value| value.as_f64().unwrap()).collect()
        };
        for (i, key) in ["translation_m", "quaternion_xyzw"].into_iter().enumerate() {
            let (a, b) = (pose(result, key), pose(expected, key));
            let square: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
            largest[i] = largest[i].max(square.sqrt());
        }
    }
    format!(
        "{}: mountings off by {:.3} mm and {:.4}°",
        result["headline"],
        1e3 * largest[0],
        2.0 * largest[1].to_degrees()
    )
}
