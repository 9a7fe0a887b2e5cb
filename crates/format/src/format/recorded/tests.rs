use std::fs;
use std::path::{Path, PathBuf};

use super::*;
use crate::format::file::{CLOCK_LOG, EVENT_LOG};
use crate::statistics::drawn;

const BEGIN_S: f64 = 1_764_000_000.0;

/// A random number from 0 to 1.
fn random(i: u64) -> f64 {
    (drawn(i) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A recording of a heading sensor at 5 Hz for 200 s that stamps its own times, and sends each with a delay of 3 ms and up
/// to 4 ms more.
fn recording(folder: &Path, own_s: impl Fn(f64) -> f64, clock_rows: &str) -> PathBuf {
    let log = folder.join("compass.csv");
    let mut text = "time_s,heading_deg\n".to_owned();
    let mut stamps = "bytes_before,monotonic_s,unix_s\n0,0.5,0\n".to_owned();
    for i in 0..1000_u32 {
        let true_s = 1.0 + 0.2 * f64::from(i);
        let arrived_s = true_s + 0.003 + 0.004 * random(u64::from(i));
        stamps += &format!("{},{arrived_s:.6},0\n", text.len());
        text += &format!("{:.6},{}\n", own_s(true_s), i % 360);
    }
    fs::write(&log, text).unwrap();
    fs::write(stamps_of(&log), stamps).unwrap();
    let header = "unix_s,monotonic_s,reference,offset_s,rms_s,is_locked,set_s\n";
    fs::write(folder.join(EVENT_LOG), "unix_s,monotonic_s,source,event\n").unwrap();
    fs::write(folder.join(CLOCK_LOG), format!("{header}{clock_rows}")).unwrap();
    log
}

fn clock_rows(cells: &str) -> String {
    let row = |i: u32| format!("{},{i},{cells}\n", BEGIN_S + f64::from(i));
    (0..200).map(row).collect()
}

const DISCIPLINED: &str = "PPS,0.000000100,0.000000200,1,";

#[test]
fn own_utc_is_kept_where_the_system_is_disciplined() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| BEGIN_S + s, &clock_rows(DISCIPLINED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(clock.is_kept && clock.offset_s == 0.0, "{clock:?}");
    assert!((clock.delay_median_s - 0.005).abs() < 3e-4, "{clock:?}");
    assert!((0.0068..0.00701).contains(&clock.delay_999_s), "{clock:?}");
    let fixes = crate::format::read_heading(&log).unwrap();
    assert!((fixes[0].time_s - BEGIN_S - 1.0).abs() < 1e-6);
}

#[test]
fn a_clock_of_its_own_is_put_on_the_time_of_arrival_less_its_drift() {
    let folder = tempfile::tempdir().unwrap();
    let own = |s: f64| 77.0 + s * (1.0 - 5e-5);
    let log = recording(folder.path(), own, &clock_rows(DISCIPLINED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(!clock.is_kept);
    assert!((clock.drift - 5e-5).abs() < 1e-6, "{clock:?}");
    let fixes = crate::format::read_heading(&log).unwrap();
    for (i, fix) in fixes.iter().enumerate() {
        let true_s = BEGIN_S + 1.0 + 0.2 * i as f64;
        // Later by the shortest delay.
        assert!((fix.time_s - true_s - 0.003).abs() < 1e-4);
    }
}

#[test]
fn utc_that_nobody_disciplines_is_no_common_time() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| BEGIN_S + 0.04 + s, &clock_rows(",,,,"));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(!clock.is_kept);
    assert!((clock.offset_s + 0.037).abs() < 1e-4, "{clock:?}");
}

#[test]
fn seconds_of_the_day_get_their_date() {
    let folder = tempfile::tempdir().unwrap();
    let midnight_s = 86_400.0 * (BEGIN_S / 86_400.0).floor();
    let own = |s: f64| BEGIN_S + s - midnight_s;
    let log = recording(folder.path(), own, &clock_rows(DISCIPLINED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(clock.is_kept);
    assert_eq!(clock.offset_s, midnight_s);
}

#[test]
fn a_clock_that_is_set_moves_no_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = clock_rows(DISCIPLINED);
    let set = format!("{},100.0,{}0.500000\n", BEGIN_S + 100.5, DISCIPLINED);
    rows += &set;
    let log = recording(folder.path(), |s| 5.0 + s, &rows);
    let recording = RecordingClock::read(&log.with_file_name(CLOCK_LOG)).unwrap();
    assert_eq!(recording.steps, [(0.5, 100.0)]);
    assert!(!recording.is_disciplined());
    let fixes = crate::format::read_heading(&log).unwrap();
    let steps = fixes.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
    assert!(steps.map(|s| (s - 0.2).abs()).fold(0.0, f64::max) < 1e-5);
}

#[test]
fn gaps_and_cut_files_are_seen() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| 5.0 + s, &clock_rows(DISCIPLINED));
    let text = fs::read_to_string(stamps_of(&log)).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    // Nothing for 4 s, and half a row at the end.
    let kept = [&lines[..300], &lines[320..]].concat().join("\n");
    fs::write(stamps_of(&log), &kept[..kept.len() - 9]).unwrap();
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert_eq!(clock.gaps, 1);
    assert!((clock.longest_gap_s - 4.2).abs() < 0.01, "{clock:?}");
    // A log without stamps beside it is no recorded one.
    fs::remove_file(stamps_of(&log)).unwrap();
    assert_eq!(sensor_clock(&log).unwrap(), None);
    assert!(beside(&log).is_empty());
}

#[test]
fn a_sensor_that_was_started_again_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let own = |s: f64| if s < 100.0 { s } else { s - 100.0 };
    let log = recording(folder.path(), own, &clock_rows(DISCIPLINED));
    let error = sensor_clock(&log).unwrap_err().to_string();
    assert!(
        error.contains("compass.csv") && error.contains("go back"),
        "{error}"
    );
}
