//! Stub.
use crate::sensor::ScanPoint;
/// Stub.
pub trait ProfileReader: Send {
    /// Stub.
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> crate::Result<bool>;
    /// Stub.
    fn bytes_read(&self) -> u64;
    /// Stub.
    fn bytes_total(&self) -> u64;
}
