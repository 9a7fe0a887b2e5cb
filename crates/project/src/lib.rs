//! The file `project.toml`: parsed and validated: a part of [boresight](https://crates.io/crates/boresight), which hands it on whole.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`project`] | `project.toml`: parsing and validation |

pub mod project;

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{comparison, error, geometry};
use boresight_estimation::{calibration, joint, trajectory, verdict};
use boresight_format::{format, sensor};
use boresight_report::report;
