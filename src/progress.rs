//! How long-running stages say what they are doing, without printing.

/// Receives what a stage reports. The command line draws bars, tests stay silent.
pub trait Progress: Sync {
    /// A stage begins; `total` counts its units of work (0 where unknown).
    fn begin(&self, stage: &str, total: u64);
    /// `units` more of the running stage are done.
    fn advance(&self, units: u64);
    /// The running stage is over.
    fn end(&self);
    /// One line worth keeping: what was decided or found.
    fn say(&self, message: &str);
    /// One line the user should act on.
    fn warn(&self, message: &str);
}

/// Reports nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &str, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
    fn say(&self, _message: &str) {}
    fn warn(&self, _message: &str) {}
}
