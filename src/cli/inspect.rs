//! `boresight inspect`

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::describe;
use super::print::unprintable;
use crate::error::Result;
use crate::format::{self, Format};
use crate::pipeline::Outcome;
use crate::project::Project;

/// Say what files hold: format, span, rate, gaps, units, counts; for a project, what will be done
#[derive(Debug, clap::Args)]
pub(super) struct Inspect {
    /// Project files or data files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Noise figures of IMU logs at rest, from their Allan deviation, in the keys of a project
    #[arg(long)]
    allan: bool,
}

impl Inspect {
    /// Of several files each is told what it holds or what is wrong with it; the flag says whether
    /// all could be read.
    pub fn execute(&self) -> Result<(Outcome, bool)> {
        let mut documents = Vec::new();
        let mut texts = Vec::new();
        let mut all_read = true;
        for file in &self.files {
            let inspected = if self.allan {
                super::allan::inspect(file)
            } else {
                inspect(file)
            };
            let (document, text) = match inspected {
                Ok(found) => found,
                Err(error) if self.files.len() == 1 => return Err(error),
                Err(error) => {
                    all_read = false;
                    (
                        json!({ "path": file.display().to_string(), "error": error.to_string() }),
                        format!("{}\n  error    {error}", file.display()),
                    )
                }
            };
            documents.push(document);
            texts.push(text);
        }
        let outcome = Outcome {
            result: json!({ "files": documents }),
            summary: texts.join("\n\n"),
            files: Vec::new(),
        };
        Ok((outcome, all_read))
    }
}

fn inspect(file: &Path) -> Result<(Value, String)> {
    if format::detect(file)? != Format::Project {
        let found = format::inspect(file)?;
        let document = serde_json::to_value(&found).map_err(unprintable)?;
        return Ok((document, found.to_string().trim_end().to_owned()));
    }
    let project = Project::read(file)?;
    project.check_files()?;
    let resolved: Value = toml::from_str(&project.to_toml()?).map_err(unprintable)?;
    let document = json!({
        "path": file.display().to_string(),
        "format": "project",
        "project": resolved,
        "steps": describe::steps(&project),
    });
    Ok((document, describe::project(&project)))
}
