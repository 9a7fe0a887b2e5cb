//! Trajectories from IMU, positions and headings; mountings of laser scanners; both in one adjustment: a part of [boresight](https://crates.io/crates/boresight), which hands it on whole.
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`adjustment`] | least squares on a chain with border: normal equations, covariances, losses |
//! | [`trajectory`] | states, factors, graph, batch and online smoother, diagnostics, interpolation |
//! | [`trajectory_error`] | absolute and relative errors of a trajectory against a reference |
//! | [`georeference`] | x_m = t_mb + R_mb (t_bs + R_bs x_s) |
//! | [`surface`] | neighbourhoods and their planes, derivatives by pose and by mounting |
//! | [`calibration`] | parameters, cost, adjustment, scales, observability, uncertainty |
//! | [`preflight`] | mistakes that raw logs and the first placement of the scans show |
//! | [`joint`] | one adjustment of trajectory and mountings: surfels, scan factors, tests of the model |
//! | [`drift`] | drift watch: one scanner against the other from the field's overlap, control chart |

pub mod adjustment;
pub mod calibration;
pub mod drift;
pub mod georeference;
pub mod joint;
pub mod preflight;
pub mod surface;
pub mod trajectory;
pub mod trajectory_error;

// The modules of earlier crates, under the names that they have in `boresight`.
use boresight_cloud::{cloud, error, geometry, progress, statistics};
use boresight_format::{format, sensor};
