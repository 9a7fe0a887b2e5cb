//! Stages of work as they are shown and timed.

use std::time::Instant;

use crate::error::Result;
use crate::progress::Progress;

/// Runs `work` as the stage `name` of `total` units; what it gives, and the seconds it took.
pub(super) fn stage<T>(
    progress: &dyn Progress,
    name: &str,
    total: u64,
    work: impl FnOnce() -> Result<T>,
) -> Result<(T, f64)> {
    let start = Instant::now();
    progress.begin(name, total);
    let done = work();
    progress.end();
    done.map(|done| (done, start.elapsed().as_secs_f64()))
}
