//! The rate at which an instrument of 7 Hz is read over TCP and over a pseudo-terminal.

use crate::common::instrument::{self, Run, quick, track};
use boresight::record::geocom::TrackingSettings;
use boresight::record::geocom::simulated::SimulatedSettings;

#[test]
#[ignore = "just acceptance"]
fn every_distance_is_read_and_angles_in_between() {
    let run = track(10.0, vec![], SimulatedSettings::default(), quick(), |_| {
        true
    });
    let rate_hz = run.distances() as f64 / run.seconds;
    let angles_hz = run.angles_only() as f64 / run.seconds;
    let mut trips_ms: Vec<f64> = run
        .measurements
        .iter()
        .map(|m| 1e3 * m.round_trip.as_secs_f64())
        .collect();
    trips_ms.sort_by(f64::total_cmp);
    let at = |share: f64| trips_ms[((trips_ms.len() - 1) as f64 * share) as usize];
    let (median_ms, high_ms, longest_ms) = (at(0.5), at(0.99), at(1.0));
    // Age of a distance on arrival, by the instrument's own time.
    let ages_ms = run
        .measurements
        .iter()
        .filter_map(|m| Some(1e3 * (m.arrived - m.instrument_time_s?)));
    let oldest_ms = ages_ms.fold(0.0, f64::max);
    println!(
        "{rate_hz:.2} distances/s, {angles_hz:.1} angles/s, round trip {median_ms:.1} ms median, \
         {high_ms:.1} ms 99 %, {longest_ms:.1} ms longest; oldest distance on arrival {oldest_ms:.1} ms"
    );
    // The instrument measures floor(7 t) distances; the last one may not be read any more.
    assert!(
        run.distances() as f64 >= 7.0 * run.seconds - 2.0,
        "{rate_hz} Hz"
    );
    assert!(run.distances() as u64 == run.given);
    let times: Vec<f64> = run
        .measurements
        .iter()
        .filter_map(|m| m.instrument_time_s)
        .collect();
    let span_s = times[times.len() - 1] - times[0];
    let between_hz = (times.len() - 1) as f64 / span_s;
    println!("{between_hz:.3} distances/s from the first to the last");
    assert!(between_hz > 6.999, "{between_hz} Hz");
    assert!(angles_hz > 20.0, "{angles_hz} Hz");
    // The simulated instrument takes 5 ms.
    assert!(median_ms < 15.0, "{median_ms} ms");
    assert!(high_ms < 100.0, "{high_ms} ms");
    assert_eq!(
        run.counters.timeouts + run.counters.late + run.counters.garbled,
        0
    );
}

#[test]
fn the_synchronous_program_gives_angles_at_the_time_of_the_distance() {
    let settings = TrackingSettings {
        program: Some(10),
        edm_mode: None,
        ..quick()
    };
    let enough = |run: &Run| run.distances() > 8;
    let run = track(2.0, vec![], SimulatedSettings::default(), settings, enough);
    let mut count = 0;
    for measurement in &run.measurements {
        let (Some(time_s), Some(angles)) = (measurement.instrument_time_s, measurement.angles)
        else {
            continue;
        };
        let [e, n, _] = instrument::target(time_s);
        assert!((angles.hz_rad - e.atan2(n)).abs() < 2e-5);
        count += 1;
    }
    assert!(count > 8);
}

#[cfg(unix)]
mod terminal {
    use std::io::{self, Read, Write};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, Mutex};
    use std::time::{Duration, Instant};

    use boresight::record::geocom::simulated::{Simulated, serve};
    use boresight::record::geocom::{Event, Instrument, Link};
    use serial2::SerialPort;

    struct Port(SerialPort);

    impl Read for Port {
        fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
            self.0.read(to)
        }
    }

    impl Write for Port {
        fn write(&mut self, from: &[u8]) -> io::Result<usize> {
            self.0.write(from)
        }

        fn flush(&mut self) -> io::Result<()> {
            self.0.flush()
        }
    }

    impl Link for Port {
        fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
            self.0.set_read_timeout(timeout)
        }
    }

    #[test]
    fn an_instrument_is_tracked_over_a_pseudo_terminal() {
        let (mut far, near) = SerialPort::pair().unwrap();
        far.set_read_timeout(Duration::from_millis(10)).unwrap();
        let mut simulated = Simulated::new(Default::default(), super::instrument::target);
        simulated.set_modes(super::instrument::USERS);
        let simulated = Arc::new(Mutex::new(simulated));
        let is_stopped = Arc::new(AtomicBool::new(false));
        let shared = (Arc::clone(&simulated), Arc::clone(&is_stopped));
        let server = std::thread::spawn(move || serve(&shared.0, &mut far, &shared.1));
        let start = Instant::now();
        let now = move || start.elapsed();
        let mut instrument = Instrument::connect(Port(near), "pty", super::quick(), now).unwrap();
        instrument.start().unwrap();
        let mut distances = 0;
        while start.elapsed() < Duration::from_secs(3) {
            if let Event::Measured(measurement) = instrument.next_event().unwrap() {
                distances += usize::from(measurement.distance_m.is_some());
            }
        }
        println!("{distances} distances in 3 s, {:?}", instrument.counters());
        assert!(distances >= 16);
        // Dropped without a stop, as after an error of the program.
        drop(instrument);
        assert_eq!(simulated.lock().unwrap().modes(), super::instrument::USERS);
        is_stopped.store(true, Ordering::Relaxed);
        let _ = server.join();
    }
}
