//! Tracks with a simulated instrument and checks each measurement against the prism's true path.
use std::io;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use boresight::record::geocom::simulated::{Fault, Simulated, SimulatedSettings, TcpInstrument};
use boresight::record::geocom::{Class, Event, Instrument, Measurement, Modes, TrackingSettings};
use boresight::{Error, Result};

/// The prism drives east at half a metre per second, 20 m away.
pub fn target(time_s: f64) -> [f64; 3] {
    [2.0 + 0.5 * time_s, 20.0, 1.0]
}

fn distance_m(time_s: f64) -> f64 {
    let [e, n, u] = target(time_s);
    e.hypot(n).hypot(u)
}

fn hz_rad(time_s: f64) -> f64 {
    let [e, n, _] = target(time_s);
    e.atan2(n)
}

/// The user's modes before tracking, all different from those of tracking.
pub const USERS: Modes = Modes {
    decimals: Some(4),
    edm_mode: Some(3),
    program: Some(1),
    prism_type: Some(3),
    lock: Some(0),
};

pub struct Run {
    pub measurements: Vec<Measurement<f64>>,
    pub notes: Vec<String>,
    pub lost: usize,
    pub relocked: usize,
    pub broken_links: usize,
    pub counters: boresight::record::geocom::Counters,
    pub given: u64,
    pub seconds: f64,
}

impl Run {
    pub fn distances(&self) -> usize {
        let has_distance = |m: &&Measurement<f64>| m.distance_m.is_some();
        self.measurements.iter().filter(has_distance).count()
    }

    pub fn angles_only(&self) -> usize {
        let has_angles_only = |m: &&Measurement<f64>| m.class == Class::AnglesOnly;
        self.measurements.iter().filter(has_angles_only).count()
    }

    /// Distances after a time, s.
    pub fn distances_after(&self, time_s: f64) -> usize {
        let is_after = |m: &&Measurement<f64>| m.distance_m.is_some() && m.arrived > time_s;
        self.measurements.iter().filter(is_after).count()
    }

    /// Longest time without distance within an interval, s.
    pub fn longest_gap_s(&self, from_s: f64, to_s: f64) -> f64 {
        let with_distance = self.measurements.iter().filter(|m| m.distance_m.is_some());
        let times = with_distance
            .map(|m| m.arrived)
            .filter(|t| (from_s..to_s).contains(t));
        let mut last_s = from_s;
        let mut longest_s: f64 = 0.0;
        for time_s in times.chain([to_s]) {
            longest_s = longest_s.max(time_s - last_s);
            last_s = time_s;
        }
        longest_s
    }
}

/// Settings for tests: short time-outs.
pub fn quick() -> TrackingSettings {
    TrackingSettings {
        prism_type: Some(7),
        reply_timeout: Duration::from_millis(400),
        search_timeout: Duration::from_secs(2),
        ..TrackingSettings::default()
    }
}

fn open(instrument: &TcpInstrument) -> io::Result<TcpStream> {
    let link = TcpStream::connect(instrument.address())?;
    link.set_nodelay(true)?;
    Ok(link)
}

/// How long a busy machine may take beyond the intended time to see what a test waits for, s.
pub const PATIENCE_S: f64 = 60.0;

/// Tracks for some seconds of the instrument's time and until `enough` was seen, reconnecting when the link ends;
/// checks each measurement against the prism's path, that enough was seen, and that the user's modes are restored.
pub fn track(
    seconds: f64,
    faults: Vec<Fault>,
    simulated: SimulatedSettings,
    settings: TrackingSettings,
    enough: impl Fn(&Run) -> bool,
) -> Run {
    let (is_following, is_synchronous) = (settings.lock, settings.program == Some(10));
    let simulated = SimulatedSettings {
        faults,
        ..simulated
    };
    let start = Instant::now();
    let mut simulated = Simulated::new(simulated, target);
    simulated.set_modes(USERS);
    let server = TcpInstrument::listen("127.0.0.1:0", simulated).unwrap();
    let now = move || start.elapsed().as_secs_f64();
    let port = server.address().to_string();
    let link = open(&server).unwrap();
    let mut instrument = Instrument::connect(link, &port, settings, now).unwrap();
    assert_eq!(instrument.identity().serial_number, 3_201_407);
    let mut run = Run {
        measurements: vec![],
        notes: vec![],
        lost: 0,
        relocked: 0,
        broken_links: 0,
        counters: instrument.counters(),
        given: 0,
        seconds: 0.0,
    };
    let mut start_result: Result<()> = instrument.start();
    let began_s = now();
    while now() < seconds || (!enough(&run) && now() < seconds + PATIENCE_S) {
        let event = match start_result {
            Ok(()) => instrument.next_event(),
            Err(error) => Err(error),
        };
        start_result = Ok(());
        match event {
            Ok(Event::Measured(measurement)) => {
                check(
                    &measurement,
                    is_following && !is_synchronous,
                    run.lost == run.relocked,
                );
                run.measurements.push(measurement);
            }
            Ok(Event::Lost) => run.lost += 1,
            Ok(Event::Found) => run.relocked += 1,
            Ok(Event::Note(note)) => run.notes.push(note),
            Err(error @ Error::Io { .. }) => {
                assert!(error.to_string().starts_with(&port), "{error}");
                run.broken_links += 1;
                std::thread::sleep(Duration::from_millis(50));
                start_result = open(&server)
                    .map_err(|source| Error::io(&port, source))
                    .and_then(|link| instrument.reconnect(link));
            }
            Err(error) => panic!("{error}"),
        }
        run.counters = instrument.counters();
    }
    run.seconds = now() - began_s;
    instrument.stop().unwrap();
    run.counters = instrument.counters();
    assert_eq!(server.simulated().modes(), USERS, "modes are written back");
    assert!(!server.simulated().is_measuring());
    assert!(enough(&run), "{:?}", run.counters);
    run.given = server.simulated().counts().distances;
    println!(
        "{} measurements, {} distances of {} given, {:?}",
        run.measurements.len(),
        run.distances(),
        run.given,
        run.counters
    );
    run
}

/// Half of the prism's motion in a millisecond, to which the instrument rounds its times, and some rounding.
const STAMP_M: f64 = 3e-4;

fn check(measurement: &Measurement<f64>, is_following: bool, is_locked: bool) {
    let (from_s, to_s) = (
        measurement.arrived - measurement.round_trip.as_secs_f64(),
        measurement.arrived,
    );
    if let Some(distance) = measurement.distance_m {
        let time_s = measurement.instrument_time_s.unwrap_or(to_s - 0.15);
        let tolerance_m = if measurement.instrument_time_s.is_some() {
            STAMP_M
        } else {
            0.2
        };
        assert!(
            (distance - distance_m(time_s)).abs() < tolerance_m,
            "{measurement:?}"
        );
        assert!(
            time_s < to_s + 1e-3 && time_s > from_s - 0.5,
            "{measurement:?}"
        );
        assert_eq!(measurement.class, Class::Full);
    }
    if let (Some(angles), true, true) = (measurement.angles, is_following, is_locked) {
        // While the prism is hidden the telescope stands still.
        let first = if measurement.distance_m.is_some() {
            from_s
        } else {
            from_s - 2.5
        };
        let range = hz_rad(first) - 1e-4..hz_rad(to_s) + 1e-4;
        assert!(
            range.contains(&angles.hz_rad),
            "{measurement:?} not in {range:?}"
        );
    }
}
