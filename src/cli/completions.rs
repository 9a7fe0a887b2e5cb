//! `boresight completions` and `boresight man`: descriptions of the commands for shells and `man`.

use std::path::{Path, PathBuf};

use clap::Command;
use clap_complete::Shell;
use serde_json::json;

use super::context::Force;
use crate::error::{Error, Result};
use crate::output::Staging;
use crate::pipeline::Outcome;

/// Name of the page of the whole program; the pages of its commands are `boresight-run.1` and so on.
const FIRST_PAGE: &str = "boresight.1";

/// Print the completions of a shell
///
/// For bash: `boresight completions bash > ~/.local/share/bash-completion/completions/boresight`; for zsh, a file
/// `_boresight` in a folder of `fpath`; for fish, `~/.config/fish/completions/boresight.fish`.
#[derive(Debug, clap::Args)]
pub(super) struct Completions {
    shell: Shell,
}

impl Completions {
    pub fn execute(&self, mut line: Command) -> Outcome {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut line, "boresight", &mut script);
        let script = String::from_utf8_lossy(&script).into_owned();
        Outcome {
            result: json!({ "shell": self.shell.to_string(), "script": script }),
            summary: script,
            ..Outcome::default()
        }
    }
}

/// Write the manual pages of all commands
#[derive(Debug, clap::Args)]
pub(super) struct Man {
    /// Folder for the pages, for example `~/.local/share/man/man1`
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    #[command(flatten)]
    force: Force,
}

impl Man {
    pub fn execute(&self, line: Command) -> Result<Outcome> {
        let line = line.disable_help_subcommand(true);
        let names = line
            .get_subcommands()
            .map(|command| format!("boresight-{}.1", command.get_name()));
        let names: Vec<String> = std::iter::once(FIRST_PAGE.to_owned())
            .chain(names)
            .collect();
        self.force.check(&self.folder, &[], &names)?;
        let staging = Staging::new(&self.folder, &[], &names)?;
        let first = staging.path(FIRST_PAGE);
        let folder = first.parent().unwrap_or(Path::new("."));
        clap_mangen::generate_to(line, folder).map_err(|error| Error::io(folder, error))?;
        staging.commit()?;
        Ok(Outcome {
            result: json!({ "folder": self.folder, "pages": names }),
            summary: format!("{} pages", names.len()),
            files: names.iter().map(|name| self.folder.join(name)).collect(),
            ..Outcome::default()
        })
    }
}
