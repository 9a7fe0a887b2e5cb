//! `boresight inspect`

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::describe;
use crate::error::{Error, Result};
use crate::pipeline::Outcome;
use crate::project::Project;

/// Say what files hold: format, span, rate, gaps, units, counts; for a project, what will be done
#[derive(Debug, clap::Args)]
pub(super) struct Inspect {
    /// Project files or data files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

impl Inspect {
    pub fn execute(&self) -> Result<Outcome> {
        let mut documents = Vec::new();
        let mut texts = Vec::new();
        for file in &self.files {
            let (document, text) = inspect(file)?;
            documents.push(document);
            texts.push(text);
        }
        Ok(Outcome {
            result: json!({ "files": documents }),
            summary: texts.join("\n\n"),
            files: Vec::new(),
        })
    }
}

fn inspect(file: &Path) -> Result<(Value, String)> {
    if file.extension().is_none_or(|extension| extension != "toml") {
        return Err(Error::data("not wired yet", "wait for the formats"));
    }
    let project = Project::read(file)?;
    project.check_files()?;
    let resolved: toml::Value = toml::from_str(&project.to_toml()?).map_err(|error| {
        Error::data(
            format!("the project prints as what is not TOML: {error}"),
            "report this",
        )
    })?;
    let document = json!({
        "file": file.display().to_string(),
        "format": "project",
        "project": resolved,
        "steps": describe::steps(&project),
    });
    Ok((document, describe::project(&project)))
}
