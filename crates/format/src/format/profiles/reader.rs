//! The interface of all profile readers.

use crate::error::Result;
use crate::sensor::ScanPoint;

/// A recording of one scanner, read once from start to end.
pub trait ProfileReader: Send {
    /// Replaces the content of `into` with the next points in time order, about 200,000 at most.
    /// At the end, returns false and leaves `into` empty.
    ///
    /// # Errors
    /// Data that are damaged or violate the format; times that go backwards; a recording without
    /// any valid point.
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool>;

    /// Bytes of the file read so far; approximate for compressed files.
    fn bytes_read(&self) -> u64;

    /// Size of the file in bytes.
    fn bytes_total(&self) -> u64;
}
