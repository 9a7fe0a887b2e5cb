//! Readers and writers of sensor logs, scans, trajectories and clouds; clouds larger than memory. Part of [boresight](https://crates.io/crates/boresight), which re-exports all of it.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`sensor`] | measurements of each sensor, validated |
//! | [`mod@format`] | readers and writers, one file per format; detection |
//! | [`tiles`] | clouds larger than memory: features, M3C2, thinning |

pub mod format;
pub mod sensor;
pub mod tiles;

// Modules of the crates below, under the names that they have in `boresight`.
use boresight_cloud::{cloud, comparison, error, geometry, output, progress, statistics};
