//! Work on clouds of any size, from file to file: what does not fit in memory goes to disk in tiles.
//!
//! The results do not depend on the memory given, nor on how the plane is cut.

mod compare;
mod features;
mod memory;
mod plane;
mod records;
mod rows;
mod source;
mod stage;
mod store;
mod surroundings;
mod thin;

pub use compare::{Compared, Comparison, NormalSource, compare};
pub use features::{FeatureSettings, FeatureWork, features};
pub use memory::peak_memory_bytes;
pub use plane::{Rectangle, Tiles};
pub use source::CloudSource;
pub use store::{Stream, TilePoints, TileStore};
pub use surroundings::{TiledWork, surroundings};
pub use thin::{Thinned, thin};
