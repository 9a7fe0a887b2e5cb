//! The trajectory: from logs to poses with standard deviations, and poses at any time between.

mod interpolate;

pub use interpolate::{PoseCursor, Trajectory};
