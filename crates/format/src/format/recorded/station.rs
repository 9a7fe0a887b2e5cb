//! What a total station measured in a recording: `NAME.csv` with the instrument's own times beside ours.

use std::path::Path;

use super::SensorClock;
use super::clock::RecordingClock;
use super::envelope::Line;
use crate::error::Result;
use crate::format::file::{CLOCK_LOG, is_in_recording};
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

/// A distance with its angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationRow {
    /// Common time, from its arrival, seconds.
    pub time_s: f64,
    /// East, north, up in the instrument's frame, metres.
    pub position_m: [f64; 3],
    /// When it arrived, seconds of the monotonic clock.
    pub monotonic_s: f64,
    /// Whether its angles are those at the time of the distance.
    pub is_synchronous: bool,
    /// When it was measured by the instrument's clock, seconds.
    pub instrument_time_s: Option<f64>,
}

/// Whether a log is that of a recorded total station.
pub(super) fn is_one(log: &Path) -> bool {
    is_in_recording(log) && header_names(log).is_ok_and(|names| COLUMNS.are_in(&names))
}

/// Reads the rows; a last one that a crash cut off is left out.
///
/// # Errors
/// The file cannot be read, or a row is damaged.
pub fn station_rows(log: &Path) -> Result<Vec<StationRow>> {
    let mut table = Table::open(log, &COLUMNS)?;
    let (mut row, mut rows) = ([0.0; 7], Vec::new());
    while table.next_row(&mut row)? {
        let [
            time_s,
            distance_m,
            hz_deg,
            v_deg,
            monotonic_s,
            synchronous,
            own_s,
        ] = row;
        let (hz, v) = (hz_deg.to_radians(), v_deg.to_radians());
        let level_m = distance_m * v.sin();
        rows.push(StationRow {
            time_s,
            position_m: [level_m * hz.sin(), level_m * hz.cos(), distance_m * v.cos()],
            monotonic_s,
            is_synchronous: synchronous == 1.0,
            instrument_time_s: own_s.is_finite().then_some(own_s),
        });
    }
    Ok(rows)
}

/// How late a total station's measurements arrive, and their better times: where angles and distances are of the same
/// instant, those of the instrument's clock, later by the shortest time that a measurement took.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Station {
    pub(super) clock: SensorClock,
    /// Time in the log and the one to use, seconds.
    pub(super) times_s: Vec<(f64, f64)>,
}

/// Relates the clock of a total station to that of the recording; `None` where it gave no times.
pub(super) fn station(log: &Path) -> Result<Option<Station>> {
    let rows = station_rows(log)?;
    let recording = RecordingClock::read(&log.with_file_name(CLOCK_LOG))?;
    let timed: Vec<(f64, &StationRow)> = rows
        .iter()
        .filter_map(|row| Some((row.instrument_time_s?, row)))
        .collect();
    if timed.is_empty() {
        return Ok(None);
    }
    let arrived = |row: &StationRow| recording.common_s(row.monotonic_s);
    let (mut times_s, mut delays, mut span_s) = (Vec::new(), Vec::new(), 0.0);
    // An instrument that is switched off and on counts its time from zero again.
    for run in timed.chunk_by(|(before_s, _), (own_s, _)| before_s <= own_s) {
        let (first_s, last_s) = (run[0].0, run[run.len() - 1].0);
        let middle_s = 0.5 * (first_s + last_s);
        let centred = run
            .iter()
            .map(|(own, row)| (own - middle_s, arrived(row) - own));
        let line = Line::below(&centred.collect::<Vec<_>>());
        let common = |own: f64| own + line.offset + line.slope * (own - middle_s);
        delays.extend(run.iter().map(|(own, row)| arrived(row) - common(*own)));
        let synchronous = run.iter().filter(|(_, row)| row.is_synchronous);
        times_s.extend(synchronous.map(|(own, row)| (row.time_s, common(*own))));
        span_s += last_s - first_s;
    }
    delays.sort_by(f64::total_cmp);
    Ok(Some(Station {
        times_s,
        clock: SensorClock {
            is_kept: true,
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
            beyond_arrivals_s: 0.0,
        },
    }))
}
