//! Points, voxel grids, neighbourhoods and their shape; M3C2 distances between clouds. This crate is a part of
//! [boresight](https://crates.io/crates/boresight), which re-exports all of it.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`error`] | the error type, with file, line and remedy |
//! | [`progress`] | progress of stages, cancellation |
//! | [`output`] | result files, written completely or not at all |
//! | [`statistics`] | median, quantiles, χ², F, Student's t, series in time |
//! | [`geometry`] | rotations, rigid transforms, Euler conventions, headings |
//! | [`cloud`] | points, voxel grid, nearest neighbours, structure tensor, omnivariance |
//! | [`comparison`] | M3C2 and its statistics |

pub mod cloud;
pub mod comparison;
pub mod error;
pub mod geometry;
pub mod output;
pub mod progress;
pub mod statistics;

pub use error::{Error, Problem, Result};
/// The linear algebra of the public interface.
pub use nalgebra;
