//! `boresight init`

use std::path::PathBuf;

use serde_json::json;

use crate::error::{Error, Location, Result};
use crate::output::write_whole;
use crate::pipeline::{self, NewProject, Outcome};
use crate::project::Project;

/// Write a commented project file for the logs and recordings of a folder
#[derive(Debug, clap::Args)]
pub(super) struct Init {
    /// The folder of a drive, such as a drive of FieldPheno4D
    folder: PathBuf,
    /// Replace an existing project file
    #[arg(long)]
    force: bool,
}

impl Init {
    pub fn execute(&self) -> Result<Outcome> {
        let path = self.folder.join("project.toml");
        if path.exists() && !self.force {
            return Err(Error::format(
                &path,
                Location::Whole,
                "a project file",
                "no project file yet, or --force to replace it",
            ));
        }
        let NewProject {
            text,
            missing,
            unread,
        } = pipeline::init(&self.folder)?;
        write_whole(&path, text.as_bytes())?;
        let mut summary = match (missing.is_empty(), Project::read(&path)) {
            (false, _) => format!(
                "Fill in the values that the files do not give: {}.",
                missing.join(", ")
            ),
            (true, Ok(_)) => "Everything that a run needs was found.".to_owned(),
            (true, Err(error)) => format!("To be corrected by hand: {error}"),
        };
        for error in &unread {
            summary += &format!("\nNot read: {error}");
        }
        Ok(Outcome {
            result: json!({ "project": path.display().to_string(), "missing": missing, "unread": unread }),
            summary,
            files: vec![path],
            ..Outcome::default()
        })
    }
}
