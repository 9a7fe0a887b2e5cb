//! Logs of a recording. `NAME.sbg` holds the bytes that a sensor sent, `NAME.stamps.csv` beside it the arrival time of
//! each piece, and `clock.csv` in the same folder the state of the clock by which these times were measured.
//!
//! The common time of a recording is UTC at the first check of the clock plus the monotonic time since then, so that it
//! runs evenly even if UTC is set. Sensor times, which a sensor puts in its records, are kept if they are UTC and the
//! system clock was synchronised; otherwise they are converted to the common time by the arrival times.

mod arrival;
mod clock;
mod envelope;
mod station;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::detect::detect;
use super::file::{CLOCK_LOG, is_in_recording};
use super::input::Input;
use super::text::table::{Columns, Table};
use crate::error::{Error, Location, Result};
use crate::statistics::{median, quantile};
use arrival::Arrivals;
pub use arrival::Pieces;
pub use clock::{ClockStep, RecordingClock};
use envelope::Line;
pub use station::{StationRow, station_rows};

/// Sensor times that differ from the arrival times by less than this come from the same clock, seconds: no link is
/// slower, and another clock is not so close by chance.
const SAME_CLOCK_S: f64 = 0.25;
/// A record cannot arrive before it is measured; up to this difference, noise of the clocks explains it, seconds.
const EARLY_S: f64 = 0.02;
/// A gap is longer than this many median intervals between arrivals, and longer than `GAP_S`, seconds.
const GAP_INTERVALS: f64 = 10.0;
const GAP_S: f64 = 1.0;
const DAY_S: f64 = 86_400.0;

/// The clocks of a recording: that of its computer, and those of its sensors with their names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingClocks {
    /// The clock of the computer.
    pub system: RecordingClock,
    /// The sensors that have clocks or times of arrival.
    pub sensors: Vec<(String, SensorClock)>,
}

/// The relation of the times of a recorded sensor to the common time of its recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SensorClock {
    /// Whether the times in the log are used without the arrival times, because they and the common time are UTC, or
    /// because the recorder put the common time in the log.
    pub is_synchronised: bool,
    /// Common time − sensor time in the middle of the recording, seconds.
    pub offset_s: f64,
    /// Seconds by which the sensor's clock falls behind the common time per second.
    pub drift: f64,
    /// Sensor time in the middle of the recording, seconds.
    pub middle_s: f64,
    /// Sensor time from the first to the last record, seconds.
    pub span_s: f64,
    /// Median delay of the records' arrival after the earliest possible one, seconds.
    pub delay_median_s: f64,
    /// 99.9 % quantile of this delay, seconds.
    pub delay_999_s: f64,
    /// Number of gaps between arrivals.
    pub gaps: usize,
    /// The longest gap, seconds.
    pub longest_gap_s: f64,
    /// Number of records with a sensor time and a known arrival time.
    pub records: usize,
    /// Number of damaged rows of arrival times.
    pub damaged_arrivals: usize,
    /// Arrival of the last record with a known arrival time, common time, seconds.
    pub last_arrival_s: f64,
    /// Duration of the log after the last record with a known arrival time, seconds of the sensor's clock; it is long
    /// only after a crash.
    pub beyond_arrivals_s: f64,
}

impl SensorClock {
    /// Converts a sensor time to the common time, seconds.
    pub fn common_s(&self, sensor_s: f64) -> f64 {
        sensor_s + self.offset_s + self.drift * (sensor_s - self.middle_s)
    }
}

/// The path of a log's arrival times.
pub(crate) fn stamps_of(log: &Path) -> PathBuf {
    log.with_extension("stamps.csv")
}

/// The files of a recording that are needed to read a log; none if the log is not part of a recording.
pub(crate) fn beside(log: &Path) -> Vec<PathBuf> {
    let stamps = stamps_of(log);
    let clock = log.with_file_name(CLOCK_LOG);
    match (stamps.is_file(), station::is_station_log(&log.into())) {
        (true, _) => vec![stamps, clock],
        (false, true) => vec![clock],
        _ => Vec::new(),
    }
}

/// The clock of the recording that a log belongs to; `None` if the log is not part of a recording.
pub fn recording_clock(log: &Path) -> Option<Result<RecordingClock>> {
    let clock = log.with_file_name(CLOCK_LOG);
    is_in_recording(log).then(|| RecordingClock::read(&clock))
}

/// Relates the sensor times of a log to the common time of its recording; `None` if there are no arrival times beside
/// the log, if its records have no times, and for what is no file.
///
/// # Errors
/// Files that cannot be read; no record with a known arrival time; sensor times that go back and are not synchronised.
pub fn sensor_clock(log: impl Into<Input>) -> Result<Option<SensorClock>> {
    let input = log.into();
    if !input.is_file() {
        return Ok(None);
    }
    let log = input.path();
    let stamps = stamps_of(log);
    if !stamps.is_file() {
        return if station::is_station_log(&input) {
            Ok(station::station(&input)?.map(|station| station.clock))
        } else {
            Ok(None)
        };
    }
    let recording = RecordingClock::read(&log.with_file_name(CLOCK_LOG))?;
    let arrivals = Arrivals::read(&stamps, &recording)?;
    let records = record_ends(&input)?;
    let pairs: Vec<(f64, f64)> = records
        .iter()
        .filter_map(|(end, sensor_s)| Some((*sensor_s, arrivals.arrival_s(*end)?)))
        .collect();
    let Some((_, last_sensor_s)) = records.last() else {
        return Ok(None);
    };
    let (Some(first), Some(last)) = (pairs.first(), pairs.last()) else {
        return Err(Error::format(
            stamps,
            Location::Whole,
            format!("no arrival time for any of {} records", records.len()),
            "arrival times of at least two pieces of the log",
        ));
    };
    let middle_s = 0.5 * (first.0 + last.0);
    let (gaps, longest_gap_s) = arrivals.gaps();
    let mut clock = SensorClock {
        is_synchronised: false,
        offset_s: 0.0,
        drift: 0.0,
        middle_s,
        span_s: last.0 - first.0,
        delay_median_s: 0.0,
        delay_999_s: 0.0,
        gaps,
        longest_gap_s,
        records: pairs.len(),
        damaged_arrivals: arrivals.damaged,
        last_arrival_s: last.1,
        beyond_arrivals_s: last_sensor_s - last.0,
    };
    // If the sensor sends seconds of the day, they count from the midnight before the arrival.
    let days_s = if (0.0..2.0 * DAY_S).contains(&first.0) && first.1 > 1e9 {
        DAY_S * ((first.1 - first.0) / DAY_S).round()
    } else {
        0.0
    };
    let delays = pairs
        .iter()
        .map(|(sensor_s, arrival_s)| arrival_s - sensor_s - days_s);
    let least_s = delays.fold(f64::INFINITY, f64::min);
    let is_utc = recording.is_synchronised(clock.last_arrival_s);
    let line = if is_utc && (-EARLY_S..SAME_CLOCK_S).contains(&least_s) {
        clock.is_synchronised = true;
        Line {
            offset: days_s,
            slope: 0.0,
        }
    } else {
        if let Some(back) = pairs.windows(2).find(|pair| pair[1].0 < pair[0].0 - GAP_S) {
            return Err(Error::format(
                log,
                Location::Whole,
                format!(
                    "sensor times that go back by {:.3} s",
                    back[0].0 - back[1].0
                ),
                "a sensor that was not restarted during the recording: split its log there",
            ));
        }
        let centred = pairs
            .iter()
            .map(|(sensor_s, arrival_s)| (sensor_s - middle_s, arrival_s - sensor_s));
        Line::below(&centred.collect::<Vec<_>>())
    };
    (clock.offset_s, clock.drift) = (line.offset, line.slope);
    let mut delays: Vec<f64> = pairs
        .iter()
        .map(|(sensor_s, arrival_s)| arrival_s - clock.common_s(*sensor_s))
        .collect();
    delays.sort_by(f64::total_cmp);
    let earliest_s = if clock.is_synchronised {
        0.0
    } else {
        delays[0]
    };
    clock.delay_median_s = median(delays.iter().copied()).unwrap_or(0.0) - earliest_s;
    clock.delay_999_s = quantile(&delays, 0.999) - earliest_s;
    Ok(Some(clock))
}

/// The times of a recorded total station's measurements: the time in the log and the corrected time, seconds. Empty for
/// other logs.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn station_times(log: &Input) -> Result<Vec<(f64, f64)>> {
    if log.is_file() && station::is_station_log(log) {
        Ok(station::station(log)?.map_or(Vec::new(), |station| station.times_s))
    } else {
        Ok(Vec::new())
    }
}

/// The end of each record that has a sensor time, in bytes from the start of the log, and that time, seconds.
fn record_ends(log: &Input) -> Result<Vec<(u64, f64)>> {
    let kind = detect(log)?.0;
    if let Some(ends) = kind.record_ends {
        return ends(log);
    }
    if kind.columns.is_none() {
        return Ok(Vec::new());
    }
    let columns = Columns {
        needed: &["time_s"],
        optional: &[],
    };
    let mut table = Table::open(log, &columns)?;
    let (mut row, mut ends) = ([0.0], Vec::new());
    while table.next_row(&mut row)? {
        ends.push((table.bytes_read(), row[0]));
    }
    Ok(ends)
}
