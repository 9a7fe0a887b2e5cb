//! Distances between two clouds: M3C2 and its statistics.

mod agreement;
mod cells;
mod checks;
mod core_points;
mod cylinder;
mod detection;
mod groups;
pub mod m3c2;
mod map;
mod moments;
mod normals;
mod passes;
mod places;
mod result;
mod scales;
mod search;
mod settings;
pub mod statistics;
mod sums;
mod surface;
mod window;

pub use agreement::{Against, Agreement, Agreements, MountingKind, PassComparison, agreements};
pub use checks::Normals;
pub use core_points::{core_indices, core_points};
pub use m3c2::m3c2;
pub use map::{DistanceMap, Histogram};
pub use passes::{PassCells, PassDistances, TimedPoint};
pub use result::{CoreDistance, M3c2};
pub use scales::{Computed, MeasuredScales, OpenSettings, Scales, StreamedCloud};
pub use search::reach_m;
pub use settings::{Aggregation, ComparisonSettings, Detection};
pub use statistics::Statistics;
pub use surface::{IndexedClouds, ReferenceSurface};
