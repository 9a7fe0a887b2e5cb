//! The logs of a project through the online smoother: replayed, followed while they grow, or from
//! standard input.

mod follow;
mod stdin;

use std::io::{BufRead, Write};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::logs::DriveLogs;
use super::{Options, Outcome, write_trajectory};
use crate::error::{Error, Result};
use crate::format;
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::progress::Progress;
use crate::project::{Logs, Motion, Project};
use crate::sensor::{HeadingFix, ImuSample, PoseRecord, PositionFix};
use crate::trajectory::TrajectorySettings;
use crate::trajectory::{Jump, Online, OnlineOptions, Update};

/// Where the records come from.
pub enum Source<'a> {
    /// The logs of the project, in time order as if live.
    Replay,
    /// The logs of the project while they grow, until none has grown for this long.
    Follow(Duration),
    /// One merged stream of lines: the name of a sensor and the columns of its log.
    Lines(&'a mut dyn BufRead),
}

/// A record of any sensor, in common time, the project's origin subtracted.
#[derive(Debug, Clone, Copy)]
enum Record {
    Imu(ImuSample),
    Position(usize, PositionFix),
    Heading(HeadingFix),
}

impl Record {
    fn time_s(&self) -> f64 {
        match self {
            Self::Imu(sample) => sample.time_s,
            Self::Position(_, fix) => fix.time_s,
            Self::Heading(fix) => fix.time_s,
        }
    }

    /// The IMU first where times are equal: what it has reached needs no wait.
    fn order(&self) -> usize {
        match self {
            Self::Imu(_) => 0,
            Self::Heading(_) => 1,
            Self::Position(sensor, _) => 2 + sensor,
        }
    }
}

/// All records in time order.
fn merged(mut records: Vec<Record>) -> Vec<Record> {
    records.sort_by(|a, b| (a.time_s().total_cmp(&b.time_s())).then(a.order().cmp(&b.order())));
    records
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
    let staging = Staging::new(&options.out, &project.inputs(), &names)?;
    let live = !matches!(source, Source::Replay);
    if !logs.settings.estimate.is_empty() {
        progress.warn("constants are held at the project's values until the drive ends");
    }
    let mut session;
    match source {
        Source::Replay => {
            let read = DriveLogs::read(project, logs, progress)?;
            session = Session::new(&read.settings, project.origin_m, None)?;
            progress.begin("online", 0);
            for record in in_order(&read) {
                session.give(record, progress)?;
            }
            progress.end();
        }
        Source::Follow(idle) => {
            session = Session::new(&settings(project, logs), project.origin_m, Some(rows))?;
            follow::follow(project, logs, idle, (&staging, progress), |record| {
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
    session.finish(project, options, staging, live, progress)
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

fn in_order(logs: &DriveLogs) -> Vec<Record> {
    let mut records: Vec<Record> = logs.imu.iter().map(|s| Record::Imu(*s)).collect();
    records.extend(logs.heading.iter().map(|h| Record::Heading(*h)));
    for (sensor, fixes) in logs.positions.iter().enumerate() {
        records.extend(fixes.iter().map(|f| Record::Position(sensor, *f)));
    }
    merged(records)
}

/// The smoother and what it has answered.
struct Session<'a> {
    smoother: Online,
    origin_m: Vec3,
    rows: Option<&'a mut dyn Write>,
    /// Milliseconds of every record that made an update.
    times_ms: Vec<f64>,
    poses: Vec<PoseRecord>,
    relinearised: usize,
}

impl<'a> Session<'a> {
    fn new(
        settings: &TrajectorySettings,
        origin_m: Vec3,
        rows: Option<&'a mut dyn Write>,
    ) -> Result<Self> {
        Ok(Self {
            smoother: Online::new(settings, OnlineOptions::default())?,
            origin_m,
            rows,
            times_ms: Vec::new(),
            poses: Vec::new(),
            relinearised: 0,
        })
    }

    fn give(&mut self, record: Record, progress: &dyn Progress) -> Result<()> {
        let begun = Instant::now();
        let updates = match record {
            Record::Imu(sample) => self.smoother.imu(sample)?,
            Record::Position(sensor, fix) => self.smoother.position(sensor, fix)?,
            Record::Heading(fix) => {
                self.smoother.heading(fix)?;
                Vec::new()
            }
        };
        if updates.is_empty() {
            return Ok(());
        }
        self.times_ms.push(begun.elapsed().as_secs_f64() * 1e3);
        for update in &updates {
            self.take(update, progress)?;
        }
        Ok(())
    }

    fn take(&mut self, update: &Update, progress: &dyn Progress) -> Result<()> {
        let mut pose = update.pose;
        pose.world_from_body.translation.vector += self.origin_m;
        self.relinearised += update.relinearised;
        for rejection in &update.rejected {
            let size = rejection
                .normalised
                .map_or_else(String::new, |n| format!(", {n:.1} sigma"));
            progress.say(&format!(
                "{} record {} at {:.3} s: {}{size}",
                rejection.sensor, rejection.record, rejection.time_s, rejection.reason
            ));
        }
        for Jump { sensor, time_s } in &update.jumps {
            progress.warn(&format!(
                "at {time_s:.3} s the estimate had contradicted {sensor} for too long: it jumps, \
                 and follows it again"
            ));
        }
        if let Some(rows) = &mut self.rows {
            let first = self.poses.is_empty();
            write_row(rows, &pose, first).map_err(|error| Error::io("stdout", error))?;
        }
        // A late fix betters the same pose.
        match self.poses.last_mut() {
            Some(last) if last.time_s >= pose.time_s => *last = pose,
            _ => self.poses.push(pose),
        }
        Ok(())
    }

    /// The whole trajectory, the files, and the answer.
    fn finish(
        self,
        project: &Project,
        options: &Options,
        staging: Staging,
        live: bool,
        progress: &dyn Progress,
    ) -> Result<Outcome> {
        let rejected = self.smoother.rejections().to_vec();
        let jumps = self.smoother.jumps().to_vec();
        let estimate = self.smoother.finish(progress)?;
        let mut files = Vec::new();
        write_trajectory(
            &staging.path("trajectory.csv"),
            &estimate.trajectory,
            &project.origin_m,
        )?;
        files.push(options.out.join("trajectory.csv"));
        if !self.poses.is_empty() {
            format::write_trajectory(&staging.path("online.csv"), &self.poses)?;
            files.push(options.out.join("online.csv"));
        }
        staging.commit()?;
        let times = TimesMs::of(&self.times_ms);
        let solution = &estimate.solution;
        let (first_s, last_s) = estimate.trajectory.span_s();
        let nodes = estimate.trajectory.nodes().len();
        let mut summary = format!(
            "{} updates, median {:.3} ms, 99.9 % {:.3} ms; {} records refused, {} jumps\n{nodes} \
             poses over {:.1} s; {solution}",
            self.times_ms.len(),
            times.median,
            times.p999,
            rejected.len(),
            jumps.len(),
            last_s - first_s,
        );
        if live {
            // Beside rows of numbers, words are comments.
            for file in files.drain(..) {
                summary.push_str(&format!("\nwrote {}", file.display()));
            }
            summary = format!("# {}", summary.replace('\n', "\n# "));
        }
        Ok(Outcome {
            result: json!({
                "online": {
                    "updates": self.times_ms.len(),
                    "update_ms_median": number(times.median),
                    "update_ms_p999": number(times.p999),
                    "update_ms_max": number(times.max),
                    "relinearised": self.relinearised,
                    "rejected": rejected,
                    "jumps": jumps,
                },
                "trajectory": solution,
                "poses": nodes,
                "span_s": [first_s, last_s],
            }),
            summary,
            files,
        })
    }
}

/// `null` where there is no number.
fn number(x: f64) -> Value {
    if x.is_nan() { Value::Null } else { json!(x) }
}

/// Quantiles of the times of updates; NaN without updates.
struct TimesMs {
    median: f64,
    p999: f64,
    max: f64,
}

impl TimesMs {
    fn of(times_ms: &[f64]) -> Self {
        let mut sorted = times_ms.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = sorted.len().saturating_sub(1);
            let rank = (share * last as f64).ceil() as usize;
            sorted.get(rank).copied().unwrap_or(f64::NAN)
        };
        Self {
            median: at(0.5),
            p999: at(0.999),
            max: at(1.0),
        }
    }
}

/// Time, position, attitude and standard deviations as a line, flushed so that it arrives.
fn write_row(rows: &mut dyn Write, pose: &PoseRecord, first: bool) -> std::io::Result<()> {
    if first {
        writeln!(
            rows,
            "time_s,east_m,north_m,up_m,qx,qy,qz,qw,sigma_east_m,sigma_north_m,sigma_up_m,\
             sigma_rotation_east_rad,sigma_rotation_north_rad,sigma_rotation_up_rad"
        )?;
    }
    let (t, q) = (
        &pose.world_from_body.translation,
        &pose.world_from_body.rotation,
    );
    write!(
        rows,
        "{},{},{},{},{},{},{},{}",
        pose.time_s, t.x, t.y, t.z, q.i, q.j, q.k, q.w
    )?;
    if let Some(sigma) = &pose.sigma {
        for x in sigma.position_m.iter().chain(&sigma.rotation_rad) {
            write!(rows, ",{x}")?;
        }
    }
    writeln!(rows)?;
    rows.flush()
}
