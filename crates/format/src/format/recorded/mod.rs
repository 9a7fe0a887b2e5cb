//! Logs of a recording: beside `NAME.sbg`, what a sensor sent, lies `NAME.stamps.csv`, which says when each piece of it
//! arrived, and in the same folder `clock.csv`, the state of the clock that stamped them.
//!
//! The common time of a recording runs evenly from its beginning, whatever happens to UTC: that of the first look at
//! the clock, and the monotonic clock since then. A sensor's own times are kept where they are UTC and the system's
//! clock was disciplined; else they are put on the common time by the times of arrival.

mod arrival;
mod clock;
mod envelope;
mod station;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use super::detect::detect;
use super::file::{CLOCK_LOG, is_in_recording};
use super::text::table::{Columns, Table};
use crate::error::{Error, Location, Result};
use crate::statistics::{median, quantile};
use arrival::Arrivals;
pub use arrival::Pieces;
pub use clock::RecordingClock;
use envelope::Line;
pub use station::{StationRow, station_rows};

/// Own times that differ from those of arrival by less than this are of the same clock, seconds: a link is not later,
/// and no other clock so near by chance.
const SAME_CLOCK_S: f64 = 0.25;
/// Own times are never later than the arrival; this much is said to be noise of the clocks, seconds.
const EARLY_S: f64 = 0.02;
/// A gap is longer than so many usual intervals between arrivals, and than a second.
const GAP_INTERVALS: f64 = 10.0;
const GAP_S: f64 = 1.0;
const DAY_S: f64 = 86_400.0;

/// How the own times of a recorded sensor are related to the common time of its recording.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorClock {
    /// Whether the sensor's own times are kept: they are UTC, and so is the common time. Its clock is then not judged.
    pub is_kept: bool,
    /// Common time − own time in the middle of the recording, seconds.
    pub offset_s: f64,
    /// Seconds that the own clock loses on the common time in a second.
    pub drift: f64,
    /// Own time in the middle of the recording, and from its first to its last record, seconds.
    pub middle_s: f64,
    /// See there.
    pub span_s: f64,
    /// Half of the records arrived within so many seconds after the earliest that could be.
    pub delay_median_s: f64,
    /// 99.9 % of the records did.
    pub delay_999_s: f64,
    /// Arrivals that were waited for, and the longest wait.
    pub gaps: usize,
    /// See there, seconds.
    pub longest_gap_s: f64,
    /// Records that have a time of their own and a known time of arrival.
    pub records: usize,
    /// Damaged rows among the times of arrival.
    pub damaged_arrivals: usize,
    /// How far the log goes on after the last record with a known time of arrival, seconds of the sensor's clock: more
    /// than a moment only after a crash.
    pub beyond_arrivals_s: f64,
}

impl SensorClock {
    /// Common time of an own time, seconds.
    pub fn common_s(&self, own_s: f64) -> f64 {
        own_s + self.offset_s + self.drift * (own_s - self.middle_s)
    }
}

/// Where the times of arrival of a log are kept.
pub(crate) fn stamps_of(log: &Path) -> PathBuf {
    log.with_extension("stamps.csv")
}

/// The files of a recording that are read with a log; none if it was not recorded.
pub(crate) fn beside(log: &Path) -> Vec<PathBuf> {
    let stamps = stamps_of(log);
    let clock = log.with_file_name(CLOCK_LOG);
    match (stamps.is_file(), station::is_one(log)) {
        (true, _) => vec![stamps, clock],
        (false, true) => vec![clock],
        _ => Vec::new(),
    }
}

/// The clock of the recording that a log belongs to; `None` if it was not recorded.
pub fn recording_clock(log: &Path) -> Option<Result<RecordingClock>> {
    let clock = log.with_file_name(CLOCK_LOG);
    is_in_recording(log).then(|| RecordingClock::read(&clock))
}

/// Relates the own times of a log to the common time of the recording that it belongs to; `None` where no times of
/// arrival lie beside it, or its records have no times.
///
/// # Errors
/// Files that cannot be read; no record with a known time of arrival; an own clock that goes back, where its times are
/// not kept.
pub fn sensor_clock(log: &Path) -> Result<Option<SensorClock>> {
    let stamps = stamps_of(log);
    if !stamps.is_file() {
        return if station::is_one(log) {
            Ok(station::station(log)?.map(|station| station.clock))
        } else {
            Ok(None)
        };
    }
    let recording = RecordingClock::read(&log.with_file_name(CLOCK_LOG))?;
    let arrivals = Arrivals::read(&stamps, &recording)?;
    let own = record_ends(log)?;
    let pairs: Vec<(f64, f64)> = own
        .iter()
        .filter_map(|(end, own_s)| Some((*own_s, arrivals.of(*end)?)))
        .collect();
    let Some((_, own_last_s)) = own.last() else {
        return Ok(None);
    };
    let (Some(first), Some(last)) = (pairs.first(), pairs.last()) else {
        return Err(Error::format(
            stamps,
            Location::Whole,
            format!("no time of arrival of any of {} records", own.len()),
            "a log with at least two pieces and their times",
        ));
    };
    let middle_s = 0.5 * (first.0 + last.0);
    let (gaps, longest_gap_s) = arrivals.gaps();
    let mut clock = SensorClock {
        is_kept: false,
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
        beyond_arrivals_s: own_last_s - last.0,
    };
    // Seconds of the day are those of the day on which they arrived.
    let days_s = if (0.0..2.0 * DAY_S).contains(&first.0) && first.1 > 1e9 {
        DAY_S * ((first.1 - first.0) / DAY_S).round()
    } else {
        0.0
    };
    let delays = pairs.iter().map(|(own, arrived)| arrived - own - days_s);
    let least_s = delays.fold(f64::INFINITY, f64::min);
    let line = if recording.is_disciplined() && (-EARLY_S..SAME_CLOCK_S).contains(&least_s) {
        clock.is_kept = true;
        Line {
            offset: days_s,
            slope: 0.0,
        }
    } else {
        if let Some(back) = pairs.windows(2).find(|pair| pair[1].0 < pair[0].0 - GAP_S) {
            return Err(Error::format(
                log,
                Location::Whole,
                format!("own times that go back by {:.3} s", back[0].0 - back[1].0),
                "a sensor that was not started again while it was recorded: split its log there",
            ));
        }
        let centred = pairs.iter().map(|(own, at)| (own - middle_s, at - own));
        Line::below(&centred.collect::<Vec<_>>())
    };
    (clock.offset_s, clock.drift) = (line.offset, line.slope);
    let mut delays: Vec<f64> = pairs
        .iter()
        .map(|(own, arrived)| arrived - clock.common_s(*own))
        .collect();
    delays.sort_by(f64::total_cmp);
    let earliest_s = if clock.is_kept { 0.0 } else { delays[0] };
    clock.delay_median_s = median(delays.iter().copied()).unwrap_or(0.0) - earliest_s;
    clock.delay_999_s = quantile(&delays, 0.999) - earliest_s;
    Ok(Some(clock))
}

/// Better times of a recorded total station's measurements, as they stand in its log and as they are to be used,
/// seconds; empty for other logs.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn station_times(log: &Path) -> Result<Vec<(f64, f64)>> {
    if station::is_one(log) {
        Ok(station::station(log)?.map_or(Vec::new(), |station| station.times_s))
    } else {
        Ok(Vec::new())
    }
}

/// Where each record with a time of its own ends in a log, bytes, and that time.
fn record_ends(log: &Path) -> Result<Vec<(u64, f64)>> {
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
