//! Simulated drives of a robot with laser scanners over a field: sensor files and their truth. This crate is a part
//! of [boresight](https://crates.io/crates/boresight), which re-exports all of it.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`simulation`] | scene, drives and sensors with known truth; does not use the estimators |

pub mod simulation;

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{error, geometry, output, progress, statistics};
use boresight_format::{format, sensor};
