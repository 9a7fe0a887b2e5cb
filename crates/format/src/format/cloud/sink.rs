//! Interface of the cloud writers, the same for all formats.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::las::extra::ExtraDimension;
use crate::format::las::value::ExtraValue;
use crate::geometry::Vec3;

/// Step of the coordinates in written clouds, metres: it preserves 0.01 mm, and 32 bits reach 21 km
/// to each side of the offset.
pub const CLOUD_STEP_M: f64 = 1e-5;

/// The time scale of a cloud.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum CloudClock {
    /// Seconds of the GPS week.
    GpsWeek,
    /// Adjusted standard GPS time: seconds since 1980-01-06, less 10⁹ (LAS 1.4, global encoding).
    AdjustedGps,
    /// Seconds since 1970-01-01 UTC, without leap seconds.
    Unix,
    /// Seconds of an unknown clock.
    #[default]
    Unknown,
}

impl CloudClock {
    /// The likely time scale of times between `first_s` and `last_s`: seconds of a week, adjusted standard GPS time of
    /// the years 2011 to 2042, Unix time of the years 2001 to 2099, or unknown. Seconds since the start of the sensor
    /// cannot be distinguished from seconds of the week, nor seconds since 1980 from seconds since 1970.
    pub fn of_span(first_s: f64, last_s: f64) -> Self {
        const WEEK_S: f64 = 604_800.0;
        const UNIX_S: [f64; 2] = [1e9, 4.1e9];
        if first_s >= 0.0 && last_s <= WEEK_S {
            Self::GpsWeek
        } else if first_s > WEEK_S && last_s < UNIX_S[0] {
            Self::AdjustedGps
        } else if first_s >= UNIX_S[0] && last_s <= UNIX_S[1] {
            Self::Unix
        } else {
            Self::Unknown
        }
    }
}

/// The grid on which the coordinates of a LAS file lie: whole steps from an offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudGrid {
    /// Metres.
    pub offset_m: Vec3,
    /// Metres, the same for all axes.
    pub step_m: f64,
}

/// Properties of a cloud that must be known before its first point is written.
#[derive(Debug, Clone, Default)]
pub struct CloudShape {
    /// Lowest coordinates (east, north, up), metres.
    pub low: Vec3,
    /// Highest coordinates, metres.
    pub high: Vec3,
    /// The median of the coordinates if they are too far apart for LAS, metres.
    pub median: Option<Vec3>,
    /// The grid of the coordinates if they come from LAS; LAS, LAZ and COPC are written on the same grid.
    pub grid: Option<CloudGrid>,
    /// Whether points have times.
    pub has_time: bool,
    /// Time scale of the times.
    pub clock: CloudClock,
    /// Whether points have intensities.
    pub has_intensity: bool,
    /// Further values of each point.
    pub dimensions: Vec<ExtraDimension>,
    /// The coordinate reference system as WKT, if it is known.
    pub wkt: Option<String>,
}

impl CloudShape {
    /// The shape of a cloud in memory, without dimensions.
    pub fn of(cloud: &PointCloud, wkt: Option<String>) -> Self {
        let first = cloud.points.first().copied().unwrap_or_default();
        let times = cloud.time_s.iter().copied();
        let low = cloud.points.iter().fold(first, |low, p| low.inf(p));
        let high = cloud.points.iter().fold(first, |high, p| high.sup(p));
        Self {
            low,
            high,
            median: ((high - low).amax() > REACH_M).then(|| median(&cloud.points)),
            grid: None,
            has_time: !cloud.time_s.is_empty(),
            // Both are the other number if one is NaN.
            clock: CloudClock::of_span(
                times.clone().fold(f64::INFINITY, f64::min),
                times.fold(f64::NEG_INFINITY, f64::max),
            ),
            has_intensity: !cloud.intensity.is_empty(),
            dimensions: Vec::new(),
            wkt,
        }
    }
}

/// Length that 32 bits span with the step of written clouds, less a metre by which the offset may be rounded, metres.
const REACH_M: f64 = CLOUD_STEP_M * u32::MAX as f64 - 1.0;

/// The median of each coordinate.
fn median(points: &[Vec3]) -> Vec3 {
    Vec3::from_fn(|axis, _| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    })
}

/// A point with its values.
#[derive(Debug, Clone, Copy)]
pub struct CloudPoint<'a> {
    /// East, north, up, metres.
    pub position: Vec3,
    /// Seconds; ignored if the shape has no times.
    pub time_s: f64,
    /// As recorded; ignored if the shape has no intensities.
    pub intensity: f32,
    /// Values of the dimensions, in their order; missing values are none.
    pub values: &'a [ExtraValue],
}

/// An open cloud file. If it is dropped unfinished, the file stays incomplete: the caller must write to a temporary
/// name first.
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
    fn clocks_follow_from_the_span() {
        let cases = [
            ((0.0, 300.0), CloudClock::GpsWeek),
            ((604_700.0, 604_900.0), CloudClock::Unknown),
            ((1.7e9, 1.7e9 + 300.0), CloudClock::Unix),
            ((-5.0, 10.0), CloudClock::Unknown),
            ((3.2e8, 3.3e8), CloudClock::AdjustedGps),
            ((1.4e9, 1.4e9 + 300.0), CloudClock::Unix),
            ((9.9e8, 1.01e9), CloudClock::Unknown),
        ];
        for ((first, last), clock) in cases {
            assert_eq!(CloudClock::of_span(first, last), clock, "{first}");
        }
    }
}
