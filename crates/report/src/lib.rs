//! Tables, figures and pages of a calibration: a part of [boresight](https://crates.io/crates/boresight), which
//! re-exports all of it.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`verdict`] | statements about results, with severity and code |
//! | [`results`] | results of the stages, before they are judged or shown |
//! | [`number`] | values as text: significant digits, lengths with their unit |
//! | [`diagnostics`] | numbers on an adjusted trajectory: sigmas of poses, residuals, rejections |
//! | [`judgement`] | results turned into verdicts, each once |
//! | [`report`] | tables, figures, the page |

pub mod diagnostics;
pub mod judgement;
pub mod number;
pub mod report;
pub mod results;
pub mod verdict;

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{cloud, comparison, error, geometry, progress, statistics};
use boresight_estimation::{calibration, drift, joint, preflight, trajectory};
use boresight_format::{format, sensor};
