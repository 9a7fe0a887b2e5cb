//! The context of a command, and its log file.

use std::path::{Path, PathBuf};

use clap::Args;

use super::terminal::Terminal;
use crate::error::Result;
use crate::output::protect_inputs;
use crate::pipeline::{Options, Outcome};
use crate::progress::Progress;
use crate::project::Project;

/// Arguments of commands that work on a project.
#[derive(Debug, Args)]
pub(super) struct ProjectArguments {
    /// The project file, or a folder with a `project.toml`
    pub(super) project: PathBuf,
    /// Folder for the results [default: `out` next to the project]
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
}

impl ProjectArguments {
    /// The project, and the folder for its results.
    pub(super) fn read(&self) -> Result<(Project, PathBuf)> {
        let file = project_file(&self.project);
        Ok((Project::read(&file)?, out_folder(&self.out, &file)))
    }
}

/// Name of the log file.
const LOG: &str = "log.txt";

/// The context of a command.
pub(super) struct Context {
    pub(super) seed: Option<u64>,
    pub(super) terminal: Terminal,
}

impl Context {
    fn options(&self, out: &Path) -> Options {
        Options {
            out: out.to_owned(),
            seed: self.seed,
            fresh: false,
        }
    }

    /// Reads a project, checks that its files exist, runs `stage` on it and writes the log.
    pub(super) fn with_project(
        &self,
        on: &ProjectArguments,
        stage: impl Fn(&Project, &Options, &dyn Progress) -> Result<Outcome>,
    ) -> Result<Outcome> {
        let (project, out) = on.read()?;
        project.check_files()?;
        self.logged(&out, &project.inputs(), |options| {
            stage(&project, options, &self.terminal)
        })
    }

    /// Runs `work`, which reads `inputs`, and writes its messages to `log.txt` in `out`, even
    /// if it fails.
    pub(super) fn logged(
        &self,
        out: &Path,
        inputs: &[PathBuf],
        work: impl FnOnce(&Options) -> Result<Outcome>,
    ) -> Result<Outcome> {
        protect_inputs(out, inputs, &[LOG])?;
        let outcome = work(&self.options(out)).map_err(|error| error.within(inputs));
        if let Err(error) = &outcome {
            self.terminal.note(&format!("error: {error}"));
        }
        if out.is_dir() {
            let written = self.terminal.write_log(&out.join(LOG));
            // An error of the work takes precedence over one of its log.
            outcome.and_then(|outcome| written.map(|()| outcome))
        } else {
            outcome
        }
    }
}

/// The project file at a path: if the path is a folder, such as a recording, the `project.toml` in it.
pub(super) fn project_file(path: &Path) -> PathBuf {
    let inside = path.join("project.toml");
    if path.is_dir() && inside.is_file() {
        inside
    } else {
        path.to_owned()
    }
}

/// The requested folder, or `out` next to `file`.
pub(super) fn out_folder(asked: &Option<PathBuf>, file: &Path) -> PathBuf {
    asked.clone().unwrap_or_else(|| file.with_file_name("out"))
}
