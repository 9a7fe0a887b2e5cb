//! Mountings of scanners, read, and written for other programs.

pub(super) mod bonn_xml;
pub(super) mod others;
pub(super) mod table;
