//! Tables, figures and pages of a calibration: a part of [boresight](https://crates.io/crates/boresight), which hands it on whole.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`report`] | tables, figures, the page |

pub mod report;

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{cloud, comparison, error, geometry, progress, statistics, stored};
use boresight_estimation::{calibration, drift, joint, trajectory, verdict};
use boresight_format::{format, sensor};
