use std::fs::{self, OpenOptions};
use std::io::Write;

use super::*;
use crate::format;
use crate::sensor::HeadingFix;

/// A growing log of headings, and the tail that follows it.
struct Growing {
    folder: tempfile::TempDir,
    tail: Tail,
    name: &'static str,
}

impl Growing {
    fn new(name: &'static str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join(name);
        let tail = Tail::new(&log);
        fs::write(log, "").unwrap();
        Self { folder, tail, name }
    }

    fn look(&mut self, common_s: f64, new: &str) -> Result<Vec<HeadingFix>> {
        let log = self.folder.path().join(self.name);
        let mut log = OpenOptions::new().append(true).open(log).unwrap();
        log.write_all(new.as_bytes()).unwrap();
        self.tail.next(common_s, |rows, times, clock| {
            let mut fixes = format::read_heading(rows)?;
            times.continue_times(&mut fixes);
            clock.put_on_common_time(&mut fixes);
            Ok(fixes)
        })
    }
}

/// A row of 20 bytes with a time of the sensor's clock.
fn heading_row(sensor_s: f64) -> String {
    format!("{sensor_s:012.3},90.000\n")
}

#[test]
fn a_row_whose_beginning_lies_before_the_window_is_left_out() {
    let mut growing = Growing::new("a.csv");
    growing.look(999.0, "time_s,heading_deg\n").unwrap();
    for second in 1000..1010 {
        let second = f64::from(second);
        growing.look(second, &heading_row(second)).unwrap();
    }
    // More bytes than the window holds arrive at once, so that it begins in the middle of a row's heading.
    let many: String = (1..20_000)
        .map(|k| heading_row(1010.0 + 1e-3 * f64::from(k)))
        .collect();
    let fixes = growing.look(1030.0, &many).unwrap();
    assert!(fixes.len() > 13_000, "{}", fixes.len());
    assert!(
        fixes
            .iter()
            .all(|fix| (1010.0..1031.0).contains(&fix.time_s))
    );
    let fixes = growing.look(1031.0, &heading_row(1031.0)).unwrap();
    assert_eq!(fixes.len(), 1);
}

#[test]
fn a_restarted_sensor_gets_a_new_offset() {
    let mut growing = Growing::new("a.csv");
    growing.look(8999.0, "time_s,heading_deg\n").unwrap();
    let mut fixes = Vec::new();
    for k in 0..60 {
        let common_s = 9000.0 + 0.5 * f64::from(k);
        let sensor_s = if k < 30 {
            common_s - 8000.0
        } else {
            common_s - 9010.0
        };
        fixes = growing.look(common_s, &heading_row(sensor_s)).unwrap();
        assert!(fixes.iter().all(|fix| (fix.time_s - common_s).abs() < 0.01));
    }
    assert_eq!(fixes.len(), 1);
}

#[test]
fn new_bytes_without_a_heading_are_no_error() {
    let sentence = |body: &str| {
        let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${body}*{sum:02X}\r\n")
    };
    let date = |second: u32| sentence(&format!("GPZDA,1200{second:02}.00,24,11,2025,00,00"));
    let mut growing = Growing::new("a.nmea");
    for second in 0..10 {
        let text = date(second) + &sentence("GPHDT,123.456,T");
        growing.look(f64::from(second), &text).unwrap();
    }
    let silent: String = (0..20_000).map(|k| date(10 + k / 1000)).collect();
    let fixes = growing.look(40.0, &silent).unwrap();
    assert!(fixes.is_empty());
}

#[test]
fn a_log_that_became_shorter_is_an_error() {
    for name in ["a.csv", "a.nmea"] {
        let mut growing = Growing::new(name);
        let _ = growing.look(1.0, "time_s,heading_deg\n1,90\n");
        fs::write(growing.folder.path().join(name), "time_s\n").unwrap();
        let error = growing.look(2.0, "").unwrap_err().to_string();
        assert!(
            error.contains(name) && error.contains("only grows"),
            "{error}"
        );
    }
}
