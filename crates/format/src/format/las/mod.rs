//! LAS and LAZ: read defensively, written in batches, copied with further dimensions.

pub(super) mod batches;
pub(super) mod chunks;
pub(super) mod columns;
pub(super) mod copc;
pub(super) mod extra;
pub(super) mod file;
pub(super) mod frame;
pub(super) mod header;
pub(super) mod kind;
pub(super) mod losses;
pub(super) mod points;
pub(super) mod record;
pub(super) mod scan;
pub(super) mod units;
pub(super) mod value;
pub(super) mod writer;
