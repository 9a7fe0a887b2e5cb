//! New records of a log that grows.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::{GrowingTable, Input};
use crate::sensor::Timed;

/// Most bytes of a log that are read at a time. Of binary logs they include some seconds before the new bytes, on which
/// the times of the new records rest.
const WINDOW: usize = 1 << 18;
/// Seconds during which the offset of a sensor's clock is learnt, if its own times are not the common time: it is that
/// of the earliest arrival.
const LEARNING_S: f64 = 4.0;
/// Own times this near to the common time are that time, seconds.
const SAME_CLOCK_S: f64 = 0.25;
/// Own times that go back by more than a second are those of a sensor that was started again, as when a whole log is
/// read; times that leap ahead by more than an hour are those of a clock that was set. Seconds.
const BACK_S: f64 = 1.0;
const AHEAD_S: f64 = 3600.0;

/// A log that grows, and the clock of its sensor.
pub(super) struct Tail {
    log: Log,
    clock: LearntClock,
    /// Why the newest bytes held no record.
    trouble: Option<String>,
}

enum Log {
    Table(GrowingTable),
    Binary(Window),
}

impl Tail {
    pub(super) fn new(path: &Path) -> Self {
        let is_table = path.extension().is_some_and(|extension| extension == "csv");
        Self {
            log: if is_table {
                Log::Table(GrowingTable::new(path, WINDOW as u64))
            } else {
                Log::Binary(Window::new(path))
            },
            clock: LearntClock::default(),
            trouble: None,
        }
    }

    /// Why the newest bytes held no record.
    pub(super) fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }

    /// The records that arrived since the last time; none while the offset of their clock is learnt. `read` reads
    /// an excerpt of the log, and puts own times on the common time with the clock.
    ///
    /// # Errors
    /// The log cannot be read, or what arrived is not what is expected.
    pub(super) fn next<T>(
        &mut self,
        common_s: f64,
        read: impl FnOnce(&Input, At<'_>) -> Result<Vec<T>>,
    ) -> Result<Vec<T>> {
        let excerpt = match &mut self.log {
            Log::Table(table) => table.new_rows()?,
            Log::Binary(window) => window.next()?,
        };
        let Some(excerpt) = excerpt else {
            return Ok(Vec::new());
        };
        let has_records = self.clock.newest_own_s.is_finite();
        let at = At {
            clock: &mut self.clock,
            common_s,
        };
        let (result, is_table) = match &self.log {
            Log::Table(table) => (read(&excerpt, at).map_err(|e| table.locate(e)), true),
            Log::Binary(_) => (read(&excerpt, at).map_err(without_place), false),
        };
        self.trouble = None;
        match result {
            // No such records yet, or none ever. After an outage the window of a binary log holds none either.
            Err(error @ Error::Format { .. }) if !is_table || !has_records => {
                self.trouble = Some(error.to_string());
                Ok(Vec::new())
            }
            result => result,
        }
    }
}

/// Bytes in an error of a window count from the beginning of the window, not of the log.
fn without_place(error: Error) -> Error {
    match error {
        Error::Format {
            path,
            found,
            expected,
            ..
        } => Error::format(path, Location::Whole, found, expected),
        other => other,
    }
}

/// The newest bytes of a binary log.
struct Window {
    path: PathBuf,
    bytes: Vec<u8>,
    read: u64,
}

impl Window {
    fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            bytes: Vec::new(),
            read: 0,
        }
    }

    /// The window, if bytes have arrived since the last time.
    fn next(&mut self) -> Result<Option<Input>> {
        let failed = |error| Error::io(&self.path, error);
        let mut file = File::open(&self.path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        if length == self.read {
            return Ok(None);
        }
        let from = self.read.max(length.saturating_sub(WINDOW as u64));
        if from > self.read {
            self.bytes.clear();
        }
        file.seek(SeekFrom::Start(from)).map_err(failed)?;
        let before = self.bytes.len();
        file.take(length.saturating_sub(from))
            .read_to_end(&mut self.bytes)
            .map_err(failed)?;
        self.read = from + (self.bytes.len() - before) as u64;
        let old = self.bytes.len().saturating_sub(WINDOW);
        self.bytes.drain(..old);
        let excerpt = Input::excerpt(&self.path, self.bytes.clone());
        Ok((!self.bytes.is_empty()).then_some(excerpt))
    }
}

/// The clock of a sensor, whose offset to the common time is learnt from the arrival of its records.
struct LearntClock {
    newest_own_s: f64,
    /// When it began to learn, and the least difference of common and own time since then, seconds.
    learning: Option<(f64, f64)>,
    offset_s: Option<f64>,
}

impl Default for LearntClock {
    fn default() -> Self {
        Self {
            newest_own_s: f64::NEG_INFINITY,
            learning: None,
            offset_s: None,
        }
    }
}

/// The clock of a sensor at the time of a look at its log.
pub(super) struct At<'a> {
    clock: &'a mut LearntClock,
    common_s: f64,
}

impl At<'_> {
    /// Drops the records that are known, and puts the others on the common time; drops them, too, while the offset is
    /// learnt.
    pub(super) fn put_on_common_time<T: Timed>(self, records: &mut Vec<T>) {
        let Self { clock, common_s } = self;
        let newest_s = clock.newest_own_s;
        // A binary log's window begins with known records. A clock that leaps begins anew.
        let last_s = records.last().map_or(newest_s, T::time_s);
        if (-BACK_S..AHEAD_S).contains(&(last_s - newest_s)) {
            records.retain(|record| record.time_s() > newest_s);
        } else {
            (clock.learning, clock.offset_s) = (None, None);
        }
        clock.newest_own_s = last_s;
        if records.is_empty() {
            return;
        }
        let Some(offset_s) = clock.offset_s else {
            let late_s = common_s - last_s;
            let (since_s, least_s) = clock.learning.unwrap_or((common_s, f64::INFINITY));
            let least_s = least_s.min(late_s);
            clock.learning = Some((since_s, least_s));
            if common_s - since_s > LEARNING_S {
                let is_common = least_s.abs() < SAME_CLOCK_S;
                clock.offset_s = Some(if is_common { 0.0 } else { least_s });
            }
            records.clear();
            return;
        };
        for record in records {
            *record.time_s_mut() += offset_s;
        }
    }
}

#[cfg(test)]
mod tests;
