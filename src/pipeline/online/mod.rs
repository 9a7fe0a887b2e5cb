//! The logs of a project through the online smoother: replayed, followed while they grow, or from
//! standard input.

mod follow;
mod session;
mod stdin;

use std::io::{BufRead, Write};
use std::time::Duration;

use super::job::Job;
use super::logs::DriveLogs;
use super::open_project::OpenProject;
use super::outcome::{Options, Outcome};
use crate::error::{Error, Result};
use crate::feed::Feed;
use crate::progress::Progress;
use crate::project::{Motion, Project};
use session::Session;

/// Source of the records.
pub enum Source<'a> {
    /// The logs of the project, in time order as if live.
    Replay,
    /// The logs of the project while they grow, until none has grown for this long.
    Follow(Duration),
    /// One merged stream of lines: the name of a sensor and the columns of its log.
    Lines(&'a mut dyn BufRead),
}

/// Estimates the trajectory from logs, update by update. Unless the logs are replayed, every update
/// is written to `rows` as a line of CSV.
///
/// # Errors
/// A project without logs; errors of the readers, the smoother and the adjustment.
pub fn online(
    project: &Project,
    source: Source<'_>,
    options: &Options,
    rows: &mut dyn Write,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let Motion::Logs(logs) = &project.motion else {
        return Err(Error::data(
            format!("{} contains a trajectory, not logs", project.path.display()),
            "use --online with a project that has [imu] and [prism] or [gnss]",
        ));
    };
    let names = ["trajectory.csv", "online.csv"];
    let job = Job::new(options, &project.inputs(), &names, progress)?;
    let live = !matches!(source, Source::Replay);
    if !logs.settings.estimate.is_empty() {
        progress.warn("constants are held at the project's values until the drive ends");
    }
    let feed = Feed::new(project, logs);
    let origin_m = project.origin_m.unwrap_or_default();
    let mut session;
    match source {
        Source::Replay => {
            let read = DriveLogs::read(&OpenProject::new(project), logs, progress)?;
            session = Session::new(&read.settings, origin_m, None)?;
            let _stage = progress.stage("online", 0);
            for record in read.in_order() {
                session.add(record, progress)?;
            }
        }
        Source::Follow(idle) => {
            session = Session::new(&feed.settings(), origin_m, Some(rows))?;
            follow::follow(feed, logs, idle, progress, |record| {
                session.add(record, progress)
            })?;
        }
        Source::Lines(lines) => {
            session = Session::new(&feed.settings(), origin_m, Some(rows))?;
            stdin::read(feed, lines, progress, |record| {
                session.add(record, progress)
            })?;
        }
    }
    session.finish(options, job, live, progress)
}
