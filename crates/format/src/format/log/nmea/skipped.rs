//! Sentences that are not used, counted by reason.

/// Numbers of the sentences of a log that were skipped, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NmeaSkipped {
    /// Sentences of other types, and lines that are not sentences.
    pub other: u64,
    /// Sentences with a wrong checksum.
    pub wrong_checksum: u64,
    /// Sentences that are cut off or have unreadable fields, and sentences without a checksum in a
    /// log that has checksums.
    pub damaged: u64,
    /// Positions and headings that the receiver marks as invalid or leaves empty.
    pub without_fix: u64,
    /// Headings from carrier phases whose ambiguities are not fixed.
    pub not_fixed: u64,
    /// Positions without the separation of geoid and ellipsoid.
    pub without_separation: u64,
    /// Headings before the first time, or after another heading with the same time.
    pub without_time: u64,
    /// Records with a date that the receiver showed before it knew the date.
    pub undated: u64,
}

impl NmeaSkipped {
    /// The numbers above 0 with their reasons, without sentences of other types; `None` if there are none.
    pub(super) fn losses(&self) -> Option<String> {
        let losses = [
            (self.wrong_checksum, "with a wrong checksum"),
            (self.damaged, "damaged"),
            (self.without_fix, "without a fix"),
            (self.not_fixed, "headings without fixed ambiguities"),
            (self.without_separation, "without a geoid separation"),
            (self.without_time, "headings without a time of their own"),
            (self.undated, "dated before the receiver knew the date"),
        ];
        let losses = losses.iter().filter(|(count, _)| *count > 0);
        let losses: Vec<String> = losses.map(|(n, why)| format!("{n} {why}")).collect();
        (!losses.is_empty()).then(|| losses.join(", "))
    }
}

impl std::fmt::Display for NmeaSkipped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} sentences of other types", self.other)?;
        match self.losses() {
            Some(losses) => write!(f, ", {losses}"),
            None => Ok(()),
        }
    }
}
