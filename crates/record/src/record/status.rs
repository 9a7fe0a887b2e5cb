//! The state of a source while it is recorded.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::clock::Stamp;

/// Rates are means over this time, seconds.
const RATE_S: f64 = 3.0;
/// A source is silent if nothing arrived for this many of its usual intervals, and for at least a second.
const SILENT_INTERVALS: f64 = 10.0;
const SILENT_S: f64 = 1.0;

/// The state of a source, shared by its thread and the view.
#[derive(Debug, Default)]
pub struct Status(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    is_open: bool,
    records: u64,
    bytes: u64,
    openings: u64,
    damaged: u64,
    /// Recent times at which records arrived, seconds, and their numbers.
    recent: VecDeque<(f64, u64)>,
    first_s: Option<f64>,
    sensor_status: String,
    error: Option<String>,
    is_done: bool,
}

/// The state of a source as the view shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceState {
    /// Whether its link is open.
    pub is_open: bool,
    /// Records so far; for a total station, distances.
    pub records: u64,
    /// Bytes so far.
    pub bytes: u64,
    /// Bytes among them that belong to no whole record.
    pub damaged: u64,
    /// Times that the link was opened again.
    pub reopened: u64,
    /// Recent records per second.
    pub rate_hz: f64,
    /// Time since the last record, seconds.
    pub age_s: Option<f64>,
    /// Whether nothing arrives any more, or nothing ever did.
    pub is_silent: bool,
    /// The status that the sensor reports.
    pub sensor_status: String,
    /// The last error of its link.
    pub error: Option<String>,
}

impl Status {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The link was opened.
    pub fn opened(&self) {
        let mut state = self.state();
        state.is_open = true;
        state.openings += 1;
        state.error = None;
    }

    /// The link was closed or cannot be opened; returns whether that is news.
    pub fn closed(&self, error: &str) -> bool {
        let mut state = self.state();
        let is_news = state.is_open || state.error.as_deref() != Some(error);
        state.is_open = false;
        state.error = Some(error.to_owned());
        is_news
    }

    /// Records arrived.
    pub fn arrived(&self, records: u64, bytes: usize, at: Stamp) {
        let mut state = self.state();
        state.records += records;
        state.bytes += bytes as u64;
        let now_s = at.monotonic_s();
        state.first_s.get_or_insert(now_s);
        if records > 0 {
            state.recent.push_back((now_s, records));
        }
        let is_old = |recent: &VecDeque<(f64, u64)>| {
            recent.len() > 1 && recent.front().is_some_and(|(t, _)| now_s - t > RATE_S)
        };
        while is_old(&state.recent) {
            state.recent.pop_front();
        }
    }

    /// Adds bytes that belong to no record.
    pub fn damaged(&self, bytes: u64) {
        self.state().damaged += bytes;
    }

    /// Sets the status that the sensor reports, such as a lost lock.
    pub fn set_sensor_status(&self, sensor_status: &str) {
        self.state().sensor_status = sensor_status.to_owned();
    }

    /// Its thread has ended.
    pub fn done(&self) {
        self.state().is_done = true;
    }

    /// Whether its thread has ended.
    pub fn is_done(&self) -> bool {
        self.state().is_done
    }

    /// The state to show now.
    pub fn source_state(&self, now: Stamp) -> SourceState {
        let state = self.state();
        let now_s = now.monotonic_s();
        let lately = state.recent.iter().filter(|(t, _)| now_s - t <= RATE_S);
        let lately: u64 = lately.map(|(_, records)| records).sum();
        let span_s = state
            .first_s
            .map_or(RATE_S, |first| (now_s - first).clamp(0.1, RATE_S));
        let age_s = state.recent.back().map(|(last, _)| now_s - last);
        let rate_hz = lately as f64 / span_s;
        let interval_s = match (state.recent.front(), state.recent.back()) {
            (Some((first, _)), Some((last, _))) if state.recent.len() > 1 => {
                (last - first) / (state.recent.len() - 1) as f64
            }
            _ => 0.0,
        };
        let patience_s = SILENT_S.max(SILENT_INTERVALS * interval_s);
        SourceState {
            is_open: state.is_open,
            records: state.records,
            bytes: state.bytes,
            damaged: state.damaged,
            reopened: state.openings.saturating_sub(1),
            rate_hz,
            age_s,
            is_silent: age_s.is_none_or(|age| age > patience_s),
            sensor_status: state.sensor_status.clone(),
            error: state.error.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> Stamp {
        Stamp {
            monotonic_ns: (1e9 * seconds) as u64,
            unix_ns: 0,
        }
    }

    #[test]
    fn the_rate_of_many_records_at_once_is_counted_in_full() {
        let status = Status::default();
        for i in 0..20 {
            status.arrived(5000, 40_000, at(0.1 * f64::from(i)));
        }
        let rate_hz = status.source_state(at(2.0)).rate_hz;
        assert!((rate_hz - 50_000.0).abs() < 1.0, "{rate_hz}");
    }

    #[test]
    fn the_state_shows_rate_age_and_silence() {
        let status = Status::default();
        assert!(status.source_state(at(0.0)).is_silent);
        status.opened();
        for i in 0..70 {
            status.arrived(1, 10, at(f64::from(i) / 7.0));
        }
        let state = status.source_state(at(10.0));
        assert_eq!((state.records, state.bytes, state.reopened), (70, 700, 0));
        assert!((state.rate_hz - 7.0).abs() < 0.4, "{}", state.rate_hz);
        assert!(!state.is_silent);
        let state = status.source_state(at(12.0));
        assert!(state.is_silent && state.age_s.unwrap() > 2.0);
        assert!(status.closed("cable") && !status.closed("cable"));
        status.opened();
        assert_eq!(status.source_state(at(12.0)).reopened, 1);
    }
}
