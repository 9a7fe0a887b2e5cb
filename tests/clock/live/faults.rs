//! Kills, cut logs, floods and a full disk: data recorded before are on the disk, and can be read.

use std::fs;
use std::io::Write;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use boresight::record::{Clock, Field, record};

use super::twin;
use crate::common::{self, boresight};

const LOGS: [&str; 4] = ["ins.sbg", "compass.nmea", "left.gocator", "right.gocator"];

/// The recording of a short drive.
fn recording() -> (tempfile::TempDir, PathBuf) {
    let (temp, drive) = common::simulated();
    let recording = temp.path().join("recording");
    twin::record(&drive.join("project.toml"), &recording);
    (temp, recording)
}

/// Asserts that each log is the beginning of the one that was played, and that `trajectory` reads the folder, or says
/// that it ends before the drive began.
fn assert_readable(folder: &Path, played: &Path, what: &str) {
    for name in LOGS {
        let Ok(recorded) = fs::read(folder.join(name)) else {
            continue;
        };
        let sent = fs::read(played.join(name)).unwrap();
        assert!(sent.starts_with(&recorded), "{what}: {name}");
    }
    let run = boresight(&["trajectory", folder.to_str().unwrap()]);
    let reasons = [
        "no ",
        "nothing",
        "empty",
        "needs",
        "overlap",
        "determine",
        "too short",
        "not found",
        "rest",
    ];
    let has_reason = reasons.iter().any(|word| run.err.contains(word));
    assert!(
        run.code == 0 || (run.code == 1 && has_reason),
        "{what}: {}",
        run.err
    );
    assert!(!run.err.contains("panicked"), "{what}: {}", run.err);
}

/// Cuts a recording off at random places and reads the rest.
fn cut(times: u32) {
    let (temp, recording) = recording();
    let names = common::names(&recording);
    let mut seed = 1_u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 33) as f64 / (1_u64 << 31) as f64
    };
    for number in 0..times {
        let cut = temp.path().join(format!("cut-{number}"));
        fs::create_dir(&cut).unwrap();
        // The drive begins in the first third; a power cut ends all files at nearly the same time.
        let share = 0.4 + 0.6 * random();
        for name in &names {
            let bytes = fs::read(recording.join(name)).unwrap();
            let is_log = !name.ends_with(".toml");
            let length = if is_log {
                (bytes.len() as f64 * share) as usize + (40.0 * random()) as usize
            } else {
                bytes.len()
            };
            fs::write(cut.join(name), &bytes[..length.min(bytes.len())]).unwrap();
        }
        let run = boresight(&["trajectory", cut.to_str().unwrap()]);
        assert_eq!(run.code, 0, "{share}: {}", run.err);
    }
}

#[test]
fn a_recording_that_was_cut_off_is_read() {
    cut(3);
}

#[test]
#[ignore = "just acceptance"]
fn a_recording_that_was_cut_off_at_a_dozen_places_is_read() {
    cut(12);
}

/// A power cut may end a log and its times of arrival at different moments, and damage either.
#[test]
fn a_log_that_does_not_end_with_its_times_of_arrival_keeps_its_clock() {
    let (temp, recording) = recording();
    let times_s = |folder: &Path| -> Vec<f64> {
        let points = super::points(&folder.join("left.gocator"));
        points.iter().map(|point| point.time_s).collect()
    };
    let whole = times_s(&recording);
    let [log, stamps] = ["left.gocator", "left.stamps.csv"];
    let bytes = fs::read(recording.join(log)).unwrap();
    let rows = fs::read_to_string(recording.join(stamps)).unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    // Pieces missing at the end of the log, rows missing at the end of the times, and whether a row in the middle is
    // damaged.
    for (number, (missing_pieces, missing_stamps, is_damaged)) in
        [(0, 5, false), (5, 0, false), (0, 0, true)]
            .into_iter()
            .enumerate()
    {
        let cut = temp.path().join(format!("apart-{number}"));
        fs::create_dir(&cut).unwrap();
        for name in common::names(&recording) {
            fs::copy(recording.join(&name), cut.join(&name)).unwrap();
        }
        let before: usize = rows[rows.len() - missing_pieces.max(1)]
            .split_once(',')
            .unwrap()
            .0
            .parse()
            .unwrap();
        let end = if missing_pieces > 0 {
            before
        } else {
            bytes.len()
        };
        fs::write(cut.join(log), &bytes[..end]).unwrap();
        let mut kept_rows = rows[..rows.len() - missing_stamps].to_vec();
        if is_damaged {
            kept_rows[rows.len() / 2] = "\u{fffd}17";
        }
        fs::write(cut.join(stamps), kept_rows.join("\n") + "\n").unwrap();
        let read = times_s(&cut);
        assert!(read.len() + 6 * 320 > whole.len());
        for (read, whole) in read.iter().zip(&whole) {
            assert!((read - whole).abs() < 1e-5, "{number}: {read} {whole}");
        }
    }
}

/// Kills recordings, each a little later than the last.
fn kill(times: u32) {
    let (temp, recording) = recording();
    for number in 0..times {
        let out = temp.path().join(format!("killed-{number}"));
        let [from, to] = [&recording, &out].map(|path| path.to_str().unwrap());
        let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .args(["replay", from, "--speed", "10", "--out", to, "--quiet"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let wait_s = 1.5 + 0.097 * f64::from(number % 50);
        std::thread::sleep(Duration::from_secs_f64(wait_s));
        let is_running = child.try_wait().unwrap().is_none();
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(is_running, "the recording ended within {wait_s} s");
        assert_readable(&out, &recording, &format!("after {wait_s:.2} s"));
        // At most the last second of real time is lost, which is ten seconds of the recording; playing begins after a
        // lead of one second.
        let stamps = fs::read_to_string(out.join("ins.stamps.csv")).unwrap();
        let last = stamps
            .lines()
            .rev()
            .nth(1)
            .and_then(|row| row.split(',').nth(1));
        let recorded_s = last
            .and_then(|cell| cell.parse::<f64>().ok())
            .unwrap_or(0.0);
        assert!(
            recorded_s > 10.0 * (wait_s - 1.5),
            "{recorded_s} s recorded after {wait_s} s"
        );
        fs::remove_dir_all(&out).unwrap();
    }
}

#[test]
fn a_recording_that_is_killed_keeps_all_but_the_last_second() {
    kill(1);
}

#[test]
#[ignore = "just acceptance"]
fn fifty_kills_lose_no_more_than_the_last_second() {
    kill(50);
}

/// Starts a server that sends lines without pause; returns its address.
fn flood(stop: Arc<AtomicBool>, sent: Arc<AtomicU64>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let block = b"0123456789abcde\n".repeat(4096);
        // At most 1 GB.
        for _ in 0..16_000 {
            if stop.load(Ordering::Relaxed) || stream.write_all(&block).is_err() {
                return;
            }
            sent.fetch_add(block.len() as u64, Ordering::Relaxed);
        }
    });
    address
}

/// Starts a server that sends a line every 10 ms; returns its address.
fn ticks(stop: Arc<AtomicBool>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.set_nodelay(true).unwrap();
        for number in 0..10_000 {
            if stop.load(Ordering::Relaxed) || writeln!(stream, "{number}").is_err() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    address
}

fn field(folder: &Path, sources: &[(&str, String)]) -> Field {
    let path = folder.join("field.toml");
    let text: String = sources
        .iter()
        .map(|(name, address)| {
            format!("[[source]]\nname = \"{name}\"\nkind = \"lines\"\nheader = \"number\"\naddress = \"{address}\"\n")
        })
        .collect();
    fs::write(&path, text).unwrap();
    Field::read(&path).unwrap()
}

#[test]
fn a_source_that_floods_delays_no_other() {
    let temp = tempfile::tempdir().unwrap();
    let (stop, sent) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicU64::new(0)),
    );
    let sources = [
        ("flood", flood(Arc::clone(&stop), Arc::clone(&sent))),
        ("ticks", ticks(Arc::clone(&stop))),
    ];
    let field = field(temp.path(), &sources);
    let folder = temp.path().join("drive");
    record(&field, &folder, &Clock::default(), |view| view.time_s < 4.0).unwrap();
    stop.store(true, Ordering::Relaxed);
    let flooded = fs::metadata(folder.join("flood.csv")).unwrap().len();
    assert!(flooded > 20_000_000, "{flooded} bytes");
    let text = fs::read_to_string(folder.join("ticks.csv")).unwrap();
    let rows: Vec<(f64, u64)> = text
        .lines()
        .skip(1)
        .map(|row| {
            let (time, number) = row.split_once(',').unwrap();
            (time.parse().unwrap(), number.parse().unwrap())
        })
        .collect();
    assert!(rows.len() > 200, "{} rows", rows.len());
    assert!(rows.windows(2).all(|pair| pair[1].1 == pair[0].1 + 1));
    let longest = rows
        .windows(2)
        .map(|pair| pair[1].0 - pair[0].0)
        .fold(0.0, f64::max);
    assert!(longest < 0.5, "{longest} s");
}

/// A disk of two megabytes, if the user may mount one; unmounted at the end.
#[cfg(target_os = "linux")]
struct SmallDisk(tempfile::TempDir);

#[cfg(target_os = "linux")]
impl SmallDisk {
    fn new() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"])
            .arg(folder.path())
            .stderr(Stdio::null())
            .status();
        mounted
            .is_ok_and(|status| status.success())
            .then_some(Self(folder))
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_recording_with_an_error_that_names_the_file() {
    let Some(disk) = SmallDisk::new() else {
        println!("skipped: this user may not mount a disk");
        return;
    };
    let temp = tempfile::tempdir().unwrap();
    let (stop, sent) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicU64::new(0)),
    );
    let field = field(temp.path(), &[("flood", flood(Arc::clone(&stop), sent))]);
    let folder = disk.0.path().join("drive");
    let begun = Instant::now();
    let error = record(&field, &folder, &Clock::default(), |view| {
        view.time_s < 20.0
    })
    .unwrap_err();
    stop.store(true, Ordering::Relaxed);
    assert!(begun.elapsed() < Duration::from_secs(10));
    let error = error.to_string();
    assert!(
        error.contains("flood") && error.contains("space"),
        "{error}"
    );
    // Data written before are on the disk.
    let bytes = fs::metadata(folder.join("flood.csv")).unwrap().len();
    assert!(bytes > 500_000, "{bytes} bytes");
}
