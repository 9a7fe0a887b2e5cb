//! Sentences that are not used, counted by reason.

use std::fmt;

use crate::format::left_out::LeftOut;

/// The reason of a position or heading that the receiver marks as invalid or leaves empty.
pub(super) const WITHOUT_FIX: &str = "without a fix";
/// The reason of a position without the separation of geoid and ellipsoid.
pub(super) const WITHOUT_SEPARATION: &str = "without a geoid separation";
/// The reason of a heading before the first time, or after another heading with the same time.
pub(super) const WITHOUT_TIME: &str = "headings without a time of their own";
/// The reason of a record with a date that the receiver showed before it knew the date.
pub(super) const UNDATED: &str = "dated before the receiver knew the date";

/// Numbers of the sentences of a log that were skipped.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Skipped {
    /// Sentences of other types, and lines that are not sentences.
    pub(super) other: u64,
    /// Sentences that could not be used. Sentences without a checksum in a log that has checksums are damaged.
    pub(super) lost: LeftOut,
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.other, self.lost.total()) {
            (0, 0) => write!(f, "no sentence that can be used"),
            (0, _) => write!(f, "sentences that cannot be used: {}", self.lost),
            (other, 0) => write!(f, "{other} sentences of other types"),
            (other, _) => write!(f, "{other} sentences of other types, {}", self.lost),
        }
    }
}
