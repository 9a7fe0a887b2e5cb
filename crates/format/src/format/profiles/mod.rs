//! Recordings of profile scanners.

pub(super) mod bonn;
pub(super) mod bonn_processed;
pub(super) mod gocator_csv;
pub mod gocator_stream;
pub(super) mod reader;
pub(super) mod table;
