//! Progress reports and cancellation of long-running work, without printing.

use std::sync::atomic::{AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Calls a function with the number of a cloud and the coordinates of a point in the world, metres, for every
/// point of all clouds.
pub type EachPoint<'a> = dyn Fn(&mut dyn FnMut(usize, [f64; 3])) + 'a;

/// Receives progress reports and may cancel the work. The command line draws bars; tests stay
/// silent.
///
/// Work opens its stages with `stage`, which also closes them, and calls `check` to learn whether
/// to go on.
pub trait Progress: Sync {
    /// Begins a stage nested in the current one; `total` is its number of work units (0 if
    /// unknown).
    fn begin(&self, stage: &str, total: u64);
    /// Reports `units` more of the innermost stage as done.
    fn advance(&self, units: u64);
    /// Ends the innermost stage.
    fn end(&self);
    /// Passes on one line worth keeping: a decision or a result.
    fn say(&self, message: &str);
    /// Passes on one line that the user should act on.
    fn warn(&self, message: &str);
    /// As [`Self::warn`], for a line that is also a verdict among the results: lists of warnings leave it out.
    fn verdict(&self, text: &str) {
        self.warn(text);
    }
    /// Offers the named clouds as they lie at this moment of the work. `points` takes time: implementations
    /// that do not show the clouds do not call it.
    fn clouds(&self, _moment: &str, _names: &[&str], _points: &EachPoint<'_>) {}
    /// Whether the work should stop. Called often and from any thread; once true, it must stay
    /// true.
    fn is_cancelled(&self) -> bool {
        false
    }
}

impl dyn Progress + '_ {
    /// Begins a stage of `total` work units (0 if unknown); it ends when the returned value is
    /// dropped.
    pub fn stage(&self, name: &str, total: u64) -> Stage<'_> {
        self.begin(name, total);
        Stage { progress: self }
    }

    /// Checks whether the work should go on.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the work should stop.
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() {
            Err(Error::Cancelled)
        } else {
            Ok(())
        }
    }
}

/// A running stage, which ends when this is dropped.
#[must_use = "the stage ends when this is dropped"]
pub struct Stage<'a> {
    progress: &'a dyn Progress,
}

impl Stage<'_> {
    /// Reports `units` more of the stage as done.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the work should stop.
    pub fn advance(&self, units: u64) -> Result<()> {
        self.progress.advance(units);
        self.progress.check()
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        self.progress.end();
    }
}

/// Progress of an iteration that ends when it has converged: its steps become units of a stage.
///
/// The expected number of steps covers the share [`Steps::EXPECTED`] of the units. Further steps cover less and less of
/// the remaining units, so that the stage keeps advancing but reaches its end only when the iteration does.
pub struct Steps<'a> {
    progress: &'a dyn Progress,
    expected: u64,
    units: u64,
    steps_done: AtomicU64,
    units_reported: AtomicU64,
}

impl<'a> Steps<'a> {
    /// Share of the units that the expected number of steps covers.
    pub const EXPECTED: f64 = 0.8;

    /// Steps, usually `expected` of them, that cover `units` of the innermost stage of `progress`.
    pub fn new(progress: &'a dyn Progress, expected: u64, units: u64) -> Self {
        Self {
            progress,
            expected: expected.max(1),
            units,
            steps_done: AtomicU64::new(0),
            units_reported: AtomicU64::new(0),
        }
    }

    /// Reports all remaining units as done.
    pub fn finish(self) {
        self.progress
            .advance(self.units.saturating_sub(self.units_reported.into_inner()));
    }

    /// Share of the units covered by this number of steps.
    fn share(&self, steps_done: u64) -> f64 {
        let ratio = steps_done as f64 / self.expected as f64;
        if ratio <= 1.0 {
            return Self::EXPECTED * ratio;
        }
        let left = 1.0 - Self::EXPECTED;
        // An iteration that has taken several times as many is likely to take many more.
        1.0 - left / ratio.sqrt()
    }
}

impl Progress for Steps<'_> {
    fn begin(&self, stage: &str, total: u64) {
        self.progress.begin(stage, total);
    }

    fn advance(&self, steps: u64) {
        let steps_done = self.steps_done.fetch_add(steps, Ordering::Relaxed) + steps;
        let units = (self.share(steps_done) * self.units as f64).round() as u64;
        let before = self.units_reported.fetch_max(units, Ordering::Relaxed);
        self.progress.advance(units.saturating_sub(before));
    }

    fn end(&self) {
        self.progress.end();
    }

    fn say(&self, message: &str) {
        self.progress.say(message);
    }

    fn warn(&self, message: &str) {
        self.progress.warn(message);
    }

    fn verdict(&self, text: &str) {
        self.progress.verdict(text);
    }

    fn clouds(&self, moment: &str, names: &[&str], points: &EachPoint<'_>) {
        self.progress.clouds(moment, names, points);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

/// The run time of one stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageSeconds {
    /// Name, for example "trajectory".
    pub name: String,
    /// Seconds.
    pub seconds: f64,
}

/// Reports nothing and never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &str, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
    fn say(&self, _message: &str) {}
    fn warn(&self, _message: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Counter(AtomicU64);

    impl Progress for Counter {
        fn begin(&self, _stage: &str, _total: u64) {}
        fn advance(&self, units: u64) {
            self.0.fetch_add(units, Ordering::Relaxed);
        }
        fn end(&self) {}
        fn say(&self, _message: &str) {}
        fn warn(&self, _message: &str) {}
    }

    #[test]
    fn steps_approach_their_units_and_never_exceed_them() {
        for count in [0, 3, 10, 500] {
            let counter = Counter::default();
            let steps = Steps::new(&counter, 10, 1000);
            let mut before = 0;
            for step in 1..=count {
                steps.advance(1);
                let now = counter.0.load(Ordering::Relaxed);
                assert!(now >= before && now <= 1000, "{now} after {step}");
                if step <= 10 {
                    assert_eq!(now, 80 * step, "after {step}");
                }
                before = now;
            }
            steps.finish();
            assert_eq!(counter.0.into_inner(), 1000, "{count} steps");
        }
    }
}
