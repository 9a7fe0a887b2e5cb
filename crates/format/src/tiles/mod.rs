//! Processing of clouds of any size, from file to file: data that do not fit in memory go to disk
//! in tiles.
//!
//! The results do not depend on the memory limit or on the tiles.

mod compare;
mod features;
mod plane;
mod records;
mod rows;
mod source;
mod stage;
mod store;
mod surroundings;
mod thin;

pub use crate::format::memory::{free_bytes, limit_memory, peak_memory_bytes};
pub use compare::{Compared, Comparison, NormalSource, Orientation, compare};
pub use features::{FeatureSettings, FeatureSummary, features};
pub use plane::{Rectangle, Tiles};
pub use rows::{FEATURE_COLUMNS, FeatureRow};
pub use source::CloudSource;
pub use store::{TilePoints, TileStore};
pub use surroundings::{TilingSummary, surroundings};
pub use thin::{Thinned, thin};
