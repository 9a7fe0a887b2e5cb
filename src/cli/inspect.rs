//! `boresight inspect`

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::context::{Context, project_file};
use super::describe;
use super::print::unprintable;
use crate::error::Result;
use crate::format::{self, Input};
use crate::pipeline::{self, Outcome};
use crate::progress::Progress;
use crate::project::{self, Mountings, Project};
use crate::verdict::Verdict;

/// Describe files: format, span, rate, gaps, units, counts; for a project, what a run will do
#[derive(Debug, clap::Args)]
pub(super) struct Inspect {
    /// Project files, data files or folders
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Estimate the noise of IMU logs at rest from their Allan deviation, as keys of a project
    #[arg(long)]
    allan: bool,
}

impl Inspect {
    /// Describes each file, or the error in reading it if there are several; the flag says whether
    /// all could be read.
    pub fn execute(&self, context: &Context) -> Result<(Outcome, bool)> {
        let mut documents = Vec::new();
        let mut texts = Vec::new();
        let (mut all_read, mut verdicts) = (true, Vec::new());
        for file in &self.files {
            let inspected = if self.allan {
                super::allan::inspect(file)
            } else {
                inspect(file, &mut verdicts, &context.terminal)
            };
            let (document, text) = match inspected {
                Ok(description) => description,
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
            verdicts: (!verdicts.is_empty()).then_some(verdicts),
            ..Outcome::default()
        };
        Ok((outcome, all_read))
    }
}

/// Adds the verdicts on a project to `verdicts`.
fn inspect(
    file: &Path,
    verdicts: &mut Vec<Verdict>,
    progress: &dyn Progress,
) -> Result<(Value, String)> {
    let is_project = file.join("project.toml").is_file();
    // A format is detected only of the folder of a recording of ROS 2, which stands for the recording.
    if file.is_dir() && !is_project && format::detect(file).is_err() {
        return folder(file);
    }
    let file = &project_file(file);
    let input = &Input::from(file);
    if format::detect(input)?.id() != "project" {
        let description = format::inspect(input)?;
        let document = serde_json::to_value(&description).map_err(unprintable)?;
        return Ok((document, description.to_string().trim_end().to_owned()));
    }
    if let Ok(Mountings {
        scanners,
        axes: None,
        ..
    }) = project::mountings(file)
    {
        return Ok(describe::mountings(file, &scanners));
    }
    let project = Project::read(file)?;
    project.check_files()?;
    let resolved: Value = toml::from_str(&project.to_toml()?).map_err(unprintable)?;
    let preview = pipeline::preview::preview(&project, progress)?;
    let mut document = json!({
        "path": file.display().to_string(),
        "format": "project",
        "project": resolved,
        "steps": describe::steps(&project),
        "found": serde_json::to_value(&preview).map_err(unprintable)?,
    });
    let text = describe::project(&project) + &describe::preview(&preview);
    if !preview.verdicts.is_empty() {
        pipeline::result::judge(&mut document, &preview.verdicts);
        verdicts.extend(preview.verdicts);
    }
    Ok((document, text))
}

/// Lists the files of a folder, and what each can serve as.
fn folder(folder: &Path) -> Result<(Value, String)> {
    let files = pipeline::survey(folder)?;
    let mut text = format!("{}\n", folder.display());
    for file in &files {
        text += &format!("  {file}\n");
    }
    text += &match files.len() {
        0 => "  no files".to_owned(),
        _ => format!(
            "  a project of these files: boresight init {}",
            folder.display()
        ),
    };
    let files: Vec<Value> = files.iter().map(super::init::document).collect();
    let path = folder.display().to_string();
    Ok((
        json!({ "path": path, "format": "folder", "files": files }),
        text,
    ))
}
