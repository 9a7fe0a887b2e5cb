//! New records of a log that grows.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::sensor::Timed;

/// Bytes that are looked at: of binary logs some seconds before the new ones, as their times rest on them.
const WINDOW: usize = 1 << 18;
/// Own times are put on the common time by the earliest arrival of so many seconds, if they are not that time.
const LEARNING_S: f64 = 4.0;
/// Own times this near to the common time are that time, seconds.
const SAME_CLOCK_S: f64 = 0.25;
/// Own times that go back by more than a second are those of a sensor that was started again, as when a whole log is
/// read; times that leap ahead by more than an hour are those of a clock that was set. Seconds.
const BACK_S: f64 = 1.0;
const AHEAD_S: f64 = 3600.0;

/// A log that grows, and what was read of it.
pub(super) struct Tail {
    path: PathBuf,
    /// What the reader is given; its name is not that of a recorded log.
    scratch: PathBuf,
    is_table: bool,
    header: Vec<u8>,
    window: Vec<u8>,
    read: u64,
    /// Whether the window begins in the middle of a row, because bytes were passed over.
    begins_cut: bool,
    newest_own_s: f64,
    /// When it began to learn, and the least difference of common and own time since then, seconds.
    learning: Option<(f64, f64)>,
    offset_s: Option<f64>,
    /// Why the newest bytes held no record.
    trouble: Option<String>,
}

impl Tail {
    pub(super) fn new(path: &Path, scratch: &Path) -> Self {
        let extension = path.extension().unwrap_or_default();
        Self {
            path: path.to_owned(),
            scratch: scratch.with_extension(extension),
            is_table: extension == "csv",
            header: Vec::new(),
            window: Vec::new(),
            read: 0,
            begins_cut: false,
            newest_own_s: f64::NEG_INFINITY,
            learning: None,
            offset_s: None,
            trouble: None,
        }
    }

    /// Why the newest bytes held no record.
    pub(super) fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }

    /// The records that arrived since the last time, with their common times; none while the offset of their clock
    /// is learnt.
    ///
    /// # Errors
    /// The log cannot be read, or what arrived is not what is expected.
    pub(super) fn next<T: Timed>(
        &mut self,
        common_s: f64,
        read: impl FnOnce(&Path) -> Result<Vec<T>>,
        time_s: impl Fn(&mut T) -> &mut f64,
    ) -> Result<Vec<T>> {
        if !self.advance()? {
            return Ok(Vec::new());
        }
        let mut records = match read(&self.scratch).map_err(|error| self.of_log(error)) {
            Ok(records) => records,
            // No such records yet, or none ever. After an outage the window of a binary log holds none either.
            Err(error @ Error::Format { .. })
                if !self.is_table || self.newest_own_s == f64::NEG_INFINITY =>
            {
                self.trouble = Some(error.to_string());
                return Ok(Vec::new());
            }
            Err(error) => return Err(error),
        };
        self.trouble = None;
        let newest_s = self.newest_own_s;
        // Binary logs: those of the window before the new ones are known. A clock that leaps begins anew.
        let last_s = records.last().map_or(newest_s, T::time_s);
        if (-BACK_S..AHEAD_S).contains(&(last_s - newest_s)) {
            records.retain(|record| record.time_s() > newest_s);
        } else {
            (self.learning, self.offset_s) = (None, None);
        }
        self.newest_own_s = last_s;
        if records.is_empty() {
            return Ok(records);
        }
        let Some(offset_s) = self.offset_s else {
            let late_s = common_s - last_s;
            let (since_s, least_s) = self.learning.unwrap_or((common_s, f64::INFINITY));
            let least_s = least_s.min(late_s);
            self.learning = Some((since_s, least_s));
            if common_s - since_s > LEARNING_S {
                let is_common = least_s.abs() < SAME_CLOCK_S;
                self.offset_s = Some(if is_common { 0.0 } else { least_s });
            }
            return Ok(Vec::new());
        };
        for record in &mut records {
            *time_s(record) += offset_s;
        }
        Ok(records)
    }

    /// Turns an error in the part that was read into one of the log. Lines and bytes are left out, as they count from
    /// the beginning of that part.
    fn of_log(&self, error: Error) -> Error {
        match error {
            Error::Format {
                found, expected, ..
            } => Error::format(&self.path, Location::Whole, found, expected),
            other => other.renamed(&self.scratch, &self.path),
        }
    }

    /// Writes what is to be read now; false where nothing arrived.
    fn advance(&mut self) -> Result<bool> {
        let failed = |error| Error::io(&self.path, error);
        let mut file = File::open(&self.path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        // Never more than the window, however much arrived.
        let from = self.read.max(length.saturating_sub(WINDOW as u64));
        if length == self.read {
            return Ok(false);
        }
        if self.is_table && self.header.is_empty() {
            let mut start = vec![0; 4096.min(length as usize)];
            file.read_exact(&mut start).map_err(failed)?;
            let Some(end) = start.iter().position(|byte| *byte == b'\n') else {
                return Ok(false);
            };
            start.truncate(end + 1);
            self.header = start;
        }
        let from = from.max(self.header.len() as u64);
        if from > self.read.max(self.header.len() as u64) {
            self.window.clear();
            self.begins_cut = true;
        }
        file.seek(SeekFrom::Start(from)).map_err(failed)?;
        let before = self.window.len();
        file.take(length.saturating_sub(from))
            .read_to_end(&mut self.window)
            .map_err(failed)?;
        self.read = from + (self.window.len() - before) as u64;
        let text = if self.is_table {
            let Some(end) = self.window.iter().rposition(|byte| *byte == b'\n') else {
                if self.window.len() > WINDOW {
                    self.window.clear();
                    self.begins_cut = true;
                }
                return Ok(false);
            };
            let rest = self.window.split_off(end + 1);
            let rows = std::mem::replace(&mut self.window, rest);
            let mut begin = 0;
            if std::mem::take(&mut self.begins_cut) {
                let first = rows.iter().position(|byte| *byte == b'\n');
                begin = first.map_or(0, |at| at + 1);
            }
            [self.header.as_slice(), &rows[begin..]].concat()
        } else {
            let old = self.window.len().saturating_sub(WINDOW);
            self.window.drain(..old);
            self.window.clone()
        };
        if text.len() <= self.header.len() {
            return Ok(false);
        }
        std::fs::write(&self.scratch, text).map_err(|error| Error::io(&self.scratch, error))?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests;
