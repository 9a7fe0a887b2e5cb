//! Positions in projected coordinate reference systems.

use super::{Rotation, Vec3};
use crate::error::Error;

/// A position in a projected system, with the convergence and the scale there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridPoint {
    /// Metres.
    pub east_m: f64,
    /// Metres.
    pub north_m: f64,
    /// Meridian convergence: grid azimuth = true azimuth − this, clockwise, radians.
    pub convergence_rad: f64,
    /// Distance between coordinates over true distance on the ellipsoid.
    pub scale: f64,
}

impl GridPoint {
    /// The rotation from true east, north, up to those of the grid.
    pub fn grid_from_true(&self) -> Rotation {
        Rotation::from_axis_angle(&Vec3::z_axis(), self.convergence_rad)
    }
}

/// A position that a system cannot hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Misfit {
    /// Its latitude and longitude, and why the system cannot hold it.
    pub found: String,
    /// The positions that the system can hold, or the system to choose instead.
    pub expected: String,
}

impl From<Misfit> for Error {
    fn from(misfit: Misfit) -> Self {
        Self::data(misfit.found, format!("use {}", misfit.expected))
    }
}
