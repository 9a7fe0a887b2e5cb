//! `boresight trajectory`

use std::time::Duration;

use super::context::{Context, ProjectArguments};
use super::pdf::Pdf;
use super::values::seconds;
use crate::error::Result;
use crate::pipeline::online::{Source, online};
use crate::pipeline::{self, Outcome};

/// Estimate the trajectory from the logs of a project
#[derive(Debug, clap::Args)]
pub(super) struct Trajectory {
    #[command(flatten)]
    on: ProjectArguments,
    /// Process the logs update by update as if live; writes the newest poses to online.csv, and no page
    #[arg(long, conflicts_with = "pdf")]
    online: bool,
    /// The logs may still grow: follow them, and print every update as a line of CSV
    #[arg(long, requires = "online", conflicts_with = "stdin")]
    follow: bool,
    /// With --follow: stop when no log has grown for S seconds
    #[arg(long, requires = "follow", value_name = "S", default_value = "10", value_parser = seconds)]
    idle_s: Duration,
    /// Read records from standard input, one per line after the name of its sensor (`imu,…`,
    /// `prism,…`, `heading,…`), and print every update as a line of CSV
    #[arg(long, requires = "online")]
    stdin: bool,
    #[command(flatten)]
    pdf: Pdf,
}

impl Trajectory {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        if !self.online {
            let printer = self.pdf.printer()?;
            return context.with_project(&self.on, |project, options, progress| {
                let outcome = pipeline::trajectory(project, options, progress)?;
                printer.print(&options.out.join("trajectory.html"), &options.kept, outcome)
            });
        }
        let (project, out) = self.on.read()?;
        if !self.stdin {
            project.check_files()?;
        }
        let mut rows = std::io::stdout();
        let mut lines = std::io::stdin().lock();
        let source = if self.stdin {
            Source::Lines(&mut lines)
        } else if self.follow {
            Source::Follow(self.idle_s)
        } else {
            Source::Replay
        };
        context.logged(&out, &project.inputs(), self.on.force, |options| {
            online(&project, source, options, &mut rows, &context.terminal)
        })
    }
}
