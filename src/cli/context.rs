//! The context of a command, and its log file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;

use super::terminal::Terminal;
use crate::error::Result;
use crate::output::{names_in, protect_inputs, refuse_existing, refuse_kept};
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
    #[command(flatten)]
    pub(super) force: Force,
}

/// Whether files may be replaced.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct Force {
    /// Replace existing files, even those that boresight did not write
    #[arg(long)]
    pub(super) force: bool,
}

impl Force {
    /// Refuses to replace `inputs` and, unless they may be replaced, files that boresight did not write, by the files
    /// with these `names` in `folder`.
    ///
    /// # Errors
    /// Names the first that would be replaced.
    pub(super) fn check(
        self,
        folder: &Path,
        inputs: &[PathBuf],
        names: &[impl AsRef<Path>],
    ) -> Result<()> {
        protect_inputs(folder, inputs, names)?;
        if self.force {
            return Ok(());
        }
        refuse_kept(folder, names, &Folder::read(folder).foreign())
    }

    /// As [`Self::check`], but also refuses to replace what boresight wrote.
    pub(super) fn check_all(
        self,
        folder: &Path,
        inputs: &[PathBuf],
        names: &[impl AsRef<Path>],
    ) -> Result<()> {
        protect_inputs(folder, inputs, names)?;
        if self.force {
            return Ok(());
        }
        refuse_existing(folder, names)
    }
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
/// First line of the log in a folder that held nothing before boresight wrote into it.
const OWN_FOLDER: &str =
    "# The results in this folder are those of boresight, which may replace them.";
/// First line of the log in other folders.
const OTHER_FOLDER: &str = "# The log of boresight, in a folder with other files.";
/// Begins the lines below it that name what boresight wrote into the folder.
const WROTE: &str = "# wrote ";

/// Contents of an output folder before a command runs, and which of it boresight wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Folder {
    /// Names of its files and folders.
    names: BTreeSet<PathBuf>,
    /// Those that boresight wrote.
    own: BTreeSet<PathBuf>,
    /// Whether boresight alone writes into it.
    is_own: bool,
}

impl Folder {
    fn read(folder: &Path) -> Self {
        let names = names_in(folder);
        let log = std::fs::read_to_string(folder.join(LOG)).unwrap_or_default();
        let first = log.lines().next().unwrap_or_default();
        // Earlier versions began with a time.
        let time = first.trim_start().split_once(" s  ");
        let is_own = names.is_empty()
            || first == OWN_FOLDER
            || time.is_some_and(|(time, _)| time.parse::<f64>().is_ok());
        let own = if is_own {
            names.clone()
        } else if first == OTHER_FOLDER {
            let wrote = log.lines().filter_map(|line| line.strip_prefix(WROTE));
            wrote.chain([LOG]).map(PathBuf::from).collect()
        } else {
            BTreeSet::new()
        };
        Self { names, own, is_own }
    }

    /// The names that are not boresight's.
    fn foreign(&self) -> Vec<PathBuf> {
        self.names.difference(&self.own).cloned().collect()
    }

    /// The first lines of the log of a command that has left these names.
    fn head(&self, now: &BTreeSet<PathBuf>) -> String {
        if self.is_own {
            return format!("{OWN_FOLDER}\n");
        }
        let new = now.difference(&self.names).chain(&self.own);
        let wrote: BTreeSet<&PathBuf> = new.filter(|name| now.contains(*name)).collect();
        let lines = wrote
            .iter()
            .map(|name| format!("{WROTE}{}\n", name.display()));
        lines.fold(format!("{OTHER_FOLDER}\n"), |head, line| head + &line)
    }
}

/// The context of a command.
pub(super) struct Context {
    pub(super) seed: Option<u64>,
    pub(super) terminal: Terminal,
}

impl Context {
    fn options(&self, out: &Path, kept: Vec<PathBuf>) -> Options {
        Options {
            out: out.to_owned(),
            seed: self.seed,
            fresh: false,
            kept,
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
        self.logged(&out, &project.inputs(), on.force, |options| {
            stage(&project, options, &self.terminal)
        })
    }

    /// Marks a folder as one that boresight alone writes into, if it is: work that is interrupted there goes on from
    /// its own files. The folder is created if it is missing.
    pub(super) fn claim(&self, out: &Path) -> Result<()> {
        let folder = Folder::read(out);
        if !folder.is_own {
            return Ok(());
        }
        let head = folder.head(&folder.names);
        self.terminal.write_log(&out.join(LOG), &head)
    }

    /// Runs `work`, which reads `inputs`, and writes its messages to `log.txt` in `out`, even
    /// if it fails. Files that boresight did not write are replaced on request only.
    pub(super) fn logged(
        &self,
        out: &Path,
        inputs: &[PathBuf],
        force: Force,
        work: impl FnOnce(&Options) -> Result<Outcome>,
    ) -> Result<Outcome> {
        protect_inputs(out, inputs, &[LOG])?;
        let folder = Folder::read(out);
        let kept = if force.force {
            Vec::new()
        } else {
            folder.foreign()
        };
        let keeps_log = kept.contains(&PathBuf::from(LOG));
        let options = self.options(out, kept);
        let outcome = work(&options).map_err(|error| error.within(inputs));
        if let Err(error) = &outcome {
            self.terminal.note(&format!("error: {error}"));
        }
        if !out.is_dir() {
            return outcome;
        }
        let log = out.join(LOG);
        let written = if keeps_log {
            let kept = format!("{} is not a log of boresight and is kept", log.display());
            self.terminal
                .warn(&format!("{kept}: there is no log (--force replaces it)"));
            Ok(())
        } else {
            self.terminal.write_log(&log, &folder.head(&names_in(out)))
        };
        // An error of the work takes precedence over one of its log.
        outcome.and_then(|outcome| written.map(|()| outcome))
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
