//! Measurements of a recorded total station: `NAME.csv` with the common time and the time of the instrument's clock.

use super::SensorClock;
use super::clock::RecordingClock;
use super::envelope::Line;
use crate::error::Result;
use crate::format::file::{CLOCK_LOG, is_in_recording};
use crate::format::input::Input;
use crate::format::text::lines::header_names;
use crate::format::text::table::{Columns, Table};
use crate::statistics::{median, quantile};

const COLUMNS: Columns<'_> = Columns {
    needed: &[
        "time_s",
        "slope_distance_m",
        "horizontal_deg",
        "vertical_deg",
        "monotonic_s",
        "synchronous",
    ],
    optional: &["instrument_time_s"],
};

/// A measured distance with its angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationRow {
    /// Common time, seconds: its arrival less half the time between request and reply.
    pub time_s: f64,
    /// Position of the prism in the instrument's frame: east, north, up, metres.
    pub position_m: [f64; 3],
    /// Arrival time, seconds of the monotonic clock.
    pub monotonic_s: f64,
    /// Whether angles and distance were measured at the same instant.
    pub is_synchronous: bool,
    /// Time of the measurement by the instrument's clock, seconds.
    pub instrument_time_s: Option<f64>,
}

/// Whether a log is that of a recorded total station.
pub(super) fn is_station_log(log: &Input) -> bool {
    is_in_recording(log.path()) && header_names(log).is_ok_and(|names| COLUMNS.are_in(&names))
}

/// Reads the rows of the log of a recorded total station, except a last one that a crash cut off.
///
/// # Errors
/// The file cannot be read, or a row is damaged.
pub fn station_rows(log: impl Into<Input>) -> Result<Vec<StationRow>> {
    let mut table = Table::open(&log.into(), &COLUMNS)?;
    let (mut row, mut rows) = ([0.0; 7], Vec::new());
    while table.next_row(&mut row)? {
        let [
            time_s,
            distance_m,
            hz_deg,
            v_deg,
            monotonic_s,
            synchronous,
            instrument_s,
        ] = row;
        let (hz, v) = (hz_deg.to_radians(), v_deg.to_radians());
        let level_m = distance_m * v.sin();
        rows.push(StationRow {
            time_s,
            position_m: [level_m * hz.sin(), level_m * hz.cos(), distance_m * v.cos()],
            monotonic_s,
            is_synchronous: synchronous == 1.0,
            instrument_time_s: instrument_s.is_finite().then_some(instrument_s),
        });
    }
    Ok(rows)
}

/// The delays of a total station's measurements, and corrected times of those whose angles and distance were measured
/// at the same instant: the time of the instrument's clock, converted to the common time, later by the shortest delay.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Station {
    pub(super) clock: SensorClock,
    /// Time in the log and corrected time, seconds.
    pub(super) times_s: Vec<(f64, f64)>,
}

/// Relates the clock of a total station to that of the recording; `None` if the instrument gave no times.
pub(super) fn station(log: &Input) -> Result<Option<Station>> {
    let rows = station_rows(log)?;
    let recording = RecordingClock::read(&log.path().with_file_name(CLOCK_LOG))?;
    let timed: Vec<(f64, &StationRow)> = rows
        .iter()
        .filter_map(|row| Some((row.instrument_time_s?, row)))
        .collect();
    if timed.is_empty() {
        return Ok(None);
    }
    let arrival_s = |row: &StationRow| recording.common_s(row.monotonic_s);
    let (mut times_s, mut delays, mut span_s) = (Vec::new(), Vec::new(), 0.0);
    // An instrument that is switched off and on counts its time from zero again.
    for run in timed.chunk_by(|(before_s, _), (instrument_s, _)| before_s <= instrument_s) {
        let (first_s, last_s) = (run[0].0, run[run.len() - 1].0);
        let middle_s = 0.5 * (first_s + last_s);
        let centred = run
            .iter()
            .map(|(instrument_s, row)| (instrument_s - middle_s, arrival_s(row) - instrument_s));
        let line = Line::below(&centred.collect::<Vec<_>>());
        let common_s =
            |instrument_s: f64| instrument_s + line.offset + line.slope * (instrument_s - middle_s);
        let late_s =
            |(instrument_s, row): &(f64, &StationRow)| arrival_s(row) - common_s(*instrument_s);
        delays.extend(run.iter().map(late_s));
        let synchronous = run.iter().filter(|(_, row)| row.is_synchronous);
        times_s
            .extend(synchronous.map(|(instrument_s, row)| (row.time_s, common_s(*instrument_s))));
        span_s += last_s - first_s;
    }
    delays.sort_by(f64::total_cmp);
    Ok(Some(Station {
        times_s,
        clock: SensorClock {
            is_synchronised: true,
            offset_s: 0.0,
            drift: 0.0,
            middle_s: 0.0,
            span_s,
            delay_median_s: median(delays.iter().copied()).unwrap_or(0.0),
            delay_999_s: quantile(&delays, 0.999),
            gaps: 0,
            longest_gap_s: 0.0,
            records: timed.len(),
            damaged_arrivals: 0,
            last_arrival_s: rows.last().map_or(f64::NEG_INFINITY, arrival_s),
            beyond_arrivals_s: 0.0,
        },
    }))
}
