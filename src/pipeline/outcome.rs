//! What a command is given and what it answers.

use std::path::PathBuf;

use serde_json::Value;

/// Where results go and what chance starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The folder of the results; created where it is missing.
    pub out: PathBuf,
    /// Seed of every random draw; `None` for that of the scenario.
    pub seed: Option<u64>,
}

/// What a command found.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result as one document, as in `result.json`.
    pub result: Value,
    /// The same for people: a few lines with units.
    pub summary: String,
    /// What was written beside the report, most important first.
    pub files: Vec<PathBuf>,
}
