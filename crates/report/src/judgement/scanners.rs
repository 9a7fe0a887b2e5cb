//! Verdicts on the scanners themselves, from the joint adjustment: their clocks and their ranges.

use crate::joint::{Joint, LateScanner, RangeScore};
use crate::verdict::{Verdict, capitalised};

/// A zero point is wrong if the scans show it by more than this many standard deviations, and if a parameter of a mounting
/// is off by more than this many of its own: mountings absorb most of a zero point.
const RANGE_SIGMAS: f64 = 5.0;
const MOVED_SIGMAS: f64 = 2.0;

/// The verdict on a scanner whose clock is late according to the joint adjustment.
pub fn late(scanner: &LateScanner) -> Verdict {
    let text = capitalised(&scanner.describe()) + ".";
    let verdict = Verdict::care("scanner.time_offset", text);
    verdict.with_value(scanner.late.value, Some(scanner.late.sigma))
}

/// Verdicts on scanners that fit better with other ranges.
pub fn ranges(joint: &Joint) -> Vec<Verdict> {
    let scanners = joint.mountings.iter().zip(&joint.range_scores);
    let wrong = scanners.filter_map(|(mounting, score)| {
        let RangeScore {
            added,
            moved_sigmas,
        } = (*score)?;
        let text = format!(
            "The scans fit best with ranges of scanner {} that are {:.2} ± {:.2} mm {}: check its zero point. Neither \
             points nor mountings are corrected.",
            mounting.name,
            1e3 * added.value.abs(),
            1e3 * added.sigma,
            if added.value > 0.0 { "longer" } else { "shorter" },
        );
        let verdict = Verdict::care("scanner.range", text);
        let is_wrong = added.sigmas() > RANGE_SIGMAS && moved_sigmas > MOVED_SIGMAS;
        is_wrong.then(|| verdict.with_value(added.value, Some(added.sigma)))
    });
    wrong.collect()
}
