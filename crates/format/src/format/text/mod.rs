//! Text: lines, tables, units, dates.

pub(super) mod civil;
pub(super) mod lines;
pub(super) mod table;
pub(super) mod unit;
