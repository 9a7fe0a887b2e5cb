//! How long-running work says what it is doing, without printing, and how it is told to stop.

use crate::error::{Error, Result};

/// Receives what the work reports, and may tell it to stop. The command line draws bars, tests stay
/// silent.
///
/// Work begins its stages with `stage`, which ends them too, and asks with `check` whether to go on.
pub trait Progress: Sync {
    /// A stage begins, within those that run; `total` counts its units of work (0 where unknown).
    fn begin(&self, stage: &str, total: u64);
    /// `units` more of the innermost stage are done.
    fn advance(&self, units: u64);
    /// The innermost stage is over.
    fn end(&self);
    /// One line worth keeping: what was decided or found.
    fn say(&self, message: &str);
    /// One line the user should act on.
    fn warn(&self, message: &str);
    /// Whether the work is to stop. Asked often and from any thread; once true, it must stay true.
    fn is_cancelled(&self) -> bool {
        false
    }
}

impl dyn Progress + '_ {
    /// Begins a stage of `total` units of work (0 where unknown), which ends with what is returned.
    pub fn stage(&self, name: &str, total: u64) -> Stage<'_> {
        self.begin(name, total);
        Stage { progress: self }
    }

    /// Asks whether to go on.
    ///
    /// # Errors
    /// [`Error::Cancelled`] where the work is to stop.
    pub fn check(&self) -> Result<()> {
        match self.is_cancelled() {
            true => Err(Error::Cancelled),
            false => Ok(()),
        }
    }
}

/// A stage that runs until this is dropped, however it is left.
#[must_use = "the stage ends where this is dropped"]
pub struct Stage<'a> {
    progress: &'a dyn Progress,
}

impl Stage<'_> {
    /// `units` more of the stage are done.
    ///
    /// # Errors
    /// [`Error::Cancelled`] where the work is to stop.
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

/// Run time of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct StageSeconds {
    /// Name, for example "trajectory".
    pub name: String,
    /// Seconds.
    pub seconds: f64,
}

/// Reports nothing, and never stops.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &str, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
    fn say(&self, _message: &str) {}
    fn warn(&self, _message: &str) {}
}
