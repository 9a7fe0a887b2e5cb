//! Progress reports and cancellation of long-running work, without printing.

use crate::error::{Error, Result};

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
        match self.is_cancelled() {
            true => Err(Error::Cancelled),
            false => Ok(()),
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

/// The run time of one stage.
#[derive(Debug, Clone, PartialEq)]
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
