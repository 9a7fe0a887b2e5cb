//! `boresight init`

use std::path::PathBuf;

use serde_json::{Value, json};

use crate::error::{Error, Location, Result};
use crate::output::write_whole;
use crate::pipeline::{self, FileUse, NewProject, Outcome};
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
            files,
            is_trajectory_only,
        } = pipeline::init(&self.folder)?;
        write_whole(&path, text.as_bytes())?;
        let mut lines: Vec<String> = files.iter().map(ToString::to_string).collect();
        let file = path.display();
        if is_trajectory_only {
            lines.push(
                "No file is a recording of a scanner: these give a trajectory, and no mounting."
                    .to_owned(),
            );
        }
        lines.push(match (missing.is_empty(), Project::read(&path)) {
            (false, _) => format!(
                "Fill in what the files do not say, in {file}: {}.",
                missing.join("; ")
            ),
            (true, Ok(_)) => "Everything that a run needs was found.".to_owned(),
            (true, Err(error)) => format!("To be corrected by hand: {error}"),
        });
        lines.push(format!(
            "Next, see what a run will find: boresight inspect {file}"
        ));
        let command = if is_trajectory_only {
            "trajectory"
        } else {
            "run"
        };
        lines.push(format!("Then: boresight {command} {file}"));
        let listed: Vec<Value> = files.iter().map(document).collect();
        Ok(Outcome {
            result: json!({ "project": path.display().to_string(), "missing": missing, "unread": unread,
                "files": listed }),
            summary: lines.join("\n"),
            files: vec![path],
            ..Outcome::default()
        })
    }
}

/// A file and its use, for JSON.
pub(super) fn document(file: &FileUse) -> Value {
    json!({
        "path": file.path.display().to_string(),
        "format": file.format,
        "serves": file.serves,
        "count": file.count,
        "span_s": file.span_s,
    })
}
