//! Verdicts on contradictions in the logs of a drive.

use super::trajectory::doubt;
use crate::trajectory::Doubt;
use crate::verdict::Verdict;

/// The verdict on raw logs without contradictions.
pub fn consistent() -> Verdict {
    Verdict::good(
        "logs.consistent",
        "Units, axes, signs and clocks of the logs do not contradict each other or the project.",
    )
}

/// The verdicts on the logs of a drive other than the main one, from contradictions in its raw logs and constants of its
/// project that it contradicts.
pub fn on_other(drive: &str, preflight: &[Verdict], doubts: &[Doubt]) -> Vec<Verdict> {
    let contradictions = preflight.iter().cloned().chain(doubts.iter().map(doubt));
    contradictions.map(|verdict| verdict.on(drive)).collect()
}
