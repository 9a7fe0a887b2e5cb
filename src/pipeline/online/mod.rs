//! The logs of a project through the online smoother: replayed, followed while they grow, or from
//! standard input.

mod follow;
mod record;
mod session;
mod stdin;

use std::io::{BufRead, Write};
use std::time::Duration;

use super::job::Job;
use super::logs::DriveLogs;
use super::outcome::{Options, Outcome};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::project::{Logs, Motion, Project};
use crate::trajectory::TrajectorySettings;
use record::in_order;
use session::Session;

/// Where the records come from.
pub enum Source<'a> {
    /// The logs of the project, in time order as if live.
    Replay,
    /// The logs of the project while they grow, until none has grown for this long.
    Follow(Duration),
    /// One merged stream of lines: the name of a sensor and the columns of its log.
    Lines(&'a mut dyn BufRead),
}

/// Logs to trajectory, update by update. Every update goes to `rows` as a line of CSV where the
/// records are not just replayed.
///
/// # Errors
/// A project without logs; whatever readers, smoother and adjustment find.
pub fn online(
    project: &Project,
    source: Source<'_>,
    options: &Options,
    rows: &mut dyn Write,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let Motion::Logs(logs) = &project.motion else {
        return Err(Error::data(
            format!("{} has a trajectory, not logs", project.path.display()),
            "use --online with a project that has [imu] and [prism] or [gnss]",
        ));
    };
    let names = ["trajectory.csv", "online.csv"];
    let job = Job::new(&options.out, &project.inputs(), &names, progress)?;
    let live = !matches!(source, Source::Replay);
    if !logs.settings.estimate.is_empty() {
        progress.warn("constants are held at the project's values until the drive ends");
    }
    let mut session;
    match source {
        Source::Replay => {
            let read = DriveLogs::read(project, logs, progress)?;
            session = Session::new(&read.settings, project.origin_m, None)?;
            let _stage = progress.stage("online", 0);
            for record in in_order(&read) {
                session.give(record, progress)?;
            }
        }
        Source::Follow(idle) => {
            session = Session::new(&settings(project, logs), project.origin_m, Some(rows))?;
            follow::follow(project, logs, idle, (&job, progress), |record| {
                session.give(record, progress)
            })?;
        }
        Source::Lines(lines) => {
            session = Session::new(&settings(project, logs), project.origin_m, Some(rows))?;
            stdin::read(project, logs, lines, |record| {
                session.give(record, progress)
            })?;
        }
    }
    session.finish(project, options, job, live, progress)
}

/// The project's settings with stations moved by the origin as the positions are.
fn settings(project: &Project, logs: &Logs) -> TrajectorySettings {
    let mut settings = logs.settings.clone();
    for station in settings
        .positions
        .iter_mut()
        .filter_map(|p| p.station_m.as_mut())
    {
        *station -= project.origin_m;
    }
    settings
}
