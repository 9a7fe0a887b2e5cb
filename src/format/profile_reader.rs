//! What every reader of profiles does.

use crate::error::Result;
use crate::sensor::ScanPoint;

/// A recording of one scanner, read once from front to back.
pub trait ProfileReader: Send {
    /// Replaces the content of `into` by the next points in time order, some 200,000 at most;
    /// false, and nothing in `into`, at the end.
    ///
    /// # Errors
    /// What is damaged or contradicts the format; times that go backwards; a recording without
    /// any valid point.
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool>;

    /// Bytes of the file read so far; of compressed files an estimate.
    fn bytes_read(&self) -> u64;

    /// Bytes of the file.
    fn bytes_total(&self) -> u64;
}
