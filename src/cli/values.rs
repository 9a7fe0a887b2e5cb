//! Parsers of argument values.

use std::time::Duration;

use crate::geometry::Vec3;

/// A number above 0.
pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    number(text)
        .filter(|x| *x > 0.0)
        .ok_or_else(|| "expected a number above 0".to_owned())
}

/// Metres above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text)
        .filter(|x| *x > 0.0)
        .ok_or_else(|| "expected metres above 0".to_owned())
}

/// Any finite number.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    number(text).ok_or_else(|| "expected a number".to_owned())
}

/// Metres, 0 or more.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    number(text)
        .filter(|x| *x >= 0.0)
        .ok_or_else(|| "expected metres, 0 or more".to_owned())
}

/// Seconds, 0 or more.
pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    Duration::try_from_secs_f64(seconds).map_err(|_| "not a number of seconds".to_owned())
}

/// Seconds above 0.
pub(super) fn positive_seconds(text: &str) -> Result<Duration, String> {
    let duration = seconds(text.trim())
        .ok()
        .filter(|duration| !duration.is_zero());
    duration.ok_or_else(|| "expected seconds above 0".to_owned())
}

/// `vertical`, or east,north,up.
pub(super) fn direction(text: &str) -> Result<Vec3, String> {
    if text.trim() == "vertical" {
        return Ok(Vec3::z());
    }
    let components: Option<Vec<f64>> = text.split(',').map(number).collect();
    match components.as_deref() {
        Some([east, north, up]) if [east, north, up].iter().any(|x| **x != 0.0) => {
            Ok(Vec3::new(*east, *north, *up))
        }
        _ => Err("expected `vertical` or three numbers that are not all 0: east,north,up".into()),
    }
}

/// East,north,up in metres.
pub(super) fn place(text: &str) -> Result<Vec3, String> {
    let components: Option<Vec<f64>> = text.split(',').map(number).collect();
    match components.as_deref() {
        Some([east, north, up]) => Ok(Vec3::new(*east, *north, *up)),
        _ => Err("expected three numbers: east,north,up".to_owned()),
    }
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite())
}
