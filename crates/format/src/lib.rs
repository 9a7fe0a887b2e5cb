//! Readers and writers of sensor logs, scans, trajectories and clouds; clouds larger than memory: a part of [boresight](https://crates.io/crates/boresight), which hands it on whole.
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

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{cloud, comparison, error, geometry, output, progress, statistics, stored};
