//! What every command is given, and the log that it leaves.

use std::path::{Path, PathBuf};

use clap::Args;

use super::terminal::Terminal;
use crate::error::Result;
use crate::output::keep_inputs;
use crate::pipeline::{Options, Outcome};
use crate::progress::Progress;
use crate::project::Project;

/// A project to work on and where its results go.
#[derive(Debug, Args)]
pub(super) struct OnProject {
    /// The project file
    pub(super) project: PathBuf,
    /// Folder of the results [default: `out` beside the project]
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
}

/// The file of what a command reports.
const LOG: &str = "log.txt";

/// What every command is given.
pub(super) struct Context {
    pub(super) seed: Option<u64>,
    pub(super) terminal: Terminal,
}

impl Context {
    fn options(&self, out: &Path) -> Options {
        Options {
            out: out.to_owned(),
            seed: self.seed,
        }
    }

    /// Reads a project, looks for its files, runs `stage` on it and keeps the log.
    pub(super) fn on_project(
        &self,
        on: &OnProject,
        stage: fn(&Project, &Options, &dyn Progress) -> Result<Outcome>,
    ) -> Result<Outcome> {
        let project = Project::read(&on.project)?;
        project.check_files()?;
        let out = out_folder(&on.out, &on.project);
        self.logged(&out, &project.inputs(), |options| {
            stage(&project, options, &self.terminal)
        })
    }

    /// Runs `work`, which reads `inputs`, and writes what it reported to `log.txt` in `out`, also
    /// when it failed there.
    pub(super) fn logged(
        &self,
        out: &Path,
        inputs: &[PathBuf],
        work: impl FnOnce(&Options) -> Result<Outcome>,
    ) -> Result<Outcome> {
        keep_inputs(out, inputs, &[LOG])?;
        let outcome = work(&self.options(out));
        if let Err(error) = &outcome {
            self.terminal.note(&format!("error: {error}"));
        }
        if out.is_dir() {
            let written = self.terminal.write_log(&out.join(LOG));
            // The error of the work matters more than one of its log.
            outcome.and_then(|outcome| written.map(|()| outcome))
        } else {
            outcome
        }
    }
}

/// The folder that was asked for, or `out` beside `file`.
pub(super) fn out_folder(asked: &Option<PathBuf>, file: &Path) -> PathBuf {
    asked.clone().unwrap_or_else(|| file.with_file_name("out"))
}
