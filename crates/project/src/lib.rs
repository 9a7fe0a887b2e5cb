//! Parsing and validation of the file `project.toml`. Part of [boresight](https://crates.io/crates/boresight), which re-exports all of it.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`project`] | `project.toml`: parsing and validation |
//! | [`feed`] | records of a drive's logs, in common time and with the origin subtracted |

pub mod feed;
pub mod project;

// Modules of the crates below, under the names that they have in `boresight`.
use boresight_cloud::{comparison, error, geometry, statistics};
use boresight_estimation::{calibration, joint, trajectory};
use boresight_format::{format, sensor};
use boresight_report::{report, verdict};
