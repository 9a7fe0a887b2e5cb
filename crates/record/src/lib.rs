//! Sensors recorded while driving: total stations, streams, live pose, replay: a part of [boresight](https://crates.io/crates/boresight), which hands it on whole.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`record`] | sensors while driving: total stations by GeoCOM, and what sends by itself; live pose, playing again |

pub mod record;

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{error, geometry};
use boresight_estimation::trajectory;
use boresight_format::{format, sensor};
use boresight_project::{feed, project};
