//! The stages in order.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::project::{ComparisonSettings, Project};

/// Where results go and what chance starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The folder of the results; created where it is missing.
    pub out: PathBuf,
    /// Seed of every random draw.
    pub seed: u64,
}

/// What a command found.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result as one document, as in `result.json`.
    pub result: serde_json::Value,
    /// The same for people: a few lines with units.
    pub summary: String,
    /// What was written, most important first.
    pub files: Vec<PathBuf>,
}

fn not_wired() -> Result<Outcome> {
    Err(Error::data("not wired yet", "wait for the pipeline"))
}

/// Simulates the paper's drives, runs everything on them and writes the report.
///
/// # Errors
/// Whatever a stage refuses.
pub fn demo(_options: &Options, _progress: &dyn Progress) -> Result<Outcome> {
    not_wired()
}

/// Writes the drives of `scenario` (a name or a file) as sensor files, with the truth beside them.
///
/// # Errors
/// A scenario that cannot be read, a folder that cannot be written.
pub fn simulate(_scenario: &str, _options: &Options, _progress: &dyn Progress) -> Result<Outcome> {
    not_wired()
}

/// Logs to trajectory.
///
/// # Errors
/// Whatever the stage refuses.
pub fn trajectory(
    _project: &Project,
    _options: &Options,
    _progress: &dyn Progress,
) -> Result<Outcome> {
    not_wired()
}

/// Trajectory and profiles to mountings.
///
/// # Errors
/// Whatever a stage refuses.
pub fn calibrate(
    _project: &Project,
    _options: &Options,
    _progress: &dyn Progress,
) -> Result<Outcome> {
    not_wired()
}

/// Trajectory, profiles and mountings to clouds.
///
/// # Errors
/// Whatever a stage refuses.
pub fn georeference(
    _project: &Project,
    _options: &Options,
    _progress: &dyn Progress,
) -> Result<Outcome> {
    not_wired()
}

/// M3C2 from `cloud` to `reference`.
///
/// # Errors
/// Clouds that cannot be read or do not meet.
pub fn compare(
    _cloud: &Path,
    _reference: &Path,
    _settings: &ComparisonSettings,
    _options: &Options,
    _progress: &dyn Progress,
) -> Result<Outcome> {
    not_wired()
}

/// All of it, and the report.
///
/// # Errors
/// Whatever a stage refuses.
pub fn run(_project: &Project, _options: &Options, _progress: &dyn Progress) -> Result<Outcome> {
    not_wired()
}
