//! Options and outcome of a command.

use std::path::PathBuf;

use serde_json::Value;

use crate::verdict::Verdict;

/// Options of a command.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Folder of the results, created if it is missing.
    pub out: PathBuf,
    /// Seed of all random numbers; `None` for the seed of the scenario.
    pub seed: Option<u64>,
    /// Whether stages that an earlier run finished are run again.
    pub fresh: bool,
}

/// Outcome of a command.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    /// The result as one document, as in `result.json`.
    pub result: Value,
    /// Summary in a few lines of text, with units.
    pub summary: String,
    /// Files written, apart from the report, most important first.
    pub files: Vec<PathBuf>,
    /// The verdicts on the result, the gravest first; `None` if the command judges nothing.
    pub verdicts: Option<Vec<Verdict>>,
}
