//! What a cloud file takes, in any format that is written.

use crate::error::Result;
use crate::format::las::extra::ExtraDimension;
use crate::geometry::Vec3;

/// What the times of a cloud count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum CloudClock {
    /// Seconds of the GPS week.
    GpsWeek,
    /// Adjusted standard GPS time: seconds since 1980-01-06, less 10⁹ (LAS 1.4, global encoding).
    AdjustedGps,
    /// Seconds since 1970-01-01 UTC, without leap seconds.
    Unix,
    /// Seconds of some clock.
    #[default]
    Unknown,
}

impl CloudClock {
    /// What times between `first_s` and `last_s` can be: Unix time after 2001, seconds of a week, or unknown.
    /// A clock that starts with the sensor cannot be told from that of a week.
    pub fn of_span(first_s: f64, last_s: f64) -> Self {
        const WEEK_S: f64 = 604_800.0;
        const UNIX_S: [f64; 2] = [1e9, 4.1e9];
        if first_s >= 0.0 && last_s <= WEEK_S {
            Self::GpsWeek
        } else if first_s >= UNIX_S[0] && last_s <= UNIX_S[1] {
            Self::Unix
        } else {
            Self::Unknown
        }
    }
}

/// What is known of a cloud before its first point is written.
#[derive(Debug, Clone, Default)]
pub struct CloudShape {
    /// Lowest coordinates (east, north, up), metres.
    pub low: Vec3,
    /// Highest coordinates, metres.
    pub high: Vec3,
    /// Whether points have times.
    pub has_time: bool,
    /// What their times count.
    pub clock: CloudClock,
    /// Whether points have intensities.
    pub has_intensity: bool,
    /// Further values of each point.
    pub dimensions: Vec<ExtraDimension>,
    /// The coordinate reference system as WKT, if it is known.
    pub wkt: Option<String>,
}

/// A point with its values.
#[derive(Debug, Clone, Copy)]
pub struct CloudPoint<'a> {
    /// East, north, up, metres.
    pub position: Vec3,
    /// Seconds; ignored where the shape has no times.
    pub time_s: f64,
    /// As recorded; ignored where the shape has no intensities.
    pub intensity: f32,
    /// Values of the dimensions, in their order; missing ones are NaN.
    pub values: &'a [f64],
}

/// An open cloud file. Dropped unfinished, it leaves an incomplete file behind: the caller stages it.
pub trait CloudSink {
    /// Appends a point.
    ///
    /// # Errors
    /// A point that the format cannot hold, a file that cannot be written.
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()>;

    /// Completes the file.
    ///
    /// # Errors
    /// The file cannot be written.
    fn finish(self: Box<Self>) -> Result<()>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_are_told_by_their_span() {
        let cases = [
            ((0.0, 300.0), CloudClock::GpsWeek),
            ((604_700.0, 604_900.0), CloudClock::Unknown),
            ((1.7e9, 1.7e9 + 300.0), CloudClock::Unix),
            ((-5.0, 10.0), CloudClock::Unknown),
            ((3.2e8, 3.3e8), CloudClock::Unknown),
        ];
        for ((first, last), clock) in cases {
            assert_eq!(CloudClock::of_span(first, last), clock, "{first}");
        }
    }
}
