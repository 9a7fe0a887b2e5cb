//! Limits beyond which a number is no coordinate or time in the unit for which it is taken.

use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;

/// No coordinate is larger, metres: it is beyond the Moon.
pub const MOST_COORDINATE_M: f64 = 1e9;
/// No time is later, seconds: of 1970, it is in the year 5138; milliseconds of this century are larger.
pub const MOST_TIME_S: f64 = 1e11;

/// Checks that a point, counted from 0, has coordinates in metres and a time in seconds; NaN stands for no time.
///
/// # Errors
/// A coordinate or a time beyond the limits.
pub(crate) fn check_reach(path: &Path, index: u64, point: &Vec3, time_s: f64) -> Result<()> {
    let far = point.iter().find(|v| v.abs() > MOST_COORDINATE_M);
    let (found, expected) = match (far, time_s.abs() > MOST_TIME_S) {
        (None, false) => return Ok(()),
        (Some(coordinate), _) => (
            format!("the coordinate {coordinate:e} at point {index}"),
            format!(
                "metres, at most {MOST_COORDINATE_M:e}: is the column a time in nanoseconds, or a number?"
            ),
        ),
        (None, true) => (
            format!("the time {time_s:e} at point {index}"),
            format!("seconds, at most {MOST_TIME_S:e}: are these milliseconds or nanoseconds?"),
        ),
    };
    Err(Error::format(path, Location::Whole, found, expected))
}
