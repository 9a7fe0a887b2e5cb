//! Times of arrival: `NAME.stamps.csv`.

use std::path::{Path, PathBuf};

use super::clock::RecordingClock;
use super::{GAP_INTERVALS, GAP_S, stamps_of};
use crate::error::{Error, Result};
use crate::format::text::table::{Columns, Table};
use crate::statistics::median;

const COLUMNS: Columns<'_> = Columns {
    needed: &["bytes_before", "monotonic_s"],
    optional: &[],
};

/// When the pieces of a log arrived, in their order.
pub(super) struct Arrivals {
    /// Bytes of the log before each.
    before: Vec<u64>,
    /// Common time, seconds.
    at_s: Vec<f64>,
}

impl Arrivals {
    /// Reads them; a last row that a crash cut off is left out.
    pub(super) fn read(path: &Path, clock: &RecordingClock) -> Result<Self> {
        let (mut before, mut at_s) = (Vec::new(), Vec::new());
        let mut table = Table::open(path, &COLUMNS)?;
        for [bytes, monotonic_s] in std::iter::from_fn(|| row(&mut table)) {
            before.push(bytes as u64);
            at_s.push(clock.common_s(monotonic_s));
        }
        Ok(Self { before, at_s })
    }

    /// When the piece arrived in which a record ends.
    pub(super) fn of(&self, end: u64) -> Option<f64> {
        let piece = self.before.partition_point(|before| *before < end);
        self.at_s.get(piece.checked_sub(1)?).copied()
    }

    /// How often nothing arrived for long, and the longest of these times, seconds.
    pub(super) fn gaps(&self) -> (usize, f64) {
        let waits = self.at_s.windows(2).map(|pair| pair[1] - pair[0]);
        let usual_s = median(waits.clone()).unwrap_or(0.0);
        let long = waits.filter(|wait| *wait > (GAP_INTERVALS * usual_s).max(GAP_S));
        long.fold((0, 0.0), |(count, longest), wait| {
            (count + 1, f64::max(longest, wait))
        })
    }
}

/// The pieces of a log in their order: how many bytes each has, and when it arrived, seconds of the monotonic clock.
pub struct Pieces {
    path: PathBuf,
    table: Table,
    next: Option<[f64; 2]>,
    /// Of the whole log.
    bytes: u64,
}

impl Pieces {
    /// Opens the times of arrival of a log.
    ///
    /// # Errors
    /// The log or its times of arrival cannot be read.
    pub fn open(log: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(log)
            .map_err(|error| Error::io(log, error))?
            .len();
        let path = stamps_of(log);
        let mut table = Table::open(&path, &COLUMNS)?;
        let next = row(&mut table);
        Ok(Self {
            path,
            table,
            next,
            bytes,
        })
    }

    /// When the last piece arrived, seconds of the monotonic clock.
    ///
    /// # Errors
    /// See [`Self::open`].
    pub fn last_s(&self) -> Result<f64> {
        let mut table = Table::open(&self.path, &COLUMNS)?;
        let rows = std::iter::from_fn(|| row(&mut table));
        Ok(rows.last().map_or(0.0, |[_, at_s]| at_s))
    }
}

/// The next row; none where the file ends, or a crash cut it off.
fn row(table: &mut Table) -> Option<[f64; 2]> {
    let mut row = [0.0; 2];
    matches!(table.next_row(&mut row), Ok(true)).then_some(row)
}

impl Iterator for Pieces {
    type Item = (usize, f64);

    fn next(&mut self) -> Option<Self::Item> {
        let [before, at_s] = self.next?;
        self.next = row(&mut self.table);
        let end = self.next.map_or(self.bytes as f64, |[before, _]| before);
        Some(((end - before).max(0.0) as usize, at_s))
    }
}
