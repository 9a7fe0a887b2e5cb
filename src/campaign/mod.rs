//! Campaigns: many plots on many dates, as items that are identified by the content of their inputs.
//!
//! [`Campaign`] holds the settings, [`Plan`] finds the items among the files, [`work`] runs one item, [`Pool`] runs all
//! of them on one machine, and [`conclude`] makes the index and the page. Items are independent except for those that
//! they name, appear completely or not at all, and are not run twice: any scheduler of processes can run them.

mod conclude;
mod hashes;
mod item;
mod listing;
mod pattern;
mod plan;
mod pool;
mod settings;
mod share;
mod template;
mod work;

pub use conclude::{RESULTS, conclude};
pub use hashes::hashes;
pub use item::{ContentHash, Failure, InputFile, Item, Kind, MountingsFrom, ProjectText, Task};
pub use listing::Listing;
pub use pattern::{Pattern, Place};
pub use plan::Plan;
pub use pool::{Pool, Tally, keep_failure, not_tried};
pub use settings::Campaign;
pub use share::{Share, check_memory};
pub use work::{clean, work};
