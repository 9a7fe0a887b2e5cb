//! Recording: all data that arrive are stored with their times of arrival, whatever happens to links, clock and
//! program.

use std::fs;
use std::io::Write;
use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::common::{boresight, named, side_by_side};
use boresight::format;
use boresight::record::geocom::simulated::{Simulated, TcpInstrument};
use boresight::record::{Clock, Field, View, record};
use boresight::sensor::Observations;

/// Position of the simulated instrument's prism, metres.
fn target(time_s: f64) -> [f64; 3] {
    [2.0 + 0.5 * time_s, 20.0, 1.0]
}

fn station() -> TcpInstrument {
    TcpInstrument::listen("127.0.0.1:0", Simulated::new(Default::default(), target)).unwrap()
}

/// A TCP server that sends lines, and is unreachable while `is_dead` is set.
struct LineServer {
    address: String,
    stop: Arc<AtomicBool>,
    is_dead: Arc<AtomicBool>,
    sent: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl LineServer {
    fn new(line: impl Fn(u64) -> String + Send + 'static, interval: Duration) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let (stop, is_dead, sent) = (Arc::default(), Arc::default(), Arc::default());
        let shared: (Arc<AtomicBool>, Arc<AtomicBool>, Arc<AtomicU64>) =
            (Arc::clone(&stop), Arc::clone(&is_dead), Arc::clone(&sent));
        let thread = std::thread::spawn(move || {
            let (stop, is_dead, sent) = shared;
            let mut listener = Some(listener);
            while !stop.load(Ordering::Relaxed) {
                if is_dead.load(Ordering::Relaxed) {
                    listener = None;
                    std::thread::sleep(Duration::from_millis(20));
                    continue;
                }
                let open = listener.get_or_insert_with(|| TcpListener::bind(address).unwrap());
                open.set_nonblocking(true).unwrap();
                let Ok((mut stream, _)) = open.accept() else {
                    std::thread::sleep(Duration::from_millis(5));
                    continue;
                };
                // The recorder leaves out what comes before the first line end.
                let _ = stream.write_all(b"\n");
                while !stop.load(Ordering::Relaxed) && !is_dead.load(Ordering::Relaxed) {
                    let number = sent.load(Ordering::Relaxed);
                    if stream.write_all(line(number).as_bytes()).is_err() {
                        break;
                    }
                    sent.store(number + 1, Ordering::Relaxed);
                    std::thread::sleep(interval);
                }
            }
        });
        Self {
            address: address.to_string(),
            stop,
            is_dead,
            sent,
            thread: Some(thread),
        }
    }

    fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }
}

impl Drop for LineServer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn field(folder: &Path, sources: &str) -> Field {
    let path = folder.join("field.toml");
    fs::write(&path, sources).unwrap();
    Field::read(&path).unwrap()
}

/// A source of lines that each hold a number.
fn numbers_from(name: &str, address: &str) -> String {
    format!(
        "[[source]]\nname = \"{name}\"\nkind = \"lines\"\nheader = \"number\"\naddress = \"{address}\"\n"
    )
}

fn rows(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(str::to_owned).collect()
}

/// Records for some seconds.
fn record_for(
    seconds: f64,
    field: &Field,
    folder: &Path,
    clock: &Clock,
    look: &mut dyn FnMut(&View),
) {
    let goes_on = |view: &View| {
        look(view);
        view.time_s < seconds
    };
    record(field, folder, clock, goes_on).unwrap();
}

/// These cases wait for slow sources, so they run side by side.
#[test]
fn sources_are_recorded_and_their_faults_are_named() {
    side_by_side(named![
        all_kinds_of_sources_are_recorded_at_once,
        a_source_that_fails_and_returns_delays_no_other,
        a_step_of_the_clock_is_reported,
        a_check_names_sources_that_do_not_send,
    ]);
}

fn all_kinds_of_sources_are_recorded_at_once() {
    let temp = tempfile::tempdir().unwrap();
    let station = station();
    let sent: Arc<Mutex<Vec<String>>> = Arc::default();
    let line = {
        let (sent, begun) = (Arc::clone(&sent), Instant::now());
        move |_| {
            let time_s = begun.elapsed().as_secs_f64();
            let line = format!("{time_s:.6},0.0,0.0,0.1,0.0,0.0,-9.81");
            sent.lock().unwrap().push(line.clone());
            line + "\n"
        }
    };
    let imu = LineServer::new(line, Duration::from_millis(10));
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    let heading = UdpSocket::bind("127.0.0.1:0").unwrap();
    let place = heading.local_addr().unwrap();
    drop(heading);
    let field = field(
        temp.path(),
        &format!(
            "[[source]]\nname = \"station\"\nkind = \"geocom\"\naddress = \"{}\"\n\
             [[source]]\nname = \"imu\"\nkind = \"lines\"\naddress = \"{}\"\n\
             header = \"time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\"\n\
             [[source]]\nname = \"heading\"\nkind = \"nmea\"\naddress = \"udp://{place}\"\n\
             [project.prism]\nsource = \"station\"\nlever_arm_m = [0.0, 0.0, 0.0]\n\
             [project.imu]\nsource = \"imu\"\n",
            station.address(),
            imu.address
        ),
    );
    let (folder, clock) = (temp.path().join("drive"), Clock::default());
    let sentence = b"$GPHDT,123.456,T*32\r\n";
    let mut sentences = 0;
    record_for(5.0, &field, &folder, &clock, &mut |view| {
        if view.time_s > 0.5 {
            udp.send_to(sentence, place).unwrap();
            sentences += 1;
        }
    });
    // The total station: a log of polar observations.
    let polar = rows(&folder.join("station.csv"));
    assert!(polar.len() > 25, "{} rows", polar.len());
    for row in &polar[1..] {
        let cells: Vec<&str> = row.split(',').collect();
        let (distance_m, hz_deg): (f64, f64) =
            (cells[1].parse().unwrap(), cells[2].parse().unwrap());
        // The position of the prism follows from the direction.
        let east = 20.0 * hz_deg.to_radians().tan();
        let expected = east.hypot(20.0).hypot(1.0);
        assert!((distance_m - expected).abs() < 2e-3, "{row}: {expected}");
        assert_eq!(cells[4], "0");
    }
    assert!(rows(&folder.join("station.angles.csv")).len() > 100);
    let positions = format::read_positions(&folder.join("station.csv"), &Observations::AsFound);
    assert!(positions.is_ok() || positions.unwrap_err().to_string().contains("station"));
    // Lines: all that were sent while the link was open, below their header.
    let samples = format::read_imu(&folder.join("imu.csv")).unwrap();
    assert!(
        samples.len() as u64 + 2 >= imu.sent(),
        "{} of {}",
        samples.len(),
        imu.sent()
    );
    // The log holds the sensor's times as they were sent; the reader maps them to the common time of the recording.
    let logged = &rows(&folder.join("imu.csv"))[1..];
    assert_eq!(logged, &sent.lock().unwrap()[..logged.len()]);
    // However long a busy machine took, those times lie between the beginning of the recording and now.
    let now = clock.now();
    let begun_s = now.unix_s() - now.monotonic_s();
    assert!(
        samples
            .iter()
            .all(|sample| (begun_s..now.unix_s()).contains(&sample.time_s))
    );
    // Bytes as they arrived, with increasing times of arrival.
    let bytes = fs::read(folder.join("heading.nmea")).unwrap();
    assert_eq!(bytes, sentence.repeat(sentences));
    for name in ["imu", "heading"] {
        let stamps = rows(&folder.join(format!("{name}.stamps.csv")));
        let times: Vec<f64> = stamps[1..]
            .iter()
            .map(|row| row.split(',').nth(1).unwrap().parse().unwrap())
            .collect();
        assert!(times.is_sorted() && times.len() > 2);
    }
    let clock_rows = rows(&folder.join("clock.csv"));
    assert!((5..=7).contains(&clock_rows.len()), "{clock_rows:?}");
    let project = fs::read_to_string(folder.join("project.toml")).unwrap();
    assert!(project.contains("file = \"station.csv\"") && project.contains("file = \"imu.csv\""));
    // The folder can be given as a project: only the position of the total station is missing.
    boresight(&["trajectory", folder.to_str().unwrap()]).assert_failed_with(&[
        "station.csv",
        "polar observations only",
        "station_m",
    ]);
    assert_eq!(
        fs::read(folder.join("field.toml")).unwrap(),
        fs::read(&field.path).unwrap()
    );
}

fn a_source_that_fails_and_returns_delays_no_other() {
    let temp = tempfile::tempdir().unwrap();
    let line = |i: u64| format!("{i}\n");
    let (mortal, other) = (
        LineServer::new(line, Duration::from_millis(10)),
        LineServer::new(line, Duration::from_millis(10)),
    );
    let text = numbers_from("mortal", &mortal.address)
        + &numbers_from("other", &other.address)
        + &numbers_from("absent", "127.0.0.1:9");
    let field = field(temp.path(), &text);
    let (folder, clock) = (temp.path().join("drive"), Clock::default());
    let mut reopened = 0;
    let mut sent: Vec<(f64, u64)> = Vec::new();
    record_for(8.0, &field, &folder, &clock, &mut |view| {
        mortal
            .is_dead
            .store((1.5..4.5).contains(&view.time_s), Ordering::Relaxed);
        let [(_, mortal), (_, steady), (_, absent)] = view.sources.as_slice() else {
            panic!("three sources");
        };
        reopened = mortal.reopened;
        assert_eq!((steady.reopened, absent.records), (0, 0));
        // A busy machine sends late: what counts is that all lines of half a second ago have arrived.
        let earlier = sent.iter().rfind(|(at_s, _)| *at_s < view.time_s - 0.5);
        let arrived = steady.records;
        assert!(
            earlier.is_none_or(|(_, sent)| arrived >= *sent),
            "{arrived} of {earlier:?}"
        );
        sent.push((view.time_s, other.sent()));
        if (3.5..4.5).contains(&view.time_s) {
            assert!(mortal.is_silent && !mortal.is_open);
        }
    });
    assert_eq!(reopened, 1);
    let events = fs::read_to_string(folder.join("events.csv")).unwrap();
    for expected in [
        "mortal,\"connected\"",
        "mortal,\"silent\"",
        "mortal,\"sends again\"",
        "absent,\"127.0.0.1:9",
    ] {
        assert!(events.contains(expected), "{expected}: {events}");
    }
    // Logged once, not at every attempt.
    assert_eq!(events.matches("absent").count(), 1, "{events}");
    let numbers = |name: &str| -> Vec<u64> {
        let rows = rows(&folder.join(format!("{name}.csv")));
        rows[1..]
            .iter()
            .map(|row| row.split(',').nth(1).unwrap().parse().unwrap())
            .collect()
    };
    assert!(
        numbers("other")
            .windows(2)
            .all(|pair| pair[1] == pair[0] + 1)
    );
    assert!(numbers("mortal").is_sorted());
}

#[test]
#[should_panic(expected = "a fault of the caller")]
fn a_recording_ends_when_its_caller_panics() {
    let temp = tempfile::tempdir().unwrap();
    let sender = LineServer::new(|i| format!("{i}\n"), Duration::from_millis(10));
    let text = numbers_from("a", &sender.address) + &numbers_from("absent", "127.0.0.1:9");
    let field = field(temp.path(), &text);
    let folder = temp.path().join("drive");
    record_for(5.0, &field, &folder, &Clock::default(), &mut |_| {
        panic!("a fault of the caller")
    });
}

fn a_step_of_the_clock_is_reported() {
    let temp = tempfile::tempdir().unwrap();
    let sender = LineServer::new(|i| format!("{i}\n"), Duration::from_millis(50));
    let text = numbers_from("a", &sender.address);
    let field = field(temp.path(), &text);
    let (folder, clock) = (temp.path().join("drive"), Clock::default());
    let mut steps_s = Vec::new();
    let mut is_set = false;
    record_for(4.5, &field, &folder, &clock, &mut |view| {
        steps_s.extend(view.set_s);
        if view.time_s > 1.5 && !is_set {
            clock.step_by(500_000_000);
            is_set = true;
        }
    });
    assert_eq!(steps_s.len(), 1, "{steps_s:?}");
    assert!((steps_s[0] - 0.5).abs() < 0.005, "{steps_s:?}");
    let events = fs::read_to_string(folder.join("events.csv")).unwrap();
    assert!(events.contains("clock,\"set by +0.500 s\""), "{events}");
}

/// Kills `count` recordings: all data older than a second are on the disk, in complete rows.
#[cfg(unix)]
fn kills_lose_no_more_than_the_last_second(count: u64) {
    let temp = tempfile::tempdir().unwrap();
    let sender = LineServer::new(|i| format!("{i}\n"), Duration::from_millis(5));
    let text = numbers_from("a", &sender.address);
    let path = field(temp.path(), &text).path;
    for number in 0..count {
        let folder: PathBuf = temp.path().join(format!("drive-{number}"));
        let before = sender.sent();
        let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .args([
                "record",
                path.to_str().unwrap(),
                "--out",
                folder.to_str().unwrap(),
            ])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        std::thread::sleep(Duration::from_millis(2000 + 370 * number));
        let sent = sender.sent() - before;
        child.kill().unwrap();
        child.wait().unwrap();
        let rate_hz = sent as f64 / begun.elapsed().as_secs_f64();
        let text = fs::read_to_string(folder.join("a.csv")).unwrap();
        assert!(text.ends_with('\n'), "incomplete row");
        let recorded = text.lines().count() as u64 - 1;
        let lost_s = (sent.saturating_sub(recorded)) as f64 / rate_hz;
        assert!(lost_s < 1.3, "{lost_s} s lost");
    }
}

#[cfg(unix)]
#[test]
fn a_kill_loses_no_more_than_the_last_second() {
    kills_lose_no_more_than_the_last_second(1);
}

#[cfg(unix)]
#[test]
#[ignore = "just acceptance"]
fn three_kills_lose_no_more_than_the_last_second() {
    kills_lose_no_more_than_the_last_second(3);
}

fn a_check_names_sources_that_do_not_send() {
    let temp = tempfile::tempdir().unwrap();
    let sender = LineServer::new(|i| format!("{i}\n"), Duration::from_millis(5));
    let good = numbers_from("good", &sender.address);
    let path = field(temp.path(), &good).path;
    let check = || boresight(&["record", path.to_str().unwrap(), "--check", "--for", "2"]);
    let run = check();
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.out.contains("good"), "{}", run.out);
    fs::write(&path, good + &numbers_from("bad", "127.0.0.1:9")).unwrap();
    check().assert_failed_with(&["bad: 127.0.0.1:9", "refused", "check cables"]);
}

#[test]
fn mistakes_in_a_field_file_are_named_with_their_lines() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("field.toml");
    let refused = |text: &str, line: u64, expected: &str| {
        fs::write(&path, text).unwrap();
        let error = Field::read(&path).unwrap_err().to_string();
        assert!(
            error.contains(&format!("line {line}:")) || line == 0,
            "{error}"
        );
        assert!(error.contains(expected), "{expected}: {error}");
    };
    refused("", 0, "[[source]]");
    refused(
        "[[source]]\nname = \"a b\"\nkind = \"sbg\"\nport = \"/dev/ttyS0\"\n",
        2,
        "letters, digits",
    );
    refused(
        "[[source]]\nname = \"a\"\nkind = \"sbg\"\n",
        2,
        "neither `port`",
    );
    refused(
        "[[source]]\nname = \"a\"\nkind = \"gnss\"\nport = \"x\"\n",
        3,
        "geocom",
    );
    refused(
        "[[source]]\nname = \"a\"\nkind = \"lines\"\nport = \"x\"\n",
        3,
        "header",
    );
    refused(
        "[[source]]\nname = \"a\"\nkind = \"sbg\"\nport = \"x\"\nprism_type = 7\n",
        5,
        "geocom",
    );
    refused(
        "[[source]]\nname = \"a\"\nkind = \"sbg\"\naddress = \"x:1\"\nbaud = 9600\n",
        5,
        "serial port",
    );
    refused(
        "[[source]]\nname = \"a\"\nkind = \"sbg\"\nprot = \"x\"\n",
        4,
        "prot",
    );
    let twice = "[[source]]\nname = \"a\"\nkind = \"sbg\"\nport = \"x\"\n".repeat(2);
    refused(&twice, 6, "twice");
}
