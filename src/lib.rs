//! Calibrates laser profile scanners on a moving platform and proves how good the calibration is.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | room for |
//! |---|---|
//! | [`error`] | the one error type, with file, line and remedy |
//! | [`progress`] | stages as they run, and how they are told to stop |
//! | [`output`] | results that appear whole or not at all |
//! | [`geometry`] | rotations, rigid transforms, Euler conventions, headings |
//! | [`statistics`] | median, quantiles, χ², Student's t |
//! | [`sensor`] | what each sensor measured, validated |
//! | [`cloud`] | points, voxel grid, nearest neighbours, structure tensor, omnivariance |
//! | [`mod@format`] | one file per file format, in and out; detection |
//! | [`trajectory`] | preintegration, factors, the chain's solver, batch and online smoother, diagnostics, interpolation |
//! | [`georeference`] | x_m = t_mb + R_mb (t_bs + R_bs x_s) |
//! | [`surface`] | neighbourhoods and their planes, derivatives by pose and by mounting |
//! | [`calibration`] | parameters, cost, adjustment, scales, observability, uncertainty |
//! | [`comparison`] | M3C2 and its statistics |
//! | [`tiles`] | clouds larger than memory, from file to file: features, M3C2, thinning |
//! | [`simulation`] | scene, drives, sensors: the twin with known truth, which knows no estimator |
//! | [`report`] | tables, figures, the page |
//! | [`project`] | `project.toml`: as written, then checked |
//! | [`pipeline`] | the stages in order |
//! | [`cli`] | one file per command |
//!
//! The method is that of Esser, Tombrink, Cornelißen, Klingbeil and Kuhlmann,
//! *System Calibration of a Field Phenotyping Robot with Multiple High-Precision Profile Laser
//! Scanners* (arXiv 2403.17788).

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
pub mod surface;
pub mod tiles;
pub mod trajectory;

pub use error::{Error, Result};
/// The linear algebra of the public interface.
pub use nalgebra;
