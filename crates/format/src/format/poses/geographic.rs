//! Poses with latitudes and longitudes.

use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::sensor::PoseRecord;

/// The error of poses with latitudes and longitudes where no projection is known, with the remedy.
pub(crate) fn refuse(input: &Input) -> Result<Vec<PoseRecord>> {
    Err(Error::data(
        format!(
            "{}: the poses have latitudes, longitudes and headings from true north, not a local frame",
            input.path().display()
        ),
        "name the projected system as `crs` in [frame] of the project",
    ))
}
