//! Damaged places of a recording: what is said of them, and the next chunk behind them in MCAP.

use super::mcap;
use super::records::Cursor;
use super::walk::Walk;
use crate::error::{Error, Result};

/// Bytes that are searched at a time.
const WINDOW: usize = 1 << 20;
/// More bytes than the prefix and the head of a chunk have.
const HEAD: usize = 256;

impl Walk {
    /// Passes over a damaged place.
    pub(super) fn pass_over(&mut self, error: Error) {
        self.damage.0 += 1;
        self.damage.1.get_or_insert(error);
    }

    /// Remarks on damage that was passed over and on a recording that is cut off.
    pub(super) fn remark(&self) {
        self.remark_unmerged();
        if let (count, Some(first)) = &self.damage {
            self.input().remark(format!(
                "damaged places of the recording left out: {count}, the first: {first}"
            ));
        }
        if self.is_cut {
            let name = self.path().file_name().unwrap_or_default();
            self.input().remark(format!(
                "{} is cut off at byte {}: it is read to its last complete message",
                name.display(),
                self.bytes_total()
            ));
        }
    }

    /// The error of the first damaged place, for a recording of which nothing can be read.
    pub(super) fn take_damage(&mut self) -> Option<Error> {
        self.damage.1.take()
    }

    /// Goes to the next chunk after byte `from` of an MCAP file; false if there is none.
    pub(super) fn find_chunk(&mut self, from: u64) -> Result<bool> {
        let mut start = from;
        let mut window = Vec::new();
        while start + (mcap::PREFIX as u64) < self.end() {
            let left = self.end() - start;
            window.resize(WINDOW.min(usize::try_from(left).unwrap_or(WINDOW)), 0);
            self.read_at(start, &mut window)?;
            let is_last = window.len() as u64 == left;
            let searched = if is_last {
                window.len()
            } else {
                window.len() - HEAD
            };
            let found = (0..searched)
                .find(|at| mcap::begins_chunk(Cursor(&window[*at..]), left - *at as u64));
            if let Some(at) = found {
                self.seek(start + at as u64)?;
                return Ok(true);
            }
            start += searched as u64;
        }
        Ok(false)
    }
}
