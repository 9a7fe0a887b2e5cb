//! Text: lines, tables, units, dates, YAML.

pub(super) mod civil;
pub(super) mod growing;
pub(super) mod lines;
pub(super) mod numerals;
pub(super) mod table;
pub(super) mod unit;
pub(super) mod whole_lines;
mod windows;
pub(super) mod yaml;
