//! Drift watch: one scanner against the other, drive after drive, from the ground that both see.
//!
//! [`Overlap`] is what one drive in the field shows, without boards and without a reference: how each further scanner
//! sits in the frame of the first, less the mounting in use. [`Chart`] holds the days of a campaign against each
//! other. What all scanners do together does not show. Start with [`overlap`]; then see `cells.rs` (what both saw of
//! one spot), `estimate.rs` and `normal.rs` (the mounting and its covariance), `watch.rs` (the days) and `limit.rs` (its limits).

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
