//! Mistakes that the raw logs and the first placement of the scans show, before anything is adjusted.
//!
//! Units that cannot be meant are errors; all else is said as a [`Verdict`](crate::verdict::Verdict).

mod logs;
mod scans;
mod turns;

pub use logs::{HEADING_SIGN, LateLog, Log, late_logs, logs, position_noise};
pub use scans::{Placed, Placement, scans};
