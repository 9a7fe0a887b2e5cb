//! How far apart two clouds are: M3C2 and its statistics.

mod cylinder;
mod detection;
pub mod m3c2;
mod normals;
pub mod statistics;
pub mod student;

pub use m3c2::{CoreDistance, IndexedClouds, M3c2, Normals, core_points, m3c2};
pub use statistics::{Histogram, Statistics};
