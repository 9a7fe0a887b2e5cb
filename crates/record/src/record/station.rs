//! The thread of a total station.

use super::clock::Stamp;
use super::geocom::{Event, Instrument, Measurement, TrackingSettings};
use super::journal::Journal;
use super::place::Wire;
use super::thread::SourceThread;
use crate::error::{Error, Result};

const DISTANCES: &str = "time_s,slope_distance_m,horizontal_deg,vertical_deg,status,monotonic_s,round_trip_s,\
                         synchronous,instrument_time_s\n";
/// The measurement program whose angles are those of the time of the distance.
const SYNCHRONOUS: u16 = 10;
const ANGLES: &str = "time_s,horizontal_deg,vertical_deg,monotonic_s,round_trip_s\n";

/// Records a total station until it is told to stop: distances with their angles in `name.csv`, which is a log of
/// polar observations, and the angles between distances in `name.angles.csv`.
///
/// # Errors
/// A file cannot be written. A link that ends is opened again; an instrument that refuses is said.
pub fn record(thread: &SourceThread<'_>, settings: &TrackingSettings) -> Result<()> {
    let settings = &TrackingSettings {
        interval: settings.interval.div_f64(thread.clock.speed()),
        ..settings.clone()
    };
    let name = &thread.source.name;
    let mut distances = Journal::create(&thread.folder.join(thread.source.file()), thread.disk)?;
    distances.append(DISTANCES.as_bytes())?;
    let mut angles = Journal::create(
        &thread.folder.join(format!("{name}.angles.csv")),
        thread.disk,
    )?;
    angles.append(ANGLES.as_bytes())?;
    let mut station: Option<Instrument<Wire, Stamp>> = None;
    while thread.goes_on() {
        match tracked(
            thread,
            settings,
            &mut station,
            (&mut distances, &mut angles),
        ) {
            Ok(()) => {}
            Err(Failure::Disk(error)) => return Err(error),
            Err(Failure::Link(error)) => thread.failed(&error)?,
        }
        distances.write_if_due()?;
        angles.write_if_due()?;
    }
    if let Some(mut station) = station
        && let Err(error) = station.stop()
    {
        thread.event(&format!("could not be left as it was: {error}"))?;
    }
    distances.flush()?;
    angles.flush()
}

/// What ends a link, or the recording.
enum Failure {
    Link(Error),
    Disk(Error),
}

/// Tracks until the link ends or the recording does.
fn tracked(
    thread: &SourceThread<'_>,
    settings: &TrackingSettings,
    station: &mut Option<Instrument<Wire, Stamp>>,
    (distances, angles): (&mut Journal<'_>, &mut Journal<'_>),
) -> std::result::Result<(), Failure> {
    let place = &thread.source.place;
    let wire = place.open().map_err(Failure::Link)?;
    let station = match station {
        Some(station) => {
            station.reconnect(wire).map_err(Failure::Link)?;
            station
        }
        None => {
            let clock = thread.clock.clone();
            let now = move || clock.now();
            let opened = Instrument::connect(wire, &place.to_string(), settings.clone(), now);
            let opened = station.insert(opened.map_err(Failure::Link)?);
            opened.start().map_err(Failure::Link)?;
            opened
        }
    };
    thread.status.opened();
    let identity = station.identity();
    let charge = identity
        .battery_percent
        .map_or(String::new(), |b| format!(", battery {b} %"));
    let who = format!("{} {}{charge}", identity.name, identity.serial_number);
    thread
        .event(&format!("connected: {who}"))
        .map_err(Failure::Disk)?;
    while thread.goes_on() {
        match station.next_event().map_err(Failure::Link)? {
            Event::Measured(found) => {
                write(thread, settings, &found, distances, angles).map_err(Failure::Disk)?;
            }
            Event::Lost => thread.said("prism lost").map_err(Failure::Disk)?,
            Event::Found => thread.said("locked").map_err(Failure::Disk)?,
            Event::Note(text) => thread.event(&text).map_err(Failure::Disk)?,
        }
        distances.write_if_due().map_err(Failure::Disk)?;
    }
    Ok(())
}

fn write(
    thread: &SourceThread<'_>,
    settings: &TrackingSettings,
    found: &Measurement<Stamp>,
    distances: &mut Journal<'_>,
    angles: &mut Journal<'_>,
) -> Result<()> {
    let Some(seen) = found.angles else {
        return Ok(());
    };
    let trip_s = found.round_trip.as_secs_f64() * thread.clock.speed();
    // The angles were measured between request and reply.
    let time_s = thread.clock.common_s(&found.arrived) - 0.5 * trip_s;
    let monotonic_s = found.arrived.monotonic_s();
    let (hz_deg, v_deg) = (seen.hz_rad.to_degrees(), seen.v_rad.to_degrees());
    match found.distance_m {
        Some(distance_m) => {
            // Of GeoCOM: 0 where all is well.
            let status = found.code.0;
            let is_synchronous = u8::from(settings.program == Some(SYNCHRONOUS));
            let own = found
                .instrument_time_s
                .map_or(String::new(), |t| format!("{t:.3}"));
            let row = format!(
                "{time_s:.6},{distance_m:.5},{hz_deg:.7},{v_deg:.7},{status},{monotonic_s:.6},{trip_s:.6},{is_synchronous},{own}\n"
            );
            distances.append(row.as_bytes())?;
            thread.status.arrived(1, row.len(), found.arrived);
        }
        None => {
            let row = format!("{time_s:.6},{hz_deg:.7},{v_deg:.7},{monotonic_s:.6},{trip_s:.6}\n");
            angles.append(row.as_bytes())?;
        }
    }
    Ok(())
}
