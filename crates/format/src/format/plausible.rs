//! Times and coordinates that no sensor can have: signs of another unit or of other columns.

use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;

/// No clock of a sensor shows more seconds: 1e11 s after 1970 is the year 5138.
pub const MOST_TIME_S: f64 = 1e11;
/// No place on Earth has larger coordinates in any system in metres, false eastings of zones included.
pub const MOST_COORDINATE_M: f64 = 1e9;
/// Dates since 1973, for times since 1970.
const EARLIEST_DATE_S: f64 = 1e8;

/// The unit of a time, seconds: 1 unless it is too large for seconds and a date in another unit.
pub(crate) fn unit_of_date(time: f64) -> f64 {
    if time.abs() <= MOST_TIME_S {
        return 1.0;
    }
    let is_date = |unit: &f64| (EARLIEST_DATE_S..MOST_TIME_S).contains(&(time.abs() * unit));
    [1e-3, 1e-6, 1e-9].into_iter().find(is_date).unwrap_or(1.0)
}

/// Checks the time of a record; NaN stands for none.
///
/// # Errors
/// It is too large for seconds.
pub(crate) fn check_time(path: &Path, time_s: f64) -> Result<()> {
    time_fits(path, time_s, None)
}

/// Checks the coordinates of a record.
///
/// # Errors
/// One is too large for metres.
pub(crate) fn check_place(path: &Path, place_m: &Vec3) -> Result<()> {
    place_fits(path, place_m, None)
}

/// Checks coordinates and time of a point, counted from 0; NaN stands for no time.
///
/// # Errors
/// A coordinate or the time is too large.
pub(crate) fn check_point(path: &Path, index: u64, point: &Vec3, time_s: f64) -> Result<()> {
    place_fits(path, point, Some(index))?;
    time_fits(path, time_s, Some(index))
}

fn time_fits(path: &Path, time_s: f64, point: Option<u64>) -> Result<()> {
    if time_s.is_nan() || time_s.abs() <= MOST_TIME_S {
        return Ok(());
    }
    let unit = match unit_of_date(time_s) {
        1e-3 => ": milliseconds?",
        1e-6 => ": microseconds?",
        1e-9 => ": nanoseconds?",
        _ => "",
    };
    Err(Error::format(
        path,
        Location::Whole,
        format!("{}a time of {time_s:e} s{unit}", with(point)),
        "times in seconds, below 1e11; in a table, a time column named for its unit (`time_ns`)",
    ))
}

fn place_fits(path: &Path, place_m: &Vec3, point: Option<u64>) -> Result<()> {
    let Some(coordinate) = place_m.iter().find(|v| v.abs() > MOST_COORDINATE_M) else {
        return Ok(());
    };
    Err(Error::format(
        path,
        Location::Whole,
        format!("{}a coordinate of {coordinate:e} m", with(point)),
        "coordinates in metres, below 1e9: is the first column a time?",
    ))
}

fn with(point: Option<u64>) -> String {
    point.map_or(String::new(), |index| format!("point {index} with "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_follow_from_the_size_of_a_date() {
        for (time, unit_s) in [
            (1.7e9, 1.0),
            (1.7e12, 1e-3),
            (1.7e15, 1e-6),
            (1.7e18, 1e-9),
            (86_400.0, 1.0),
            (1e25, 1.0),
        ] {
            assert_eq!(unit_of_date(time), unit_s);
        }
        let path = Path::new("a.csv");
        assert!(check_time(path, 1.7e9).is_ok());
        let error = check_time(path, 1.7e18).unwrap_err().to_string();
        assert!(error.contains("1.7e18 s: nanoseconds?"), "{error}");
        assert!(check_place(path, &Vec3::new(1e7, -2e7, 0.0)).is_ok());
        assert!(check_place(path, &Vec3::new(0.0, -1.7e18, 0.0)).is_err());
    }
}
