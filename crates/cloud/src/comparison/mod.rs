//! Distances between two clouds: M3C2 and its statistics.

mod agreement;
mod cells;
mod checks;
mod cylinder;
mod detection;
mod groups;
pub mod m3c2;
mod map;
mod moments;
mod normals;
mod result;
mod search;
mod settings;
pub mod statistics;
mod sums;
mod surface;
mod window;

pub use agreement::{Against, Agreement, Agreements, MountingKind, agreements};
pub use checks::Normals;
pub use m3c2::{core_indices, core_points, m3c2};
pub use map::{DistanceMap, Histogram};
pub use result::{CoreDistance, M3c2};
pub use search::reach_m;
pub use settings::{Aggregation, ComparisonSettings, Detection};
pub use statistics::Statistics;
pub use surface::{IndexedClouds, ReferenceSurface};
