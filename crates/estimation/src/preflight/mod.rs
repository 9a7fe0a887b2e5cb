//! Mistakes that the raw logs and the first placement of the scans show, before anything is adjusted.
//!
//! Impossible units are errors; everything else becomes a [`Verdict`](crate::verdict::Verdict).

mod alternatives;
mod differences;
mod fans;
mod logs;
mod measured;
mod scans;
mod turns;

/// Differences of time scales, seconds.
const TIME_SCALES_S: [(f64, &str); 3] = [
    (18.0, "GPS and UTC"),
    (19.0, "TAI and GPS"),
    (37.0, "TAI and UTC"),
];

pub use fans::fans;
pub use logs::{HEADING_SIGN, LateLog, Log, late_logs, logs, position_noise};
pub use measured::unmeasured;
pub use scans::{Placed, Placement, scans};
