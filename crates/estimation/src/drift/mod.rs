//! Drift watch: compares the scanners with each other, drive after drive, by the ground that both see.
//!
//! [`Overlap`] is the result of one drive in the field, without boards and without a reference: the difference
//! between the mounting of each further scanner in the frame of the first and its mounting in use. [`Chart`] compares
//! the days of a campaign with each other. A motion that all scanners have in common does not show. Start with
//! [`overlap`]; then see `cells.rs` (spots that two scanners saw), `estimate.rs` and `normal.rs` (the mounting and its
//! covariance), `watch.rs` (the days) and `limit.rs` (the limits).

mod base;
mod cells;
mod chart;
mod cost;
mod estimate;
mod limit;
mod normal;
mod overlap;
mod result;
mod step;
mod watch;

pub use base::Base;
pub use cost::Cost;
pub use estimate::{OverlapInput, check_scanners, overlap};
pub use overlap::{COMPONENTS, Overlap, ScannerOverlap};
pub use result::{Alarm, Chart, ChartDay, ChartSettings, Off, ScannerChart};
