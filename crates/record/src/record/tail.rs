//! New records of a log that grows.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::{GrowingTable, Input, has_grown};
use crate::sensor::{Continued, Timed};

/// The largest number of bytes of a log that are read at a time. For a binary log they include the last seconds before
/// the new bytes, because the times of new records are computed from earlier ones.
const WINDOW: usize = 1 << 18;
/// The offset of a sensor's clock is the smallest difference of arrival time and sensor time during this time, seconds.
const ESTIMATION_S: f64 = 4.0;
/// How long remarks of a reader are shown, seconds.
const REMARKS_S: f64 = 10.0;
/// If the offset is smaller than this, the sensor's clock is taken to show the common time, seconds.
const SAME_CLOCK_S: f64 = 0.25;
/// If sensor times go back by more than this, the sensor was restarted, as when a whole log is read. If they leap ahead
/// by more than `AHEAD_S`, its clock was set. Seconds.
const BACK_S: f64 = 1.0;
const AHEAD_S: f64 = 3600.0;

/// A log that grows, and the clock of its sensor.
pub(super) struct Tail {
    log: Log,
    times: Continued,
    clock: EstimatedClock,
    /// Why the newest bytes hold no record.
    trouble: Option<String>,
    /// The last remarks of the reader, and their common time, seconds.
    remarks: Option<(String, f64)>,
}

enum Log {
    Table(GrowingTable),
    Binary(Window),
}

impl Tail {
    pub(super) fn new(path: &Path) -> Self {
        let is_table = path.extension().is_some_and(|extension| extension == "csv");
        let (log, times) = if is_table {
            let table = GrowingTable::newest(path, WINDOW as u64);
            (Log::Table(table), Continued::default())
        } else {
            (Log::Binary(Window::new(path)), Continued::in_windows())
        };
        Self {
            log,
            times,
            clock: EstimatedClock::default(),
            trouble: None,
            remarks: None,
        }
    }

    /// What the reader of the log left out or assumed in the last seconds.
    pub(super) fn remarks(&self) -> Option<&str> {
        self.remarks.as_ref().map(|(text, _)| text.as_str())
    }

    /// Why the newest bytes hold no record.
    pub(super) fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }

    /// The records that have arrived since the last call; none while the offset of their clock is being estimated.
    /// `read` reads an excerpt of the log, continues its times, and converts them to the common time with the clock.
    ///
    /// # Errors
    /// The log cannot be read, or the new bytes are not in its format.
    pub(super) fn next<T>(
        &mut self,
        common_s: f64,
        read: impl FnOnce(&Input, &mut Continued, At<'_>) -> Result<Vec<T>>,
    ) -> Result<Vec<T>> {
        let is_old = |(_, at_s): &(String, f64)| common_s - at_s > REMARKS_S;
        if self.remarks.as_ref().is_some_and(is_old) {
            self.remarks = None;
        }
        let excerpt = match &mut self.log {
            Log::Table(table) => table.new_rows()?,
            Log::Binary(window) => window.next()?,
        };
        let Some(excerpt) = excerpt else {
            return Ok(Vec::new());
        };
        let has_records = self.clock.newest_sensor_s.is_finite();
        let at = At {
            clock: &mut self.clock,
            common_s,
        };
        let records = read(&excerpt, &mut self.times, at);
        let (result, is_table) = match &self.log {
            Log::Table(table) => (records.map_err(|e| table.locate(e)), true),
            Log::Binary(_) => (records.map_err(without_location), false),
        };
        self.trouble = None;
        let remarks = excerpt.remarks();
        if !remarks.is_empty() {
            let name = excerpt.path().file_name().unwrap_or_default().display();
            self.remarks = Some((format!("{name}: {}", remarks.join("; ")), common_s));
        }
        match result {
            // The log may have no such records yet, or at all. After an outage, the window of a binary log has none.
            Err(error @ Error::Format { .. }) if !is_table || !has_records => {
                self.trouble = Some(error.to_string());
                Ok(Vec::new())
            }
            result => result,
        }
    }
}

/// Drops the location from an error, because it counts bytes from the beginning of the window and not of the log.
fn without_location(error: Error) -> Error {
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

    /// The window, if bytes have arrived since the last call.
    fn next(&mut self) -> Result<Option<Input>> {
        let failed = |error| Error::io(&self.path, error);
        let mut file = File::open(&self.path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        if !has_grown(&self.path, self.read, length)? {
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

/// The clock of a sensor. Its offset to the common time is estimated from the arrival times of its records.
struct EstimatedClock {
    newest_sensor_s: f64,
    /// Common time at which the estimation began, and the smallest difference of common and sensor time since then,
    /// seconds.
    estimation: Option<(f64, f64)>,
    offset_s: Option<f64>,
}

impl Default for EstimatedClock {
    fn default() -> Self {
        Self {
            newest_sensor_s: f64::NEG_INFINITY,
            estimation: None,
            offset_s: None,
        }
    }
}

/// The clock of a sensor when its log is read.
pub(super) struct At<'a> {
    clock: &'a mut EstimatedClock,
    common_s: f64,
}

impl At<'_> {
    /// Drops the records that were returned before and converts the others to the common time. While the offset is
    /// being estimated, drops all.
    pub(super) fn put_on_common_time<T: Timed>(self, records: &mut Vec<T>) {
        let Self { clock, common_s } = self;
        let newest_s = clock.newest_sensor_s;
        // The window of a binary log begins with records returned before. After a leap, the offset is estimated again.
        let last_s = records.last().map_or(newest_s, T::time_s);
        if (-BACK_S..AHEAD_S).contains(&(last_s - newest_s)) {
            records.retain(|record| record.time_s() > newest_s);
        } else {
            (clock.estimation, clock.offset_s) = (None, None);
        }
        clock.newest_sensor_s = last_s;
        if records.is_empty() {
            return;
        }
        let Some(offset_s) = clock.offset_s else {
            let difference_s = common_s - last_s;
            let (since_s, least_s) = clock.estimation.unwrap_or((common_s, f64::INFINITY));
            let least_s = least_s.min(difference_s);
            clock.estimation = Some((since_s, least_s));
            if common_s - since_s > ESTIMATION_S {
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
