//! Where the adjustment starts, from the data alone.

mod attitude;
mod heading_prior;
mod neighbours;
mod prism_motion;
mod start;

pub use start::{Initial, initial};
