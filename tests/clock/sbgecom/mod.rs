//! sbgECom streams made by the manufacturer's library (SBG-Systems/sbgECom on GitHub, 5.2.590): the recording is the
//! same byte for byte, and this program reads the same values as the library.
//!
//! The library is not part of this repository. BORESIGHT_SBGECOM names the folder where it is installed, with
//! `include/sbgEComLib.h` and `lib/libsbgECom.a`.

#![cfg(unix)]

mod damage;
mod maker;

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use boresight::format;
use boresight::geometry::Projection;
use boresight::sensor::{GeographicFix, Observations, project_fixes};
use damage::{damage, intact_frames};
use maker::{Maker, Reading};

/// The names of the messages that are made.
const NAMES: [((u8, u8), &str); 9] = [
    ((0, 1), "STATUS"),
    ((0, 2), "UTC_TIME"),
    ((0, 3), "IMU_DATA"),
    ((0, 6), "EKF_EULER"),
    ((0, 7), "EKF_QUAT"),
    ((0, 8), "EKF_NAV"),
    ((0, 14), "GPS1_POS"),
    ((0, 15), "GPS1_HDT"),
    ((0, 44), "IMU_SHORT"),
];

/// The recorder of one sensor, in a folder.
struct Recorder {
    child: Child,
    log: PathBuf,
}

impl Recorder {
    fn start(folder: &Path, address: &str) -> Self {
        let field = folder.join("field.toml");
        let source =
            format!("[[source]]\nname = \"ins\"\nkind = \"sbg\"\naddress = \"{address}\"\n");
        fs::write(&field, source).unwrap();
        let drive = folder.join("drive");
        let child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .arg("record")
            .args([&field, Path::new("--out"), &drive])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self {
            child,
            log: drive.join("ins.sbg"),
        }
    }

    fn recorded(&self) -> u64 {
        fs::metadata(&self.log).map_or(0, |log| log.len())
    }

    /// Stops it like Ctrl-C once `size` bytes are recorded; returns the recorded bytes.
    fn stop_at(mut self, size: usize) -> Vec<u8> {
        let deadline = Instant::now() + Duration::from_secs(120);
        while self.recorded() < size as u64 && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(100));
        }
        let stop = Command::new("kill")
            .args(["-INT", &self.child.id().to_string()])
            .status();
        assert!(stop.unwrap().success());
        let ended = self.child.wait().unwrap();
        assert!(matches!(ended.code(), Some(0 | 130)), "{ended}");
        fs::read(&self.log).unwrap()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // Still running only if a check failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A port that was free a moment ago.
fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

/// Converts the library's stamps to UTC by its UTC_TIME messages.
struct Clock {
    /// Time of the device in µs and UTC in ns.
    pairs: Vec<(i64, i64)>,
}

/// Stamps without their roll-over.
fn unwrapped(stamps: impl Iterator<Item = u32>) -> Vec<i64> {
    let (mut last, mut turns) = (None, 0);
    let times = stamps.map(|stamp| {
        if last.is_some_and(|last| stamp < last) {
            turns += 1;
        }
        last = Some(stamp);
        (turns << 32) + i64::from(stamp)
    });
    times.collect()
}

impl Clock {
    fn of(reading: &Reading) -> Self {
        let stamps = unwrapped(reading.utc.iter().map(|utc| utc.stamp_us));
        let pairs = stamps.into_iter().zip(&reading.utc);
        Self {
            pairs: pairs
                .filter(|(_, utc)| utc.is_accurate)
                .map(|(device_us, utc)| (device_us, utc.unix_ns))
                .collect(),
        }
    }

    fn time_s(&self, device_us: i64) -> f64 {
        let next = self.pairs.partition_point(|(us, _)| *us <= device_us);
        let before = self.pairs[next.saturating_sub(1)];
        let after = self.pairs[next.min(self.pairs.len() - 1)];
        let since_ns = 1000.0 * (device_us - before.0) as f64;
        let passed_ns = if after.0 == before.0 {
            since_ns
        } else {
            since_ns * (after.1 - before.1) as f64 / (1000.0 * (after.0 - before.0) as f64)
        };
        before.1 as f64 / 1e9 + passed_ns / 1e9
    }
}

/// Compares the values read from a log with those of the library; returns how many agree.
fn assert_same_values(log: &Path, maker: &Reading) -> usize {
    let clock = Clock::of(maker);
    let same_time = |time_s: f64, device_us: i64| {
        let expected = clock.time_s(device_us);
        assert!(
            (time_s - expected).abs() < 1e-6,
            "{time_s} is not {expected}"
        );
    };
    let mut values = 0;

    let found = format::read_imu(log).unwrap();
    let stamps = unwrapped(maker.imu.iter().map(|imu| imu.stamp_us));
    let expected: Vec<_> = stamps
        .into_iter()
        .zip(&maker.imu)
        // Samples without communication with the IMU are not valid.
        .filter(|(_, imu)| imu.status & 1 == 1)
        .collect();
    assert_eq!(found.len(), expected.len());
    for (found, (device_us, imu)) in found.iter().zip(expected) {
        same_time(found.time_s, device_us);
        let found: Vec<f64> = found
            .gyro_rad_s
            .iter()
            .chain(&found.accel_m_s2)
            .copied()
            .collect();
        let gyro_scale = if imu.status & (1 << 10) == 0 {
            67_108_864.0
        } else {
            12_304_174.0
        };
        for (nth, &found) in found.iter().enumerate() {
            let value = f64::from(imu.values[nth]);
            match imu.raw {
                Some(raw) => {
                    let scale = if nth < 3 { gyro_scale } else { 1_048_576.0 };
                    assert_eq!(found, f64::from(raw[nth]) / scale);
                    // The library computes in single precision, 24 bits.
                    assert!(
                        (found - value).abs() <= 1.2e-7 * value.abs(),
                        "{found}: {value}"
                    );
                }
                None => assert_eq!(found, value),
            }
        }
        values += 7;
    }

    let found = format::read_heading(log).unwrap();
    let stamps = unwrapped(maker.headings.iter().map(|it| it.stamp_us));
    let expected: Vec<_> = stamps
        .into_iter()
        .zip(&maker.headings)
        .filter(|(_, heading)| heading.is_valid)
        .collect();
    assert_eq!(found.len(), expected.len());
    for (found, (device_us, heading)) in found.iter().zip(expected) {
        same_time(found.time_s, device_us);
        let [course, accuracy, pitch, pitch_accuracy] =
            heading.degrees.map(|it| f64::from(it).to_radians());
        assert_eq!(
            (found.heading_rad, found.sigma_rad),
            (course, Some(accuracy))
        );
        let pitch = heading.is_pitch_valid.then_some((pitch, pitch_accuracy));
        assert_eq!(found.pitch_rad.zip(found.pitch_sigma_rad), pitch);
        values += 5;
    }

    // Both are projected by the same function, so that this compares latitudes and longitudes.
    let system = Projection::new("EPSG:25832").unwrap();
    let found = format::read_projected_positions(log, &Observations::AsFound, Some(&system));
    let found = found.unwrap().fixes;
    let stamps = unwrapped(maker.positions.iter().map(|it| it.stamp_us));
    let (stamps, expected): (Vec<i64>, Vec<GeographicFix>) = stamps
        .into_iter()
        .zip(&maker.positions)
        .filter(|(_, position)| position.is_valid)
        .map(|(device_us, position)| (device_us, position.fix()))
        .unzip();
    let expected = project_fixes(&expected, &system).unwrap();
    assert_eq!(found.len(), expected.len());
    for ((found, expected), device_us) in found.iter().zip(&expected).zip(stamps) {
        same_time(found.time_s, device_us);
        assert_eq!(found.position_m, expected.position_m);
        assert_eq!(found.covariance_m2, expected.covariance_m2);
        values += 7;
    }
    values
}

/// Compares the counts that `inspect` reports with those of the library: frames of each kind, and all other bytes.
fn assert_same_counts(log: &Path, maker: &Reading) {
    let notes = format::inspect(log).unwrap().notes;
    let note = notes.iter().find(|note| note.contains("STATUS")).unwrap();
    let parts: Vec<&str> = note.split(", ").collect();
    let other_bytes = fs::metadata(log).unwrap().len() - maker.frame_bytes;
    let damaged = (other_bytes > 0).then(|| format!("{other_bytes} damaged bytes"));
    let kinds = maker.frames.iter().map(|(kind, frames)| {
        let name = NAMES.iter().find(|(known, _)| known == kind).unwrap().1;
        format!("{frames} {name}")
    });
    let expected: Vec<String> = kinds.chain(damaged).collect();
    assert_eq!(parts.len(), expected.len(), "{note}");
    for (part, expected) in parts.iter().zip(&expected) {
        // The number of unusable frames, or of damaged places, may follow.
        let rest = part.strip_prefix(expected.as_str());
        let ends = |it: &str| it.is_empty() || it.starts_with(" (") || it.starts_with(" in ");
        assert!(rest.is_some_and(ends), "{part}: {expected}");
    }
}

/// Compares a log without times of arrival with the library's reading of it.
fn assert_same(what: &str, maker: &Maker, bytes: &[u8]) -> Reading {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("ins.sbg");
    fs::write(&log, bytes).unwrap();
    let reading = maker.read(&log);
    let values = assert_same_values(&log, &reading);
    assert_same_counts(&log, &reading);
    let frames: u64 = reading.frames.values().sum();
    println!(
        "{what}: {} bytes, {frames} frames, {values} values agree",
        bytes.len()
    );
    reading
}

/// Checks that exactly the intact frames of a damaged stream are read.
fn assert_intact_read(reading: &Reading, sent: &[u8], damaged: &[u8]) {
    let frames: u64 = reading.frames.values().sum();
    assert_eq!((frames, reading.frame_bytes), intact_frames(sent, damaged));
    let other_bytes = damaged.len() as u64 - reading.frame_bytes;
    println!("all intact frames are read, {other_bytes} bytes lie outside of them");
    assert!(other_bytes > sent.len() as u64 / 200, "hardly damaged");
}

#[test]
#[ignore = "needs the library sbgECom in the folder BORESIGHT_SBGECOM"]
fn an_hour_over_tcp_is_recorded_and_read_as_by_the_library() {
    let (maker, folder) = (Maker::build(), tempfile::tempdir().unwrap());
    let sent = maker.make_file(3600, "short", &folder.path().join("sent.sbg"));
    let port = free_port();
    let mut sensor = maker.make(3600, "short", "tcp", &port.to_string());
    let recorder = Recorder::start(folder.path(), &format!("127.0.0.1:{port}"));
    let recorded = recorder.stop_at(sent.len());
    assert!(sensor.wait().unwrap().success());
    assert!(
        recorded == sent,
        "{} bytes of {}",
        recorded.len(),
        sent.len()
    );
    assert_same("an hour over TCP", &maker, &recorded);
}

#[test]
#[ignore = "needs the library sbgECom in the folder BORESIGHT_SBGECOM"]
fn two_minutes_over_udp_are_recorded_and_read_as_by_the_library() {
    let (maker, folder) = (Maker::build(), tempfile::tempdir().unwrap());
    let sent = maker.make_file(120, "short", &folder.path().join("sent.sbg"));
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port();
    drop(socket);
    let recorder = Recorder::start(folder.path(), &format!("udp://127.0.0.1:{port}"));
    let events = recorder.log.with_file_name("events.csv");
    let deadline = Instant::now() + Duration::from_secs(20);
    while !fs::read_to_string(&events).is_ok_and(|text| text.contains("connected")) {
        assert!(Instant::now() < deadline, "does not listen");
        std::thread::sleep(Duration::from_millis(50));
    }
    let mut sensor = maker.make(120, "short", "udp", &port.to_string());
    assert!(sensor.wait().unwrap().success());
    let recorded = recorder.stop_at(sent.len());
    assert!(
        recorded == sent,
        "{} bytes of {}",
        recorded.len(),
        sent.len()
    );
    assert_same("two minutes over UDP", &maker, &recorded);
}

#[test]
#[ignore = "needs the library sbgECom in the folder BORESIGHT_SBGECOM"]
fn all_intact_frames_of_a_damaged_hour_are_read() {
    let (maker, folder) = (Maker::build(), tempfile::tempdir().unwrap());
    let sent = maker.make_file(3600, "short", &folder.path().join("sent.sbg"));
    let damaged = damage(&sent);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let recorded = std::thread::scope(|scope| {
        scope.spawn(|| {
            let (mut client, _) = listener.accept().unwrap();
            client.write_all(&damaged).unwrap();
            // The client hangs up.
            let _ = client.read(&mut [0]);
        });
        Recorder::start(folder.path(), &address).stop_at(damaged.len())
    });
    assert!(recorded == damaged, "{} bytes", recorded.len());
    let reading = assert_same("an hour with damage", &maker, &recorded);
    assert_intact_read(&reading, &sent, &recorded);
}

#[test]
#[ignore = "needs the library sbgECom in the folder BORESIGHT_SBGECOM"]
fn imu_data_messages_are_read_as_by_the_library() {
    let (maker, folder) = (Maker::build(), tempfile::tempdir().unwrap());
    let sent = maker.make_file(600, "data", &folder.path().join("sent.sbg"));
    assert_same("IMU_DATA", &maker, &sent);
    let damaged = damage(&sent);
    let reading = assert_same("IMU_DATA with damage", &maker, &damaged);
    assert_intact_read(&reading, &sent, &damaged);
}
