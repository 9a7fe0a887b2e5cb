//! Times of arrival: `NAME.stamps.csv`.

use std::path::{Path, PathBuf};

use super::clock::RecordingClock;
use super::{GAP_INTERVALS, GAP_S, stamps_of};
use crate::error::{Error, Location, Result};
use crate::format::text::table::{Columns, Table};
use crate::statistics::median;

const COLUMNS: Columns<'_> = Columns {
    needed: &["bytes_before", "monotonic_s"],
    optional: &[],
};
/// The largest size of a piece, bytes: a recorder reads at most 64 KiB at a time, and putting a time before each line
/// makes that at most ten times as long, where every line has one character.
const LARGEST_PIECE: u64 = 1 << 20;

/// A row of the file: when a piece of a log arrived.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Bytes of the log before the piece.
    before: u64,
    /// Seconds of the monotonic clock.
    monotonic_s: f64,
    /// Whether it directly follows the row before it, with no damaged one between them.
    follows: bool,
}

impl Row {
    /// Whether it can be the row after `last`: places and times do not go back, and the piece is not too large.
    fn fits(&self, last: &Self) -> bool {
        let places = last.before..=last.before.saturating_add(LARGEST_PIECE);
        self.follows && last.monotonic_s <= self.monotonic_s && places.contains(&self.before)
    }
}

/// The rows of a file, one after the other. Damaged rows are skipped, and so is a last one that a crash cut off.
#[derive(Debug)]
struct Rows {
    table: Table,
    /// Damaged rows so far.
    damaged: usize,
}

impl Rows {
    fn open(path: &Path) -> Result<Self> {
        Ok(Self {
            table: Table::open(path, &COLUMNS)?,
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
    /// Bytes of the log up to its end; `None` where that is not known.
    end: Option<u64>,
    /// When it arrived, common time, seconds.
    at_s: f64,
}

/// When the pieces of a log arrived, in their order.
pub(super) struct Arrivals {
    pieces: Vec<Piece>,
    /// How many rows are damaged.
    pub(super) damaged: usize,
}

impl Arrivals {
    /// Reads them.
    pub(super) fn read(path: &Path, clock: &RecordingClock) -> Result<Self> {
        let mut read = Rows::open(path)?;
        let mut rows = Vec::new();
        while let Some(row) = read.next()? {
            rows.push(row);
        }
        let fits: Vec<bool> = rows.windows(2).map(|pair| pair[1].fits(&pair[0])).collect();
        let pairs = rows.iter().skip(1).zip(&fits);
        let damaged = read.damaged + pairs.filter(|(row, fits)| row.follows && !**fits).count();
        let pieces = rows.iter().enumerate().map(|(i, row)| {
            // Where two rows do not fit together, either may be wrong, so neither may bound a piece.
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

    /// When the piece arrived in which a record ends; `None` where that is not known. After a crash the log may go on
    /// after its last time of arrival, so that the end of the last piece is not known.
    pub(super) fn of(&self, end: u64) -> Option<f64> {
        let next = self.pieces.partition_point(|piece| piece.before < end);
        let piece = self.pieces.get(next.checked_sub(1)?)?;
        (end <= piece.end?).then_some(piece.at_s)
    }

    /// How often nothing arrived for long, and the longest of these times, seconds.
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

/// The pieces of a log in their order: how many bytes each has, and when it arrived, seconds of the monotonic clock.
/// Where a row is damaged, its piece is joined to the one before. The last piece ends with the log, or at
/// the largest size of a piece.
pub struct Pieces {
    path: PathBuf,
    rows: Rows,
    next: Option<Row>,
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
        let mut rows = Rows::open(&path)?;
        let next = rows.next()?;
        Ok(Self {
            path,
            rows,
            next,
            bytes,
        })
    }

    /// When the last piece arrived, seconds of the monotonic clock.
    ///
    /// # Errors
    /// See [`Self::open`].
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
            // Whatever follows has no time of arrival.
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
