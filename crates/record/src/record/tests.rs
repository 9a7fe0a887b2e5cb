//! Links that end in the middle of a line, an instrument that refuses at first, and files as they are after a kill.

use std::fs;
use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use super::geocom::Procedure;
use super::geocom::simulated::{Simulated, SimulatedSettings, TcpInstrument};
use super::journal::{Disk, StampedJournal};
use super::{Clock, Field, Stamp, View, record};
use crate::format;
use crate::sensor::Observations;

/// Position of the simulated instrument's prism, metres.
fn target(time_s: f64) -> [f64; 3] {
    [2.0 + 0.5 * time_s, 20.0, 1.0]
}

fn field(folder: &Path, sources: &str) -> Field {
    let path = folder.join("field.toml");
    fs::write(&path, sources).unwrap();
    Field::read(&path).unwrap()
}

fn record_for(seconds: f64, field: &Field, folder: &Path, mut look: impl FnMut(&View)) {
    let goes_on = |view: &View| {
        look(view);
        view.time_s < seconds
    };
    record(field, folder, &Clock::default(), goes_on).unwrap();
}

fn rows(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(str::to_owned).collect()
}

/// Sends one of the texts over each connection, and closes all but the last.
struct Sender {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Sender {
    fn new(texts: &'static [&'static str]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let shared = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut last = None;
            for text in texts {
                drop(last);
                let (mut stream, _) = listener.accept().unwrap();
                stream.write_all(text.as_bytes()).unwrap();
                last = Some(stream);
            }
            while !shared.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        Self {
            address,
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

#[test]
fn a_line_cut_off_by_the_end_of_a_link_is_not_joined_with_the_next() {
    let parent = tempfile::tempdir().unwrap();
    let plain = Sender::new(&["10\n11\n12", "3.4\n5\n"]);
    let timed = Sender::new(&["1.4,10\n1.5,11\n17", "1.9,5\n2.0,6\n"]);
    let text = [("plain", "number", &plain), ("timed", "time_s,number", &timed)].map(
        |(name, header, sender)| {
            format!(
                "[[source]]\nname = \"{name}\"\nkind = \"lines\"\nheader = \"{header}\"\naddress = \"{}\"\n",
                sender.address
            )
        },
    );
    let field = field(parent.path(), &text.concat());
    let folder = parent.path().join("drive");
    let mut damaged = Vec::new();
    record_for(3.0, &field, &folder, |view| {
        damaged = view.sources.iter().map(|(_, seen)| seen.damaged).collect();
    });
    let plain: Vec<String> = rows(&folder.join("plain.csv"))
        .iter()
        .map(|row| row.split_once(',').unwrap().1.to_owned())
        .collect();
    // The first row of a connection may be the end of a row.
    assert_eq!(plain, ["11", "5"]);
    assert_eq!(rows(&folder.join("timed.csv")), ["1.5,11", "2.0,6"]);
    assert_eq!(damaged, [9, 15]);
}

#[test]
fn received_lines_are_written_while_a_link_is_down() {
    let parent = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let sender = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"41\n42\n").unwrap();
    });
    let field = field(
        parent.path(),
        &format!(
            "[[source]]\nname = \"a\"\nkind = \"lines\"\nheader = \"number\"\naddress = \"{address}\"\n"
        ),
    );
    let folder = parent.path().join("drive");
    let mut log = String::new();
    record_for(3.0, &field, &folder, |_| {
        log = fs::read_to_string(folder.join("a.csv")).unwrap_or_default();
    });
    sender.join().unwrap();
    assert!(log.ends_with(",42\n"), "{log:?}");
}

#[test]
fn bytes_are_never_written_before_their_time_of_arrival() {
    let parent = tempfile::tempdir().unwrap();
    let disk = Disk::default();
    let mut journal = StampedJournal::create(parent.path(), "a", "sbg", &disk).unwrap();
    let at = Stamp {
        monotonic_ns: 5_000_000,
        unix_ns: 0,
    };
    journal.append(&[7; 70_000], at).unwrap();
    assert_eq!(
        fs::metadata(parent.path().join("a.sbg")).unwrap().len(),
        70_000
    );
    let stamps = fs::read_to_string(parent.path().join("a.stamps.csv")).unwrap();
    assert!(stamps.contains("\n0,0.005000,"), "{stamps:?}");
}

fn station(settings: SimulatedSettings) -> TcpInstrument {
    TcpInstrument::listen("127.0.0.1:0", Simulated::new(settings, target)).unwrap()
}

fn station_field(folder: &Path, station: &TcpInstrument) -> Field {
    let text = format!(
        "[[source]]\nname = \"station\"\nkind = \"geocom\"\naddress = \"{}\"\n",
        station.address()
    );
    field(folder, &text)
}

#[test]
fn a_total_station_that_refuses_at_first_is_started_again() {
    let parent = tempfile::tempdir().unwrap();
    let station = station(SimulatedSettings::default());
    let usual = station.simulated().modes();
    let mut refused = usual;
    refused.edm_mode = None;
    station.simulated().set_modes(refused);
    let field = station_field(parent.path(), &station);
    let folder = parent.path().join("drive");
    record_for(6.0, &field, &folder, |view| {
        if view.time_s > 1.5 && station.simulated().modes().edm_mode.is_none() {
            station.simulated().set_modes(usual);
        }
    });
    let events = fs::read_to_string(folder.join("events.csv")).unwrap();
    assert!(events.contains("TMC_GetEdmMode"), "{events}");
    let distances = rows(&folder.join("station.csv"));
    assert!(
        distances.len() > 3,
        "{} distances: {events}",
        distances.len()
    );
}

#[test]
fn coordinates_of_a_total_station_are_recorded() {
    let parent = tempfile::tempdir().unwrap();
    let station = station(SimulatedSettings {
        unknown: vec![
            Procedure::GetFullMeas,
            Procedure::GetSimpleMeas,
            Procedure::QuickDist,
        ],
        ..SimulatedSettings::default()
    });
    let field = station_field(parent.path(), &station);
    let folder = parent.path().join("drive");
    let (mut records, mut sensor_status) = (0, String::new());
    record_for(4.0, &field, &folder, |view| {
        records = view.sources[0].1.records;
        sensor_status.clone_from(&view.sources[0].1.sensor_status);
    });
    let log = folder.join("station.coordinates.csv");
    let positions = format::read_positions(&log, &Observations::AsFound).unwrap();
    assert!(
        positions.fixes.len() > 3 && records > 0,
        "{records} records"
    );
    assert!(
        sensor_status.contains("station.coordinates.csv"),
        "{sensor_status}"
    );
    let times_s: Vec<f64> = positions.fixes.iter().map(|fix| fix.time_s).collect();
    assert!(times_s.is_sorted());
    for fix in &positions.fixes {
        assert_eq!((fix.position_m.y, fix.position_m.z), (20.0, 1.0));
        assert!((2.0..6.0).contains(&fix.position_m.x), "{fix:?}");
    }
    assert!(rows(&folder.join("station.angles.csv")).len() > 3);
    assert!(rows(&folder.join("station.csv")).is_empty());
}
