//! Arrival times: `NAME.stamps.csv`.

use std::path::Path;

use super::clock::RecordingClock;
use super::{GAP_INTERVALS, GAP_S, stamps_of};
use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::format::text::table::{Columns, Table};
use crate::sensor::longest_increasing;
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
    /// Whether no row is missing between this row and the one before.
    follows: bool,
}

/// The rows of a file that fit each other, in order.
struct Rows {
    rows: Vec<Row>,
    /// Number of rows left out because they are damaged, and of places where rows are missing.
    damaged: usize,
}

impl Rows {
    /// Reads a file without a last row that a crash cut off. Rows that cannot be read are left out, and so are the fewest
    /// rows whose places or times contradict others: in a log, neither goes back.
    fn read(path: &Path) -> Result<Self> {
        let mut table = Table::open(&Input::from(path), &COLUMNS)?;
        let (mut rows, mut damaged, mut follows) = (Vec::new(), 0, true);
        loop {
            let mut cells = [0.0; 2];
            match table.next_row(&mut cells) {
                Ok(false) => break,
                Ok(true) => {
                    let [before, monotonic_s] = cells;
                    rows.push(Row {
                        before: before as u64,
                        monotonic_s,
                        follows,
                    });
                    follows = true;
                }
                Err(Error::Format { .. }) => {
                    damaged += 1;
                    follows = false;
                }
                Err(error) => return Err(error),
            }
        }
        let all = rows.len();
        let rows = increasing(&rows, |_, row| row.before as f64);
        // Equal times are in order.
        let mut rows = increasing(&rows, |i, row| row.monotonic_s + 1e-9 * i as f64);
        damaged += all - rows.len();
        let mut last = 0;
        for row in &mut rows {
            if row.follows && row.before > last + LARGEST_PIECE {
                row.follows = false;
                damaged += 1;
            }
            last = row.before;
        }
        Ok(Self { rows, damaged })
    }
}

/// As many rows as possible whose values increase. A row after one that is left out does not follow.
fn increasing(rows: &[Row], value: impl Fn(usize, &Row) -> f64) -> Vec<Row> {
    let values: Vec<f64> = rows
        .iter()
        .enumerate()
        .map(|(i, row)| value(i, row))
        .collect();
    let mut next = 0;
    let kept = longest_increasing(&values).into_iter().map(|index| {
        let skipped = std::mem::replace(&mut next, index + 1)..index;
        Row {
            follows: skipped.is_empty() && rows[index].follows,
            ..rows[index]
        }
    });
    kept.collect()
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
        let Rows { rows, damaged } = Rows::read(path)?;
        let follows: Vec<bool> = rows.iter().skip(1).map(|row| row.follows).collect();
        let pieces = rows.iter().enumerate().map(|(i, row)| {
            // If two rows contradict each other, either may be wrong, so none near them is a bound of a piece.
            let near = &follows[i.saturating_sub(1)..follows.len().min(i + 2)];
            let next = rows
                .get(i + 1)
                .filter(|_| near.iter().all(|follows| *follows));
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
/// piece of a damaged row is joined to the piece before, and cut at the largest size of a piece. The last piece ends
/// with the log, or at the largest size.
pub struct Pieces {
    pieces: std::vec::IntoIter<(usize, f64)>,
    last_s: f64,
}

impl Pieces {
    /// Reads the arrival times of a log.
    ///
    /// # Errors
    /// The log or its arrival times cannot be read.
    pub fn open(log: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(log)
            .map_err(|error| Error::io(log, error))?
            .len();
        let Rows { rows, .. } = Rows::read(&stamps_of(log))?;
        let mut pieces = Vec::with_capacity(rows.len());
        let mut sent = 0;
        for (i, row) in rows.iter().enumerate() {
            // After a crash, the rest of the log has no arrival time.
            let rest = row.before.saturating_add(LARGEST_PIECE);
            let end = rows.get(i + 1).map_or(rest, |next| next.before).min(bytes);
            while sent < end {
                let length = (end - sent).min(LARGEST_PIECE);
                pieces.push((length as usize, row.monotonic_s));
                sent += length;
            }
        }
        let last_s = pieces.last().map_or(0.0, |(_, at_s)| *at_s);
        Ok(Self {
            pieces: pieces.into_iter(),
            last_s,
        })
    }

    /// Arrival time of the last piece, seconds of the monotonic clock.
    pub fn last_s(&self) -> f64 {
        self.last_s
    }
}

impl Iterator for Pieces {
    type Item = (usize, f64);

    fn next(&mut self) -> Option<Self::Item> {
        self.pieces.next()
    }
}
