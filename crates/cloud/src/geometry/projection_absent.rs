//! Replaces projected coordinate reference systems in a program that is built without them.

use std::convert::Infallible;

use super::grid::{GridPoint, Misfit};
use crate::error::{Error, Result};

/// A projected coordinate reference system; no value of this type exists.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection(Infallible);

impl Projection {
    /// Refuses every system.
    ///
    /// # Errors
    /// Always.
    pub fn new(name: &str) -> Result<Self> {
        Err(Error::data(
            format!("the coordinate reference system {name} cannot be used in this program"),
            "build it with the feature `projections`, or give projected coordinates",
        ))
    }

    /// The name of the system.
    pub fn name(&self) -> &str {
        match self.0 {}
    }

    /// A position in the system.
    ///
    /// # Errors
    /// None.
    pub fn project(&self, _latitude_rad: f64, _longitude_rad: f64) -> Result<GridPoint> {
        match self.0 {}
    }

    /// As [`Self::project`], for readers that add file and line to the error.
    ///
    /// # Errors
    /// None.
    pub fn try_project(&self, _: f64, _: f64) -> std::result::Result<GridPoint, Misfit> {
        match self.0 {}
    }

    /// Latitude and longitude, radians.
    ///
    /// # Errors
    /// None.
    pub fn unproject(&self, _east_m: f64, _north_m: f64) -> Result<(f64, f64)> {
        match self.0 {}
    }
}
