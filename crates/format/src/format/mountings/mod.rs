//! Readers of scanner mountings, and writers for other programs.

pub(super) mod bonn_xml;
pub(super) mod others;
pub(super) mod table;
