//! Points with what is known of their times.

use crate::sensor::ScanPoint;

/// The points of a cloud with what is known of their times.
pub(super) struct TimedPoints {
    /// In time order.
    pub(super) points: Vec<ScanPoint>,
    /// Number of times before the stamp that were written as numbers without a sign.
    pub(super) wrapped: usize,
    /// From the first to the last point, seconds, if the times were taken for nanoseconds.
    pub(super) lasts_s: Option<f64>,
    /// Whether all points of a cloud have one time.
    pub(super) are_alike: bool,
}

impl TimedPoints {
    /// Points in time order, of whose times nothing is to be said.
    pub(super) fn of(points: Vec<ScanPoint>) -> Self {
        let ends = points.first().zip(points.last());
        Self {
            lasts_s: ends.map(|(first, last)| last.time_s - first.time_s),
            points,
            wrapped: 0,
            are_alike: false,
        }
    }

    /// Whether there are several points, all at one time.
    pub(super) fn has_one_time(&self) -> bool {
        let ends = self.points.first().zip(self.points.last());
        self.points.len() > 1 && ends.is_some_and(|(first, last)| first.time_s == last.time_s)
    }
}
