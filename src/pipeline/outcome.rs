//! Options and outcome of a command.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::error::Result;
use crate::output::{Staging, protect_inputs, refuse_kept};
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
    /// Files and folders in the folder of the results, by name, in which nothing may be replaced.
    pub kept: Vec<PathBuf>,
}

impl Options {
    /// A staging folder for results with these `names`.
    ///
    /// # Errors
    /// The folder cannot be created or written; a result would replace an input, or a file that is to be kept.
    pub fn staging(&self, inputs: &[PathBuf], names: &[impl AsRef<Path>]) -> Result<Staging> {
        protect_inputs(&self.out, inputs, names)?;
        refuse_kept(&self.out, names, &self.kept)?;
        let mut staging = Staging::new(&self.out, inputs, names)?;
        staging.keep(&self.kept);
        Ok(staging)
    }
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
