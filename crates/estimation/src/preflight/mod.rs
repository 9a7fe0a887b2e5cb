//! Mistakes that the raw logs and the first placement of the scans show, before anything is adjusted.
//!
//! Impossible units are errors; everything else is a finding with its numbers.

mod alternatives;
mod contradiction;
mod differences;
mod fans;
mod logs;
mod measured;
mod scans;
mod time_scales;
mod turns;

pub use alternatives::Mistake;
pub use contradiction::{
    Contradiction, HeldAxis, ImuSensor, LateLog, Log, LogFindings, PositionNoise, RoundedPositions,
    VerticalAxis,
};
pub use fans::{View, fans};
pub use logs::{late_logs, logs, position_noise};
pub use measured::unmeasured;
pub use scans::{Misfit, Misplaced, Placed, Placement, scans};
pub use time_scales::TimeScales;
