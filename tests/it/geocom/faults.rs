//! Every fault ends in measurements that go on, with everything counted and nothing invented.

use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::common::instrument::{self, Run, quick, track};
use boresight::record::geocom::simulated::{
    Fault, FaultKind, Simulated, SimulatedSettings, TcpInstrument,
};
use boresight::record::geocom::{Event, Instrument, Procedure, TrackingSettings};

fn run(seconds: f64, faults: Vec<Fault>) -> Run {
    track(seconds, faults, SimulatedSettings::default(), quick())
}

#[test]
fn lost_lock_is_found_again() {
    let run = run(6.0, vec![Fault::between(FaultKind::LostLock, 1.5, 3.5)]);
    assert_eq!((run.lost, run.relocked, run.counters.losses), (1, 1, 1));
    assert!(run.angles_only() > 20);
    assert!(
        run.distances_after(4.3) >= 8,
        "{}",
        run.distances_after(4.3)
    );
    assert!(run.longest_gap_s(1.5, 6.0) > 2.0);
}

#[test]
fn busy_instrument_is_asked_again() {
    let busy = Fault::between(FaultKind::Busy, 0.0, 4.0).every(4);
    let all = Fault::between(FaultKind::Busy, 1.5, 2.2);
    let run = run(4.0, vec![busy, all]);
    assert!(run.counters.busy > 20, "{:?}", run.counters);
    assert!(run.distances() >= 12);
    assert_eq!(
        run.counters.garbled + run.counters.late + run.counters.wrong_checksums,
        0
    );
}

#[test]
fn wrong_checksums_are_asked_again() {
    for checksum in [false, true] {
        let fault = Fault::between(FaultKind::WrongChecksum, 0.0, 9.0).every(7);
        let damaged = Fault::between(FaultKind::DamagedRequest, 1.0, 9.0).every(11);
        let settings = TrackingSettings {
            checksum,
            ..quick()
        };
        let run = track(
            3.0,
            vec![fault, damaged],
            SimulatedSettings::default(),
            settings,
        );
        assert!(run.counters.wrong_checksums > 20, "{:?}", run.counters);
        assert!(run.counters.damaged_requests > 5, "{:?}", run.counters);
        // Each damaged reply may have had a distance.
        assert!(run.distances() >= 10);
        assert!(run.notes.is_empty());
    }
}

#[test]
fn slow_answers_are_not_taken_for_later_ones() {
    // Slower than the time-out of 0.4 s, then slow but in time.
    let late = Fault::between(FaultKind::Slow(Duration::from_millis(550)), 1.0, 5.0).every(10);
    let slow = Fault::between(FaultKind::Slow(Duration::from_millis(100)), 2.0, 2.5);
    let run = run(5.0, vec![late, slow]);
    assert!(run.counters.late >= 3, "{:?}", run.counters);
    assert!(
        run.counters.timeouts >= run.counters.late.min(3),
        "{:?}",
        run.counters
    );
    assert!(run.distances() >= 10);
}

#[test]
fn missing_replies_are_asked_again() {
    let run = run(
        5.0,
        vec![Fault::between(FaultKind::Silent, 1.0, 5.0).every(20)],
    );
    assert!(run.counters.timeouts >= 3, "{:?}", run.counters);
    assert!(run.distances() >= 10);
    assert_eq!(run.broken_links, 0);
}

#[test]
fn silent_instrument_is_an_error_and_is_used_again_later() {
    let run = run(5.0, vec![Fault::between(FaultKind::Silent, 1.0, 2.8)]);
    assert!(
        run.broken_links >= 1 && run.counters.timeouts >= 3,
        "{:?}",
        run.counters
    );
    assert!(
        run.distances_after(3.5) >= 8,
        "{}",
        run.distances_after(3.5)
    );
}

#[test]
fn garbage_is_counted() {
    let garbage = Fault::between(FaultKind::Garbage, 0.0, 5.0).every(5);
    let run = run(5.0, vec![garbage]);
    assert!(run.counters.garbled > 10, "{:?}", run.counters);
    assert!(run.counters.noise_bytes > 10, "{:?}", run.counters);
    assert!(run.distances() >= 10);
    assert_eq!(run.broken_links, 0);
}

#[test]
fn pulled_cable_is_an_error_that_names_the_port() {
    let run = run(6.0, vec![Fault::between(FaultKind::CableOut, 1.5, 3.0)]);
    assert!(run.broken_links >= 1);
    assert!(run.counters.reconnects >= 1);
    assert!(
        run.distances_after(3.8) >= 10,
        "{}",
        run.distances_after(3.8)
    );
    assert!(run.longest_gap_s(1.5, 6.0) > 1.4);
}

#[test]
fn unknown_procedures_are_replaced_and_it_is_said() {
    let mut unknown = vec![];
    for (procedure, ways) in [
        (Procedure::GetFullMeas, 1),
        (Procedure::GetSimpleMeas, 2),
        (Procedure::QuickDist, 3),
        (Procedure::GetCoordinate, 4),
    ] {
        unknown.push(procedure);
        let simulated = SimulatedSettings {
            unknown: unknown.clone(),
            ..Default::default()
        };
        let run = track(1.5, vec![], simulated, quick());
        assert_eq!(run.notes.len(), ways, "{:?}", run.notes);
        assert!(
            run.notes[0].contains("TMC_GetFullMeas (2167)"),
            "{:?}",
            run.notes
        );
        let has_position = run
            .measurements
            .iter()
            .any(|found| found.position_m.is_some());
        assert_eq!(has_position, ways == 3, "{ways}");
        assert_eq!(run.distances() > 4, ways < 3, "{ways}");
        assert!(run.measurements.iter().all(|found| found.angles.is_some()));
    }
}

#[test]
fn instrument_without_lock_or_prism_types_is_used_without() {
    use Procedure::{GetLockState, GetPrismType, LockIn, SetLockState};
    let unknown = vec![GetLockState, SetLockState, LockIn, GetPrismType];
    let simulated = SimulatedSettings {
        unknown,
        ..Default::default()
    };
    let settings = TrackingSettings {
        lock: false,
        prism_type: None,
        ..quick()
    };
    let run = track(1.0, vec![], simulated, settings);
    assert!(run.measurements.len() > 10);
}

#[test]
fn instrument_without_checksums_is_used_without() {
    let simulated = SimulatedSettings {
        has_checksums: false,
        ..Default::default()
    };
    let settings = TrackingSettings {
        checksum: true,
        ..quick()
    };
    let run = track(1.5, vec![], simulated, settings);
    assert!(run.notes[0].contains("no checksums"), "{:?}", run.notes);
    assert!(run.distances() >= 5);
}

#[test]
fn distances_that_come_twice_count_once() {
    let simulated = SimulatedSettings {
        repeats_distances: true,
        ..Default::default()
    };
    let run = track(3.0, vec![], simulated, quick());
    assert!(run.counters.repeated_distances > 20);
    assert!(run.distances() <= 21);
    let mut times: Vec<_> = run
        .measurements
        .iter()
        .filter_map(|m| m.instrument_time_s)
        .collect();
    let all = times.len();
    times.dedup();
    assert_eq!(times.len(), all);
}

/// Tracking does not start with an instrument that does not know `procedure`, says why, and leaves its modes.
fn does_not_start(procedure: Procedure, why: &[&str]) {
    let simulated = SimulatedSettings {
        unknown: vec![procedure],
        ..Default::default()
    };
    let mut simulated = Simulated::new(simulated, instrument::target);
    simulated.set_modes(instrument::USERS);
    let server = TcpInstrument::listen("127.0.0.1:0", simulated).unwrap();
    let link = TcpStream::connect(server.address()).unwrap();
    let mut instrument = Instrument::connect(link, "port", quick(), || ()).unwrap();
    let error = instrument.start().unwrap_err().to_string();
    for why in why {
        assert!(error.contains(why), "{error}");
    }
    assert_eq!(server.simulated().modes(), instrument::USERS);
}

#[test]
fn refused_setting_is_an_error_and_leaves_the_modes() {
    let why = [
        "port: AUS_SetUserLockState (18007)",
        "3081 COM_PROC_UNAVAIL",
    ];
    does_not_start(Procedure::SetLockState, &why);
}

#[test]
fn mode_that_cannot_be_written_back_is_not_changed() {
    let why = ["BAP_GetPrismType (17009): found no value"];
    does_not_start(Procedure::GetPrismType, &why);
}

#[test]
fn tracking_goes_on_after_someone_stopped_it_at_the_instrument() {
    let simulated = Simulated::new(Default::default(), instrument::target);
    let server = TcpInstrument::listen("127.0.0.1:0", simulated).unwrap();
    let link = TcpStream::connect(server.address()).unwrap();
    let mut instrument = Instrument::connect(link, "port", quick(), Instant::now).unwrap();
    assert_eq!(instrument.read_battery().unwrap(), Some(87));
    instrument.start().unwrap();
    server.simulated().interrupt();
    let (begin, mut events) = (Instant::now(), vec![]);
    let mut distances = 0;
    while begin.elapsed() < Duration::from_secs(3) {
        match instrument.next_event().unwrap() {
            Event::Measured(found) => distances += u64::from(found.distance_m.is_some()),
            event => events.push(event),
        }
    }
    assert!(
        matches!(events[..], [Event::Lost, Event::Found]),
        "{events:?}"
    );
    assert!(distances > 10, "{distances}");
}

#[test]
fn prism_that_is_not_there_at_the_start_is_found_later() {
    let run = run(4.0, vec![Fault::between(FaultKind::LostLock, 0.0, 1.5)]);
    assert_eq!((run.lost, run.relocked), (1, 1));
    assert!(run.distances() > 8);
}

#[test]
fn prism_outside_of_the_window_is_found_by_power_search_only() {
    for power_search in [false, true] {
        let settings = TrackingSettings {
            search_rad: [0.0, 0.0],
            power_search,
            ..quick()
        };
        let hidden = vec![Fault::between(FaultKind::LostLock, 1.0, 3.0)];
        let run = track(4.5, hidden, SimulatedSettings::default(), settings);
        assert_eq!((run.lost, run.relocked), (1, usize::from(power_search)));
    }
}

#[test]
fn another_instrument_is_not_taken_for_the_first() {
    let mut servers = [1, 2].map(|serial_number| {
        let settings = SimulatedSettings {
            serial_number,
            ..Default::default()
        };
        let mut simulated = Simulated::new(settings, instrument::target);
        simulated.set_modes(instrument::USERS);
        TcpInstrument::listen("127.0.0.1:0", simulated).unwrap()
    });
    let [first, second] = &mut servers;
    let link = TcpStream::connect(first.address()).unwrap();
    let mut instrument = Instrument::connect(link, "port", quick(), || ()).unwrap();
    instrument.start().unwrap();
    let link = TcpStream::connect(second.address()).unwrap();
    let error = instrument.reconnect(link).unwrap_err().to_string();
    assert!(error.contains("found instrument 2, expected 1"), "{error}");
    drop(instrument);
    assert_eq!(second.simulated().modes(), instrument::USERS);
}

#[test]
fn all_faults_at_once() {
    let at = |kind, from_s, to_s| Fault::between(kind, from_s, to_s);
    let run = run(
        9.0,
        vec![
            at(FaultKind::WrongChecksum, 0.0, 9.0).every(11),
            at(FaultKind::Garbage, 0.0, 9.0).every(13),
            at(FaultKind::Busy, 0.0, 9.0).every(17),
            at(FaultKind::Slow(Duration::from_millis(500)), 0.0, 9.0).every(41),
            at(FaultKind::CableOut, 2.0, 3.0),
            at(FaultKind::LostLock, 4.5, 5.5),
        ],
    );
    assert!(
        run.distances_after(6.5) >= 5,
        "{}",
        run.distances_after(6.5)
    );
    assert!(run.counters.losses >= 1 && run.broken_links >= 1);
}
