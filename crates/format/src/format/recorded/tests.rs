use std::fs;
use std::path::{Path, PathBuf};

use super::*;
use crate::format::file::{CLOCK_LOG, EVENT_LOG};
use crate::sensor::{Observations, TotalStation, VerticalAngle};
use crate::statistics::drawn;

const BEGIN_S: f64 = 1_764_000_000.0;

/// A random number from 0 to 1.
fn random(i: u64) -> f64 {
    (drawn(i) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A recording of a heading sensor at 5 Hz for 200 s. `sensor_s` gives the sensor time at a true time; records arrive
/// with delays of 3 to 7 ms.
fn recording(folder: &Path, sensor_s: impl Fn(f64) -> f64, clock_rows: &str) -> PathBuf {
    let log = folder.join("compass.csv");
    let mut text = "time_s,heading_deg\n".to_owned();
    let mut stamps = "bytes_before,monotonic_s,unix_s\n0,0.5,0\n".to_owned();
    for i in 0..1000_u32 {
        let true_s = 1.0 + 0.2 * f64::from(i);
        let arrival_s = true_s + 0.003 + 0.004 * random(u64::from(i));
        stamps += &format!("{},{arrival_s:.6},0\n", text.len());
        text += &format!("{:.6},{}\n", sensor_s(true_s), i % 360);
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

const SYNCHRONISED: &str = "PPS,0.000000100,0.000000200,1,";

#[test]
fn sensor_times_in_utc_are_kept_if_the_system_clock_is_synchronised() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| BEGIN_S + s, &clock_rows(SYNCHRONISED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(clock.is_synchronised && clock.offset_s == 0.0, "{clock:?}");
    assert!((clock.delay_median_s - 0.005).abs() < 3e-4, "{clock:?}");
    assert!((0.0068..0.00701).contains(&clock.delay_999_s), "{clock:?}");
    let fixes = crate::format::read_heading(&log).unwrap();
    assert!((fixes[0].time_s - BEGIN_S - 1.0).abs() < 1e-6);
}

#[test]
fn an_independent_clock_gets_offset_and_drift_from_the_arrival_times() {
    let folder = tempfile::tempdir().unwrap();
    let sensor_s = |s: f64| 77.0 + s * (1.0 - 5e-5);
    let log = recording(folder.path(), sensor_s, &clock_rows(SYNCHRONISED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(!clock.is_synchronised);
    assert!((clock.drift - 5e-5).abs() < 1e-6, "{clock:?}");
    let fixes = crate::format::read_heading(&log).unwrap();
    for (i, fix) in fixes.iter().enumerate() {
        let true_s = BEGIN_S + 1.0 + 0.2 * i as f64;
        // Later by the shortest delay.
        assert!((fix.time_s - true_s - 0.003).abs() < 1e-4);
    }
}

#[test]
fn sensor_times_in_utc_are_not_kept_if_the_system_clock_is_not_synchronised() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| BEGIN_S + 0.04 + s, &clock_rows(",,,,"));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(!clock.is_synchronised);
    assert!((clock.offset_s + 0.037).abs() < 1e-4, "{clock:?}");
}

#[test]
fn sensor_times_in_utc_are_not_kept_if_checks_of_the_system_clock_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| BEGIN_S + s, &clock_rows(SYNCHRONISED));
    let clock_log = log.with_file_name(CLOCK_LOG);
    let is_synchronised = || sensor_clock(&log).unwrap().unwrap().is_synchronised;
    let is_synchronised_with = |row: &str| {
        change(&clock_log, |lines| lines[100] = row.into());
        is_synchronised()
    };
    let row = format!("{},99,{SYNCHRONISED}", BEGIN_S + 99.0);
    assert!(is_synchronised_with(&row));
    for damage in [
        "x",
        "\0\0",
        &format!("{row}x"),
        &row.replace(",99,", ",9900,"),
    ] {
        assert!(!is_synchronised_with(damage), "{damage:?}");
        let recording = RecordingClock::read(&clock_log).unwrap();
        assert!(recording.damaged > 0, "{damage:?}");
    }
    assert!(is_synchronised_with(&row));
    // A kill costs the last checks.
    change(&clock_log, |lines| lines.truncate(195));
    assert!(is_synchronised());
    change(&clock_log, |lines| lines.truncate(11));
    assert!(!is_synchronised());
    let recording = RecordingClock::read(&clock_log).unwrap();
    let unchecked_s = recording.unchecked_s(BEGIN_S + 200.0);
    assert!((unchecked_s - 191.0).abs() < 1e-6, "{unchecked_s}");
}

#[test]
fn seconds_of_the_day_get_the_date_of_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let midnight_s = 86_400.0 * (BEGIN_S / 86_400.0).floor();
    let sensor_s = |s: f64| BEGIN_S + s - midnight_s;
    let log = recording(folder.path(), sensor_s, &clock_rows(SYNCHRONISED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(clock.is_synchronised);
    assert_eq!(clock.offset_s, midnight_s);
}

#[test]
fn setting_the_system_clock_shifts_no_sensor_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = clock_rows(SYNCHRONISED);
    let set = format!("{},100.0,{}0.500000\n", BEGIN_S + 100.5, SYNCHRONISED);
    rows += &set;
    let log = recording(folder.path(), |s| 5.0 + s, &rows);
    let recording = RecordingClock::read(&log.with_file_name(CLOCK_LOG)).unwrap();
    let (set_s, at_s) = (0.5, 100.0);
    assert_eq!(recording.steps, [ClockStep { set_s, at_s }]);
    assert!(!recording.is_synchronised(BEGIN_S));
    let fixes = crate::format::read_heading(&log).unwrap();
    let steps = fixes.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
    assert!(steps.map(|s| (s - 0.2).abs()).fold(0.0, f64::max) < 1e-5);
}

#[test]
fn gaps_and_truncated_files_are_recognised() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| 5.0 + s, &clock_rows(SYNCHRONISED));
    let text = fs::read_to_string(stamps_of(&log)).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    // Nothing arrives for 4 s, and the last row is cut off.
    let remaining = [&lines[..300], &lines[320..]].concat().join("\n");
    fs::write(stamps_of(&log), &remaining[..remaining.len() - 9]).unwrap();
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert_eq!(clock.gaps, 1);
    assert!((clock.longest_gap_s - 4.2).abs() < 0.01, "{clock:?}");
    // A log without arrival times is not part of a recording.
    fs::remove_file(stamps_of(&log)).unwrap();
    assert_eq!(sensor_clock(&log).unwrap(), None);
    assert!(beside(&log).is_empty());
}

#[test]
fn the_log_of_a_restarted_sensor_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let sensor_s = |s: f64| if s < 100.0 { s } else { s - 100.0 };
    let log = recording(folder.path(), sensor_s, &clock_rows(SYNCHRONISED));
    let error = sensor_clock(&log).unwrap_err().to_string();
    assert!(
        error.contains("compass.csv") && error.contains("go back"),
        "{error}"
    );
}

/// Changes the lines of a file.
fn change(path: &Path, how: impl FnOnce(&mut Vec<String>)) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    how(&mut lines);
    fs::write(path, lines.join("\n") + "\n").unwrap();
}

/// Asserts that damage to a log or its arrival times changes neither the clock nor any time.
fn assert_same_clock(damage: impl Fn(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| BEGIN_S + s, &clock_rows(SYNCHRONISED));
    damage(&log);
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!(clock.is_synchronised && clock.gaps == 0, "{clock:?}");
    assert!((0.0068..0.00701).contains(&clock.delay_999_s), "{clock:?}");

    let sensor_s = |s: f64| 77.0 + s * (1.0 - 5e-5);
    let log = recording(folder.path(), sensor_s, &clock_rows(SYNCHRONISED));
    damage(&log);
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert!((clock.drift - 5e-5).abs() < 1e-6, "{clock:?}");
    let fixes = crate::format::read_heading(&log).unwrap();
    for (i, fix) in fixes.iter().enumerate() {
        let true_s = BEGIN_S + 1.0 + 0.2 * i as f64;
        assert!((fix.time_s - true_s - 0.003).abs() < 1e-4, "{i}");
    }
}

#[test]
fn a_log_that_continues_after_its_arrival_times_has_the_same_clock() {
    for rows in [1, 5, 300] {
        assert_same_clock(|log| change(&stamps_of(log), |lines| lines.truncate(1001 - rows)));
    }
}

#[test]
fn a_log_that_ends_before_its_arrival_times_has_the_same_clock() {
    for rows in [1, 5, 300] {
        assert_same_clock(|log| change(log, |lines| lines.truncate(1001 - rows)));
    }
}

#[test]
fn damaged_arrival_times_do_not_change_the_clock() {
    for damage in [
        "17,",
        "\0\0\0",
        "2,17.5,0",
        "999999999,141,0",
        "6600,9999,0",
        "x",
    ] {
        assert_same_clock(|log| change(&stamps_of(log), |lines| lines[500] = damage.into()));
    }
}

#[test]
fn missing_arrival_times_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| 5.0 + s, &clock_rows(SYNCHRONISED));
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert_eq!(clock.damaged_arrivals, 0);
    assert!(clock.beyond_arrivals_s < 0.21, "{clock:?}");
    change(&stamps_of(&log), |lines| {
        lines.truncate(990);
        lines[300] = "x".into();
        lines[400] = "y".into();
    });
    let clock = sensor_clock(&log).unwrap().unwrap();
    assert_eq!(clock.damaged_arrivals, 2);
    assert!((clock.beyond_arrivals_s - 2.6).abs() < 0.21, "{clock:?}");
    change(&stamps_of(&log), |lines| lines.truncate(1));
    let error = sensor_clock(&log).unwrap_err().to_string();
    assert!(
        error.contains("compass.stamps.csv") && error.contains("any of 1000 records"),
        "{error}"
    );
}

#[test]
fn pieces_with_damaged_arrival_times_keep_their_places_and_the_largest_size() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording(folder.path(), |s| 5.0 + s, &clock_rows(SYNCHRONISED));
    let pieces = || -> Vec<(usize, f64)> { Pieces::open(&log).unwrap().collect() };
    let whole = pieces();
    change(&stamps_of(&log), |lines| lines[500] = "x".into());
    let damaged = pieces();
    assert_eq!(damaged.len(), whole.len() - 1);
    assert_eq!(damaged[498].0, whole[498].0 + whole[499].0);
    assert_eq!(damaged[499..], whole[500..]);
    let bytes = |pieces: &[(usize, f64)]| pieces.iter().map(|piece| piece.0).sum::<usize>();
    assert_eq!(bytes(&damaged), bytes(&whole));
    // Rows that contradict the others, one of them the first and one the last.
    for (line, row) in [
        (1, "70,9999,0"),
        (700, "999999999,141,0"),
        (800, "PLACE,9999,0"),
        (1001, "2,17.5,0"),
    ] {
        let text = fs::read_to_string(stamps_of(&log)).unwrap();
        change(&stamps_of(&log), |lines| {
            let place = lines[line].split(',').next().unwrap_or_default();
            lines[line] = row.replace("PLACE", place);
        });
        let damaged = pieces();
        assert_eq!(bytes(&damaged), bytes(&whole), "{row}");
        assert!(damaged.is_sorted_by(|a, b| a.1 <= b.1), "{row}");
        let last_s = Pieces::open(&log).unwrap().last_s();
        assert!((200.0..202.0).contains(&last_s), "{row}: {last_s}");
        fs::write(stamps_of(&log), text).unwrap();
    }
    // A log that continues after its last arrival time.
    change(&stamps_of(&log), |lines| lines.truncate(3));
    fs::write(&log, vec![b'1'; 5 << 20]).unwrap();
    assert!(pieces().iter().all(|piece| piece.0 <= 1 << 20));
}

#[test]
fn times_of_a_total_station_are_corrected_before_and_after_it_is_switched_off() {
    let folder = tempfile::tempdir().unwrap();
    recording(folder.path(), |s| s, &clock_rows(SYNCHRONISED));
    let log = folder.path().join("station.csv");
    let mut text = "time_s,slope_distance_m,horizontal_deg,vertical_deg,status,monotonic_s,round_trip_s,synchronous,\
                    instrument_time_s\n"
        .to_owned();
    let true_s = |i: u32| 2.0 + f64::from(i) / 7.0;
    for i in 0..1200 {
        let instrument_s = if i < 700 {
            4000.0 + true_s(i)
        } else {
            true_s(i) - true_s(700) + 8.0
        };
        let arrival_s = true_s(i) + 0.005 + 0.02 * random(u64::from(i));
        let time_s = BEGIN_S + arrival_s - 0.004;
        text += &format!("{time_s:.6},10,45,90,0,{arrival_s:.6},0.008,1,{instrument_s:.3}\n");
    }
    fs::write(&log, text).unwrap();
    let instrument = TotalStation {
        station_m: crate::geometry::Vec3::zeros(),
        orientation_rad: 0.0,
        vertical: VerticalAngle::Zenith,
        reflector_constant_m: 0.0,
        sigma_distance_m: 0.001,
        sigma_distance_ppm: 1.0,
        sigma_angle_rad: 5e-6,
        sigma_prism_m: 0.005,
    };
    let positions = crate::format::read_positions(&log, &Observations::Polar(instrument)).unwrap();
    for (i, fix) in positions.fixes.iter().enumerate() {
        // The instrument's times are rounded to milliseconds.
        let off_s = fix.time_s - BEGIN_S - true_s(i as u32) - 0.005;
        assert!(off_s.abs() < 2e-3, "{i}: {off_s}");
    }
}
