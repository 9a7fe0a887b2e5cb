//! Campaigns: many plots on many dates, as items that follow from the content of their inputs.
//!
//! [`Campaign`] is what is to be done, [`Plan`] finds its items among the files, [`work`] does one item, [`Pool`] all of
//! them on one machine, and [`conclude`] makes the index and the page. Items are independent but for those that they
//! name, appear whole or not at all, and are not done twice: whatever schedules processes can do them.

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

pub use conclude::conclude;
pub use hashes::hashes;
pub use item::{ContentHash, Failure, InputFile, Item, Kind, MountingsFrom, ProjectText, Task};
pub use listing::Listing;
pub use pattern::{Pattern, Place};
pub use plan::Plan;
pub use pool::{Pool, Tally, keep_failure, not_tried};
pub use settings::Campaign;
pub use share::{Share, check_memory};
pub use work::{clean, work};
