//! The pose while driving: the online smoother on the logs that are being recorded.

use std::path::Path;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::clock::Clock;
use super::coverage::{BoardCoverage, Coverage};
use super::field::Field;
use super::tail::Tail;
use crate::error::{Error, Result};
use crate::feed::Feed;
use crate::geometry::Vec3;
use crate::geometry::heading::heading_rad;
use crate::project::{Motion, Project};
use crate::sensor::Record;
use crate::trajectory::{Online, OnlineOptions, TrajectorySettings, Update};

/// Interval between two reads of the logs.
const READ_INTERVAL: Duration = Duration::from_millis(250);
/// A smoother keeps all its records in memory. After this time it is replaced by another one, which has run beside it
/// for [`OVERLAP_S`]. Seconds.
const TERM_S: f64 = 1800.0;
const OVERLAP_S: f64 = 120.0;

/// The platform's pose while driving, for display.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LiveView {
    /// The newest pose; `None` before the first one.
    pub pose: Option<LivePose>,
    /// Why there is no pose, or what the readers of the logs left out or assumed.
    pub trouble: Option<String>,
    /// The courses on which the scanners crossed each board.
    pub boards: Vec<BoardCoverage>,
}

/// The newest pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LivePose {
    /// Common time of the recording, seconds.
    pub time_s: f64,
    /// East, north, up in the project's world, metres.
    pub position_m: Vec3,
    /// Standard deviations, metres.
    pub sigma_m: Vec3,
    /// Clockwise from north, radians.
    pub heading_rad: f64,
    /// Its standard deviation, radians.
    pub heading_sigma_rad: f64,
}

/// Follows the logs until `stop` is set and keeps `view` up to date. Errors are shown in `view` and do not stop the
/// recording.
pub(super) fn follow(
    field: &Field,
    folder: &Path,
    clock: &Clock,
    stop: &AtomicBool,
    view: &Mutex<LiveView>,
) {
    let show = |change: &dyn Fn(&mut LiveView)| {
        change(&mut view.lock().unwrap_or_else(PoisonError::into_inner));
    };
    let mut live = match Live::open(field, folder) {
        Ok(live) => live,
        Err(error) => {
            show(&|view| view.trouble = Some(error.to_string()));
            return;
        }
    };
    while !stop.load(Ordering::Relaxed) {
        match live.update(clock.common_s(&clock.now())) {
            Ok(()) => show(&|view| {
                view.pose = live.pose;
                view.boards = live.coverage.boards();
                view.trouble = live.trouble();
            }),
            Err(error) => {
                live.restart(&error);
                show(&|view| view.trouble = live.trouble());
            }
        }
        std::thread::sleep(READ_INTERVAL);
    }
}

/// The logs and the smoothers.
struct Live {
    project: Project,
    settings: TrajectorySettings,
    imu: Tail,
    heading: Option<Tail>,
    positions: Vec<Tail>,
    /// The smoother whose poses are shown, then the one that will replace it, each with the time at which it began.
    smoothers: Vec<(Online, f64)>,
    pose: Option<LivePose>,
    coverage: Coverage,
    /// The error of the last smoothers; `None` once there is a pose again.
    failure: Option<String>,
}

impl Live {
    fn open(field: &Field, folder: &Path) -> Result<Self> {
        let project = Project::read(&folder.join("project.toml"))?;
        let Motion::Logs(logs) = &project.motion else {
            return Err(Error::data(
                "the project has poses, not logs",
                "name the sources of [project.imu] and [project.prism] or [project.gnss]",
            ));
        };
        let mut settings = Feed::new(&project, logs).settings();
        settings.estimate.clear();
        Ok(Self {
            imu: Tail::new(&logs.imu.path),
            heading: logs.heading.as_ref().map(|log| Tail::new(&log.path)),
            positions: logs.positions.iter().map(|p| Tail::new(&p.path)).collect(),
            coverage: Coverage::new(&field.boards, &project),
            settings,
            smoothers: Vec::new(),
            pose: None,
            failure: None,
            project,
        })
    }

    /// Discards the smoothers after an error; the next update begins a new one.
    fn restart(&mut self, error: &Error) {
        self.smoothers.clear();
        self.pose = None;
        self.failure = Some(error.to_string());
    }

    /// Why there is no pose; if there is one, what the readers of the logs remarked in the last seconds.
    fn trouble(&self) -> Option<String> {
        let tails = [&self.imu].into_iter();
        let mut tails = tails.chain(&self.heading).chain(&self.positions);
        if self.pose.is_some() {
            let remarks: Vec<&str> = tails.filter_map(Tail::remarks).collect();
            return (!remarks.is_empty()).then(|| remarks.join("; "));
        }
        let smoother = self.smoothers.first();
        let why = self.failure.as_deref();
        let why = why.or_else(|| tails.find_map(Tail::trouble));
        let why = why.or_else(|| smoother.and_then(|(smoother, _)| smoother.waits_for()));
        Some(why.unwrap_or("waiting for IMU and positions").to_owned())
    }

    /// Reads the new records and updates the pose.
    fn update(&mut self, common_s: f64) -> Result<()> {
        let new = self.new_records(common_s)?;
        self.renew(common_s)?;
        let origin_m = self.project.origin_m.unwrap_or_default();
        let mut newest: Option<Update> = None;
        for (i, (smoother, _)) in self.smoothers.iter_mut().enumerate() {
            let mut updates = Vec::new();
            for record in &new {
                updates.extend(smoother.take(*record)?);
            }
            if i > 0 {
                continue;
            }
            for update in &updates {
                let mut pose = update.pose.world_from_body;
                pose.translation_m += origin_m;
                self.coverage.add(&pose);
            }
            newest = updates.pop();
        }
        if let Some(update) = newest {
            let world_from_body = update.pose.world_from_body;
            let sigma = update.pose.sigma;
            self.failure = None;
            self.pose = Some(LivePose {
                time_s: update.pose.time_s,
                position_m: world_from_body.translation_m + origin_m,
                sigma_m: sigma.map_or(Vec3::repeat(f64::NAN), |sigma| sigma.position_m),
                heading_rad: heading_rad(&world_from_body.rotation),
                heading_sigma_rad: sigma.map_or(f64::NAN, |sigma| sigma.rotation_rad.z),
            });
        }
        Ok(())
    }

    /// The records that have arrived, in time order.
    fn new_records(&mut self, common_s: f64) -> Result<Vec<Record>> {
        let Motion::Logs(logs) = &self.project.motion else {
            return Ok(Vec::new());
        };
        let feed = Feed::new(&self.project, logs);
        let samples = self.imu.next(common_s, |rows, times, clock| {
            feed.imu(rows, times, |samples| clock.put_on_common_time(samples))
        })?;
        let mut new: Vec<Record> = samples.into_iter().map(Record::Imu).collect();
        if let Some(tail) = &mut self.heading {
            let fixes = tail.next(common_s, |rows, times, clock| {
                feed.heading(rows, times, |fixes| clock.put_on_common_time(fixes))
            })?;
            new.extend(fixes.into_iter().map(Record::Heading));
        }
        for (sensor, tail) in self.positions.iter_mut().enumerate() {
            let fixes = tail.next(common_s, |rows, times, clock| {
                let read = feed.positions(sensor, rows, times, |fixes| {
                    clock.put_on_common_time(fixes);
                });
                read.map(|positions| positions.fixes)
            })?;
            new.extend(fixes.into_iter().map(|fix| Record::Position(sensor, fix)));
        }
        Record::sort(&mut new);
        Ok(new)
    }

    /// Begins a smoother if there is none or the present one ends soon, and ends the present one after its term.
    fn renew(&mut self, now_s: f64) -> Result<()> {
        let is_due = match self.smoothers.as_slice() {
            [] => true,
            [(_, begun_s)] => now_s - begun_s > TERM_S - OVERLAP_S,
            [(_, begun_s), ..] => {
                if now_s - begun_s > TERM_S {
                    self.smoothers.remove(0);
                }
                false
            }
        };
        if is_due {
            let smoother = Online::new(&self.settings, OnlineOptions::default())?;
            self.smoothers.push((smoother, now_s));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
