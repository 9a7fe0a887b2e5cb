//! The thread of a total station.

use super::clock::Stamp;
use super::geocom::{Event, Instrument, Measurement, TrackingSettings};
use super::journal::Journal;
use super::place::Wire;
use super::thread::SourceThread;
use crate::error::{Error, Result};

const DISTANCES: &str = "time_s,slope_distance_m,horizontal_deg,vertical_deg,status,monotonic_s,round_trip_s,\
                         synchronous,instrument_time_s\n";
/// The measurement program whose angles are measured at the time of the distance.
const SYNCHRONOUS: u16 = 10;
const ANGLES: &str = "time_s,horizontal_deg,vertical_deg,monotonic_s,round_trip_s\n";
/// Coordinates in the instrument's own system, which the program does not know.
const COORDINATES: &str =
    "time_s,east_m,north_m,up_m,status,monotonic_s,round_trip_s,instrument_time_s\n";

/// Records a total station until the recording stops: distances with their angles in `name.csv`, which is a log of
/// polar observations, and the angles between distances in `name.angles.csv`; if the instrument gives coordinates
/// instead of distances, these are in `name.coordinates.csv`.
///
/// # Errors
/// A file cannot be written. A link that ends is reopened; the refusal of an instrument becomes an event.
pub fn record(thread: &SourceThread<'_>, settings: &TrackingSettings) -> Result<()> {
    let settings = &TrackingSettings {
        interval: settings.interval.div_f64(thread.clock.speed()),
        ..settings.clone()
    };
    let mut logs = StationLogs::create(thread, settings)?;
    let mut station: Option<Instrument<Wire, Stamp>> = None;
    while thread.goes_on() {
        match tracked(thread, settings, &mut station, &mut logs) {
            Ok(()) => {}
            Err(Failure::Disk(error)) => return Err(error),
            Err(Failure::Link(error)) => thread.failed(&error)?,
        }
        logs.write_if_due()?;
    }
    if let Some(mut station) = station
        && let Err(error) = station.stop()
    {
        thread.event(&format!("its modes could not be restored: {error}"))?;
    }
    logs.flush()
}

/// An error that ends a link, or the recording.
enum Failure {
    Link(Error),
    Disk(Error),
}

/// Tracks until the link ends or the recording does.
fn tracked(
    thread: &SourceThread<'_>,
    settings: &TrackingSettings,
    station: &mut Option<Instrument<Wire, Stamp>>,
    logs: &mut StationLogs<'_, '_>,
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
            station.insert(opened.map_err(Failure::Link)?)
        }
    };
    // A reconnected instrument tracks already, unless its first start failed.
    if !station.is_tracking() {
        station.start().map_err(Failure::Link)?;
    }
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
            Event::Measured(measurement) => logs.add(&measurement).map_err(Failure::Disk)?,
            Event::Lost => thread
                .report_sensor_status("prism lost")
                .map_err(Failure::Disk)?,
            Event::Found => thread
                .report_sensor_status("locked")
                .map_err(Failure::Disk)?,
            Event::Note(text) => thread.event(&text).map_err(Failure::Disk)?,
        }
        logs.write_if_due().map_err(Failure::Disk)?;
    }
    Ok(())
}

/// The logs of a total station.
struct StationLogs<'t, 'a> {
    thread: &'t SourceThread<'a>,
    is_synchronous: bool,
    distances: Journal<'a>,
    angles: Journal<'a>,
    /// Only for an instrument that gives coordinates instead of distances.
    coordinates: Option<Journal<'a>>,
}

impl<'t, 'a> StationLogs<'t, 'a> {
    fn create(thread: &'t SourceThread<'a>, settings: &TrackingSettings) -> Result<Self> {
        let name = &thread.source.name;
        let begin = |file: &str, header: &str| {
            let mut log = Journal::create(&thread.folder.join(file), thread.disk)?;
            log.append(header.as_bytes())?;
            Ok::<_, Error>(log)
        };
        Ok(Self {
            thread,
            is_synchronous: settings.program == Some(SYNCHRONOUS),
            distances: begin(&thread.source.file(), DISTANCES)?,
            angles: begin(&format!("{name}.angles.csv"), ANGLES)?,
            coordinates: None,
        })
    }

    fn add(&mut self, measurement: &Measurement<Stamp>) -> Result<()> {
        let thread = self.thread;
        let trip_s = measurement.round_trip.as_secs_f64() * thread.clock.speed();
        // Measured some time between request and reply: take the middle.
        let time_s = thread.clock.common_s(&measurement.arrived) - 0.5 * trip_s;
        let monotonic_s = measurement.arrived.monotonic_s();
        // The return code of GeoCOM: 0 if all is well.
        let status = measurement.code.0;
        let instrument_time = measurement
            .instrument_time_s
            .map_or(String::new(), |t| format!("{t:.3}"));
        if let Some([east_m, north_m, up_m]) = measurement.position_m {
            let row = format!(
                "{time_s:.6},{east_m:.5},{north_m:.5},{up_m:.5},{status},{monotonic_s:.6},{trip_s:.6},{instrument_time}\n"
            );
            self.coordinates()?.append(row.as_bytes())?;
            thread.status.arrived(1, row.len(), measurement.arrived);
        }
        let Some(angles) = measurement.angles else {
            return Ok(());
        };
        let (hz_deg, v_deg) = (angles.hz_rad.to_degrees(), angles.v_rad.to_degrees());
        match measurement.distance_m {
            Some(distance_m) => {
                let is_synchronous = u8::from(self.is_synchronous);
                let row = format!(
                    "{time_s:.6},{distance_m:.5},{hz_deg:.7},{v_deg:.7},{status},{monotonic_s:.6},{trip_s:.6},{is_synchronous},{instrument_time}\n"
                );
                self.distances.append(row.as_bytes())?;
                thread.status.arrived(1, row.len(), measurement.arrived);
            }
            None => {
                let row =
                    format!("{time_s:.6},{hz_deg:.7},{v_deg:.7},{monotonic_s:.6},{trip_s:.6}\n");
                self.angles.append(row.as_bytes())?;
            }
        }
        Ok(())
    }

    /// The log of coordinates; the first call creates it.
    fn coordinates(&mut self) -> Result<&mut Journal<'a>> {
        let log = match self.coordinates.take() {
            Some(log) => log,
            None => {
                let file = format!("{}.coordinates.csv", self.thread.source.name);
                let path = self.thread.folder.join(&file);
                let mut log = Journal::create(&path, self.thread.disk)?;
                log.append(COORDINATES.as_bytes())?;
                self.thread.report_sensor_status(&format!(
                    "gives coordinates instead of distances: they are in {file}"
                ))?;
                log
            }
        };
        Ok(self.coordinates.insert(log))
    }

    fn all(&mut self) -> impl Iterator<Item = &mut Journal<'a>> {
        [&mut self.distances, &mut self.angles]
            .into_iter()
            .chain(&mut self.coordinates)
    }

    fn write_if_due(&mut self) -> Result<()> {
        self.all().try_for_each(Journal::write_if_due)
    }

    fn flush(&mut self) -> Result<()> {
        self.all().try_for_each(Journal::flush)
    }
}
