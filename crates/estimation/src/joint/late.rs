//! Latencies of scanners, which are held unless the drive contradicts them: estimating one costs tx a third of its accuracy.

use super::adjust::{Outcome, holding};
use super::input::JointInput;
use super::result::Joint;
use super::score::Score;
use crate::error::Result;

/// Where a drive contradicts the lowest rung, the adjustment at that rung with the latencies of late scanners free, if
/// nothing contradicts it: otherwise mountings would move to make up for time stamps that are wrong. `None` if no scanner
/// is late, or that does not explain the drive. `at_lowest` adjusts at that rung.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn explained(
    input: &JointInput<'_>,
    mut at_lowest: impl FnMut(&JointInput<'_>) -> Result<Outcome>,
) -> Result<Option<Joint>> {
    let mut holds = |free: Vec<bool>| -> Result<Option<Joint>> {
        let mut freed = input.clone();
        freed.estimate_latency = free;
        holding(at_lowest(&freed))
    };
    let Some(all_free) = holds(vec![true; input.mountings.len()])? else {
        return Ok(None);
    };
    let is_free = |(latency, stated): (&Option<(f64, f64)>, &bool)| {
        *stated || latency.is_some_and(|(value, sigma)| Score { value, sigma }.is_late())
    };
    let latencies = all_free.late_s.iter().zip(&input.estimate_latency);
    let free: Vec<bool> = latencies.map(is_free).collect();
    if free == input.estimate_latency {
        return Ok(None);
    }
    Ok(Some(holds(free)?.unwrap_or(all_free)))
}
