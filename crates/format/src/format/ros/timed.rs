//! Points with what is known of their times.

use std::ops::AddAssign;

use crate::format::cloud::gathering::counted;
use crate::format::input::Input;
use crate::sensor::ScanPoint;

/// Numbers of points that are left out.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lost {
    /// Without finite coordinates.
    pub(super) unplaced: u64,
    /// With coordinates of zero.
    pub(super) at_scanner: u64,
    /// Without a time, or with one that is far from those of the other points of their cloud.
    pub(super) untimed: u64,
}

impl AddAssign for Lost {
    fn add_assign(&mut self, other: Self) {
        self.unplaced += other.unplaced;
        self.at_scanner += other.at_scanner;
        self.untimed += other.untimed;
    }
}

impl Lost {
    /// Remarks on them.
    pub(super) fn remark(&self, input: &Input, topic: &str) {
        let reasons = [
            (self.unplaced, "without finite coordinates"),
            (self.at_scanner, "at the origin of the scanner"),
            (
                self.untimed,
                "with a time that is no number or far from their cloud's",
            ),
        ];
        let lost = reasons.iter().filter(|(count, _)| *count > 0);
        let lost: Vec<String> = lost
            .map(|(count, why)| format!("{} {why}", counted(*count, "point")))
            .collect();
        if !lost.is_empty() {
            input.remark(format!(
                "of {topic} left out, as not measured: {}",
                lost.join(", ")
            ));
        }
    }
}

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
    /// Points that are not among them.
    pub(super) lost: Lost,
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
            lost: Lost::default(),
        }
    }

    /// Whether there are several points, all at one time.
    pub(super) fn has_one_time(&self) -> bool {
        let ends = self.points.first().zip(self.points.last());
        self.points.len() > 1 && ends.is_some_and(|(first, last)| first.time_s == last.time_s)
    }
}
