//! How far apart two clouds are: M3C2 and its statistics.

pub mod m3c2;
pub mod statistics;

pub use m3c2::{CoreDistance, M3c2, core_points, m3c2};
pub use statistics::{Histogram, Statistics};
