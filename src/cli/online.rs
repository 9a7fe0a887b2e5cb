//! `boresight trajectory --online`

use std::time::Duration;

use super::context::{Context, ProjectArguments, out_folder};
use crate::error::Result;
use crate::pipeline::Outcome;
use crate::pipeline::online::{Source, online};
use crate::project::Project;

/// Input of the online smoother.
#[derive(Debug, clap::Args)]
pub(super) struct OnlineFlags {
    /// Process the logs update by update as if live; writes the newest poses to online.csv
    #[arg(long)]
    pub online: bool,
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
}

fn seconds(text: &str) -> std::result::Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    Duration::try_from_secs_f64(seconds).map_err(|_| "not a number of seconds".to_owned())
}

impl OnlineFlags {
    pub fn execute(&self, on: &ProjectArguments, context: &Context) -> Result<Outcome> {
        let project = Project::read(&on.project)?;
        if !self.stdin {
            project.check_files()?;
        }
        let out = out_folder(&on.out, &on.project);
        let mut rows = std::io::stdout();
        let mut lines = std::io::stdin().lock();
        let source = if self.stdin {
            Source::Lines(&mut lines)
        } else if self.follow {
            Source::Follow(self.idle_s)
        } else {
            Source::Replay
        };
        context.logged(&out, &project.inputs(), |options| {
            online(&project, source, options, &mut rows, &context.terminal)
        })
    }
}
