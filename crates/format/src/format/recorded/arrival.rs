//! Arrival times: `NAME.stamps.csv`.

use std::path::{Path, PathBuf};

use super::clock::RecordingClock;
use super::{GAP_INTERVALS, GAP_S, stamps_of};
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::text::table::{Columns, Table};
use crate::statistics::median;

const COLUMNS: Columns<'_> = Columns {
    needed: &["bytes_before", "monotonic_s"],
    optional: &[],
};
/// The largest size of a piece, bytes: a recorder reads at most 64 KiB at a time, and a time put before each line makes
/// them at most ten times longer, if every line is one character.
const LARGEST_PIECE: u64 = 1 << 20;

/// A row of the file: when a piece of a log arrived.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Bytes of the log before the piece.
    before: u64,
    /// Seconds of the monotonic clock.
    monotonic_s: f64,
    /// Whether no damaged row lies between this row and the one before.
    follows: bool,
}

impl Row {
    /// Whether this row can follow the row `last`: neither position nor time goes back, and the piece is not too large.
    fn fits(&self, last: &Self) -> bool {
        let places = last.before..=last.before.saturating_add(LARGEST_PIECE);
        self.follows && last.monotonic_s <= self.monotonic_s && places.contains(&self.before)
    }
}

/// The rows of a file in order. Damaged rows are skipped, as is a last row that a crash cut off.
#[derive(Debug)]
struct Rows {
    table: Table,
    /// Damaged rows so far.
    damaged: usize,
}

impl Rows {
    fn open(path: &Path) -> Result<Self> {
        Ok(Self {
            table: Table::open(&Input::from(path), &COLUMNS)?,
            damaged: 0,
        })
    }

    fn next(&mut self) -> Result<Option<Row>> {
        let mut follows = true;
        loop {
            let mut cells = [0.0; 2];
            match self.table.next_row(&mut cells) {
                Ok(false) => return Ok(None),
                Ok(true) => {
                    let [before, monotonic_s] = cells;
                    return Ok(Some(Row {
                        before: before as u64,
                        monotonic_s,
                        follows,
                    }));
                }
                Err(Error::Format { .. }) => {
                    self.damaged += 1;
                    follows = false;
                }
                Err(error) => return Err(error),
            }
        }
    }
}

/// A piece of a log.
struct Piece {
    /// Bytes of the log before it.
    before: u64,
    /// Bytes of the log up to its end; `None` if unknown.
    end: Option<u64>,
    /// When it arrived, common time, seconds.
    at_s: f64,
}

/// The pieces of a log in order, with their arrival times.
pub(super) struct Arrivals {
    pieces: Vec<Piece>,
    /// Number of damaged rows.
    pub(super) damaged: usize,
}

impl Arrivals {
    /// Reads all rows of a file.
    pub(super) fn read(path: &Path, clock: &RecordingClock) -> Result<Self> {
        let mut reader = Rows::open(path)?;
        let mut rows = Vec::new();
        while let Some(row) = reader.next()? {
            rows.push(row);
        }
        let fits: Vec<bool> = rows.windows(2).map(|pair| pair[1].fits(&pair[0])).collect();
        let pairs = rows.iter().skip(1).zip(&fits);
        let damaged = reader.damaged + pairs.filter(|(row, fits)| row.follows && !**fits).count();
        let pieces = rows.iter().enumerate().map(|(i, row)| {
            // If two rows contradict each other, either may be wrong, so neither is used as a bound of a piece.
            let near = &fits[i.saturating_sub(1)..fits.len().min(i + 2)];
            let next = rows.get(i + 1).filter(|_| near.iter().all(|fits| *fits));
            Piece {
                before: row.before,
                end: next.map(|next| next.before),
                at_s: clock.common_s(row.monotonic_s),
            }
        });
        Ok(Self {
            pieces: pieces.collect(),
            damaged,
        })
    }

    /// Arrival time of the piece in which a record ends, common time, seconds; `None` if unknown. After a crash the log
    /// may continue beyond its arrival times, so that the end of the last piece is unknown.
    pub(super) fn arrival_s(&self, end: u64) -> Option<f64> {
        let next = self.pieces.partition_point(|piece| piece.before < end);
        let piece = self.pieces.get(next.checked_sub(1)?)?;
        (end <= piece.end?).then_some(piece.at_s)
    }

    /// Number of gaps between arrivals, and the longest gap, seconds.
    pub(super) fn gaps(&self) -> (usize, f64) {
        let known = |pair: &&[Piece]| pair[0].end.is_some();
        let pairs = self.pieces.windows(2).filter(known);
        let waits = pairs.map(|pair| pair[1].at_s - pair[0].at_s);
        let usual_s = median(waits.clone()).unwrap_or(0.0);
        let long = waits.filter(|wait| *wait > (GAP_INTERVALS * usual_s).max(GAP_S));
        long.fold((0, 0.0), |(count, longest), wait| {
            (count + 1, f64::max(longest, wait))
        })
    }
}

/// The pieces of a log in order: the number of bytes of each, and its arrival time, seconds of the monotonic clock. The
/// piece of a damaged row is joined to the piece before. The last piece ends with the log, or at the largest size of a
/// piece.
pub struct Pieces {
    path: PathBuf,
    rows: Rows,
    next: Option<Row>,
    /// Size of the log.
    bytes: u64,
}

impl Pieces {
    /// Opens the arrival times of a log.
    ///
    /// # Errors
    /// The log or its arrival times cannot be read.
    pub fn open(log: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(log)
            .map_err(|error| Error::io(log, error))?
            .len();
        let path = stamps_of(log);
        let mut rows = Rows::open(&path)?;
        let next = rows.next()?;
        Ok(Self {
            path,
            rows,
            next,
            bytes,
        })
    }

    /// Arrival time of the last piece, seconds of the monotonic clock.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub fn last_s(&self) -> Result<f64> {
        let mut rows = Rows::open(&self.path)?;
        let mut last_s = 0.0;
        while let Some(row) = rows.next()? {
            last_s = row.monotonic_s;
        }
        Ok(last_s)
    }

    /// The piece that begins at a row.
    fn piece(&mut self, row: Row) -> Result<(usize, f64)> {
        let Row {
            before,
            monotonic_s,
            ..
        } = row;
        self.next = self.rows.next()?;
        let end = match self.next {
            Some(next) => next.before,
            // The rest of the log has no arrival time.
            None => self
                .bytes
                .clamp(before, before.saturating_add(LARGEST_PIECE)),
        };
        let length = end.checked_sub(before);
        match length.filter(|length| *length <= LARGEST_PIECE) {
            Some(length) => Ok((length as usize, monotonic_s)),
            None => Err(Error::format(
                &self.path,
                Location::Whole,
                format!("a piece from byte {before} to byte {end}"),
                format!("pieces of at most {LARGEST_PIECE} bytes, one after the other"),
            )),
        }
    }
}

impl Iterator for Pieces {
    type Item = Result<(usize, f64)>;

    fn next(&mut self) -> Option<Self::Item> {
        let row = self.next.take()?;
        Some(self.piece(row))
    }
}
