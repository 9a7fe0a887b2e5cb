//! Calibrates laser profile scanners on a moving platform and proves how good the calibration is.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | room for |
//! |---|---|
//! | [`geometry`] | rotations, rigid transforms, Euler conventions, headings |
//! | [`sensor`] | what each sensor measured, validated |
//! | [`cloud`] | points, voxel grid, nearest neighbours, structure tensor, omnivariance |
//! | [`mod@format`] | one file per file format, in and out; detection |
//! | [`project`] | `project.toml`: as written, then checked |
//! | [`adjustment`] | least squares on a chain with border: normal equations, covariances, losses |
//! | [`trajectory`] | states, factors, graph, smoother, interpolation |
//! | [`georeference`] | x_m = t_mb + R_mb (t_bs + R_bs x_s) |
//! | [`calibration`] | parameters, cost, adjustment, scales, observability, uncertainty |
//! | [`comparison`] | M3C2 and its statistics |
//! | [`simulation`] | scene, drives, sensors: the twin with known truth |
//! | [`report`] | tables, figures, the page |
//! | [`pipeline`] | the stages in order |
//! | [`cli`] | one file per command |
//!
//! The method is that of Esser, Tombrink, Cornelißen, Klingbeil and Kuhlmann,
//! *System Calibration of a Field Phenotyping Robot with Multiple High-Precision Profile Laser
//! Scanners* (arXiv 2403.17788).

pub mod adjustment;
pub mod calibration;
#[cfg(feature = "cli")]
pub mod cli;
pub mod cloud;
pub mod comparison;
pub mod error;
pub mod format;
pub mod geometry;
pub mod georeference;
pub mod output;
pub mod pipeline;
pub mod progress;
pub mod project;
pub mod report;
pub mod sensor;
pub mod simulation;
pub mod statistics;
pub mod trajectory;

pub use error::{Error, Result};
/// The linear algebra of the public interface.
pub use nalgebra;
