//! After every fault the measurements continue; events are counted, and no value is invented.

use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::common::instrument::{self, Run, quick, track};
use crate::common::{named, side_by_side};
use boresight::record::geocom::simulated::{
    Fault, FaultKind, Simulated, SimulatedSettings, TcpInstrument,
};
use boresight::record::geocom::{Event, Instrument, Procedure, TrackingSettings};

/// The end of faults that last as long as a test waits, s.
const EVER: f64 = 1e3;

fn run(seconds: f64, faults: Vec<Fault>, enough: impl Fn(&Run) -> bool) -> Run {
    track(
        seconds,
        faults,
        SimulatedSettings::default(),
        quick(),
        enough,
    )
}

#[test]
fn measurements_continue_after_every_fault() {
    side_by_side(named![
        a_lost_prism_is_locked_again,
        a_busy_instrument_is_asked_again,
        a_request_is_repeated_after_a_wrong_checksum,
        late_replies_are_not_taken_for_later_ones,
        a_request_is_repeated_after_a_missing_reply,
        a_silent_instrument_is_an_error_and_is_used_again_later,
        garbage_is_counted_and_skipped,
        a_pulled_cable_is_an_error_that_names_the_port,
        unknown_procedures_are_replaced_with_a_note,
        an_instrument_without_lock_and_prism_types_can_be_used,
        an_instrument_without_checksums_can_be_used,
        repeated_distances_count_once,
        tracking_continues_after_someone_stopped_it_at_the_instrument,
        a_prism_that_is_hidden_at_the_start_is_found_later,
        a_prism_outside_the_search_window_is_found_only_by_power_search,
        measurements_continue_after_all_faults_at_once,
    ]);
}

fn a_lost_prism_is_locked_again() {
    let hidden = vec![Fault::between(FaultKind::LostLock, 1.5, 3.5)];
    let enough = |run: &Run| run.distances_after(4.3) >= 8 && run.angles_only() > 20;
    let run = run(6.0, hidden, enough);
    assert_eq!((run.lost, run.relocked, run.counters.losses), (1, 1, 1));
    assert!(run.longest_gap_s(1.5, 6.0) > 2.0);
}

fn a_busy_instrument_is_asked_again() {
    let busy = Fault::between(FaultKind::Busy, 0.0, EVER).every(4);
    let all = Fault::between(FaultKind::Busy, 1.5, 2.2);
    let enough = |run: &Run| run.counters.busy > 20 && run.distances() >= 12;
    let run = run(4.0, vec![busy, all], enough);
    assert_eq!(
        run.counters.garbled + run.counters.late + run.counters.wrong_checksums,
        0
    );
}

fn a_request_is_repeated_after_a_wrong_checksum() {
    for checksum in [false, true] {
        let fault = Fault::between(FaultKind::WrongChecksum, 0.0, EVER).every(7);
        let damaged = Fault::between(FaultKind::DamagedRequest, 1.0, EVER).every(11);
        let settings = TrackingSettings {
            checksum,
            ..quick()
        };
        let enough = |run: &Run| {
            let counters = &run.counters;
            counters.wrong_checksums > 20 && counters.damaged_requests > 5 && run.distances() >= 10
        };
        let run = track(
            3.0,
            vec![fault, damaged],
            SimulatedSettings::default(),
            settings,
            enough,
        );
        assert!(run.notes.is_empty());
    }
}

fn late_replies_are_not_taken_for_later_ones() {
    // Slower than the time-out of 0.4 s, then slow but in time.
    let late = Fault::between(FaultKind::Slow(Duration::from_millis(550)), 1.0, EVER).every(10);
    let slow = Fault::between(FaultKind::Slow(Duration::from_millis(100)), 2.0, 2.5);
    let enough =
        |run: &Run| run.counters.late >= 3 && run.counters.timeouts >= 3 && run.distances() >= 10;
    run(5.0, vec![late, slow], enough);
}

fn a_request_is_repeated_after_a_missing_reply() {
    let silent = vec![Fault::between(FaultKind::Silent, 1.0, EVER).every(20)];
    let enough = |run: &Run| run.counters.timeouts >= 3 && run.distances() >= 10;
    let run = run(5.0, silent, enough);
    assert_eq!(run.broken_links, 0);
}

fn a_silent_instrument_is_an_error_and_is_used_again_later() {
    let silent = vec![Fault::between(FaultKind::Silent, 1.0, 2.8)];
    let run = run(5.0, silent, |run| run.distances_after(3.5) >= 8);
    assert!(
        run.broken_links >= 1 && run.counters.timeouts >= 3,
        "{:?}",
        run.counters
    );
}

fn garbage_is_counted_and_skipped() {
    let garbage = Fault::between(FaultKind::Garbage, 0.0, EVER).every(5);
    let enough = |run: &Run| {
        let counters = &run.counters;
        counters.garbled > 10 && counters.noise_bytes > 10 && run.distances() >= 10
    };
    let run = run(5.0, vec![garbage], enough);
    assert_eq!(run.broken_links, 0);
}

fn a_pulled_cable_is_an_error_that_names_the_port() {
    let out = vec![Fault::between(FaultKind::CableOut, 1.5, 3.0)];
    let run = run(6.0, out, |run| run.distances_after(3.8) >= 10);
    assert!(run.broken_links >= 1);
    assert!(run.counters.reconnects >= 1);
    assert!(run.longest_gap_s(1.5, 6.0) > 1.4);
}

fn unknown_procedures_are_replaced_with_a_note() {
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
        let enough = |run: &Run| match ways {
            1 | 2 => run.distances() > 4,
            3 => run.measurements.iter().any(|m| m.position_m.is_some()),
            _ => run.notes.len() == ways,
        };
        let run = track(1.5, vec![], simulated, quick(), enough);
        assert_eq!(run.notes.len(), ways, "{:?}", run.notes);
        assert!(
            run.notes[0].contains("TMC_GetFullMeas (2167)"),
            "{:?}",
            run.notes
        );
        let has_position = run.measurements.iter().any(|m| m.position_m.is_some());
        assert_eq!(has_position, ways == 3, "{ways}");
        assert_eq!(run.distances() > 4, ways < 3, "{ways}");
        assert!(run.measurements.iter().all(|m| m.angles.is_some()));
    }
}

fn an_instrument_without_lock_and_prism_types_can_be_used() {
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
    let enough = |run: &Run| run.measurements.len() > 10;
    track(1.0, vec![], simulated, settings, enough);
}

fn an_instrument_without_checksums_can_be_used() {
    let simulated = SimulatedSettings {
        has_checksums: false,
        ..Default::default()
    };
    let settings = TrackingSettings {
        checksum: true,
        ..quick()
    };
    let run = track(1.5, vec![], simulated, settings, |run| run.distances() >= 5);
    assert!(run.notes[0].contains("no checksums"), "{:?}", run.notes);
}

fn repeated_distances_count_once() {
    let simulated = SimulatedSettings {
        repeats_distances: true,
        ..Default::default()
    };
    let enough = |run: &Run| run.counters.repeated_distances > 20;
    let run = track(3.0, vec![], simulated, quick(), enough);
    // Seven a second: 21 in three seconds.
    assert!(run.distances() as f64 <= (7.0 * run.seconds).ceil());
    let mut times: Vec<_> = run
        .measurements
        .iter()
        .filter_map(|m| m.instrument_time_s)
        .collect();
    let all = times.len();
    times.dedup();
    assert_eq!(times.len(), all);
}

/// Asserts that tracking does not start with an instrument that lacks `procedure`, with an error that contains `why`,
/// and that its modes are unchanged. Returns the notes.
fn assert_does_not_start(procedure: Procedure, why: &[&str]) -> Vec<String> {
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
    let mut notes = Vec::new();
    while let Ok(Event::Note(text)) = instrument.next_event() {
        notes.push(text);
    }
    notes
}

#[test]
fn a_refused_setting_is_an_error_and_leaves_the_modes() {
    let why = [
        "port: AUS_SetUserLockState (18007)",
        "3081 COM_PROC_UNAVAIL",
    ];
    let notes = assert_does_not_start(Procedure::SetLockState, &why);
    // The lock cannot be written back either.
    let is_said = notes
        .iter()
        .any(|note| note.contains("may not be as before"));
    assert!(is_said, "{notes:?}");
}

#[test]
fn a_mode_that_cannot_be_restored_is_not_changed() {
    let why = ["BAP_GetPrismType (17009): found no value"];
    let notes = assert_does_not_start(Procedure::GetPrismType, &why);
    assert!(notes.is_empty(), "{notes:?}");
}

fn tracking_continues_after_someone_stopped_it_at_the_instrument() {
    let simulated = Simulated::new(Default::default(), instrument::target);
    let server = TcpInstrument::listen("127.0.0.1:0", simulated).unwrap();
    let link = TcpStream::connect(server.address()).unwrap();
    let mut instrument = Instrument::connect(link, "port", quick(), Instant::now).unwrap();
    assert_eq!(instrument.read_battery().unwrap(), Some(87));
    instrument.start().unwrap();
    server.simulated().interrupt();
    let (begin, mut events) = (Instant::now(), vec![]);
    let mut distances = 0;
    while begin.elapsed() < Duration::from_secs(3)
        || (distances <= 10 && begin.elapsed().as_secs_f64() < instrument::PATIENCE_S)
    {
        match instrument.next_event().unwrap() {
            Event::Measured(m) => distances += u64::from(m.distance_m.is_some()),
            event => events.push(event),
        }
    }
    assert!(
        matches!(events[..], [Event::Lost, Event::Found]),
        "{events:?}"
    );
    assert!(distances > 10, "{distances}");
}

fn a_prism_that_is_hidden_at_the_start_is_found_later() {
    let hidden = vec![Fault::between(FaultKind::LostLock, 0.0, 1.5)];
    let run = run(4.0, hidden, |run| run.distances() > 8);
    assert_eq!((run.lost, run.relocked), (1, 1));
}

fn a_prism_outside_the_search_window_is_found_only_by_power_search() {
    for power_search in [false, true] {
        let settings = TrackingSettings {
            search_rad: [0.0, 0.0],
            power_search,
            ..quick()
        };
        let hidden = vec![Fault::between(FaultKind::LostLock, 1.0, 3.0)];
        let relocked = usize::from(power_search);
        let enough = |run: &Run| run.lost == 1 && run.relocked == relocked;
        let run = track(4.5, hidden, SimulatedSettings::default(), settings, enough);
        assert_eq!((run.lost, run.relocked), (1, relocked));
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

fn measurements_continue_after_all_faults_at_once() {
    let at = |kind, from_s, to_s| Fault::between(kind, from_s, to_s);
    let all = vec![
        at(FaultKind::WrongChecksum, 0.0, EVER).every(11),
        at(FaultKind::Garbage, 0.0, EVER).every(13),
        at(FaultKind::Busy, 0.0, EVER).every(17),
        at(FaultKind::Slow(Duration::from_millis(500)), 0.0, EVER).every(41),
        at(FaultKind::CableOut, 2.0, 3.0),
        at(FaultKind::LostLock, 4.5, 5.5),
    ];
    let run = run(9.0, all, |run| run.distances_after(6.5) >= 5);
    assert!(run.counters.losses >= 1 && run.broken_links >= 1);
}
