//! Stages of work, shown and timed.

use std::time::Instant;

use crate::error::Result;
use crate::progress::Progress;

/// Runs `work` as the stage `name` of `total` units; returns its result and the seconds it took.
pub(super) fn stage<T>(
    progress: &dyn Progress,
    name: &str,
    total: u64,
    work: impl FnOnce() -> Result<T>,
) -> Result<(T, f64)> {
    let start = Instant::now();
    let _stage = progress.stage(name, total);
    Ok((work()?, start.elapsed().as_secs_f64()))
}
