//! The trajectory while driving, from what is recorded, by the online smoother.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::clock::Clock;
use super::coverage::{Coverage, Seen};
use super::field::Field;
use super::tail::Tail;
use crate::error::{Error, Result};
use crate::format;
use crate::geometry::Vec3;
use crate::geometry::heading::heading_rad;
use crate::project::{Logs, Motion, Project};
use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use crate::trajectory::{Online, OnlineOptions, TrajectorySettings, Update};

/// Time between two looks at the logs, of ours.
const LOOK: Duration = Duration::from_millis(250);
/// A smoother keeps all records until its end: after so many seconds of the recording another one takes its place,
/// which was begun [`OVERLAP_S`] before.
const TERM_S: f64 = 1800.0;
const OVERLAP_S: f64 = 120.0;

/// What is known of the platform's pose while driving.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LiveView {
    /// The newest pose; `None` before the first one.
    pub pose: Option<LivePose>,
    /// Why there is no pose, or none any more.
    pub trouble: Option<String>,
    /// Which boards were seen from where.
    pub boards: Vec<Seen>,
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

/// Follows the logs until `stop`, and shows what they give in `view`. What fails here is shown, and disturbs nothing
/// else.
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
        match live.look(clock.common_s(&clock.now())) {
            Ok(()) => show(&|view| {
                view.pose = live.pose;
                view.boards = live.coverage.seen();
                view.trouble = live.missing();
            }),
            Err(error) => {
                live.begin_again(&error);
                show(&|view| view.trouble = live.missing());
            }
        }
        std::thread::sleep(LOOK);
    }
    let _ = std::fs::remove_dir_all(&live.scratch);
}

/// The logs and the smoothers.
struct Live {
    project: Project,
    settings: TrajectorySettings,
    /// Folder for what is read.
    scratch: PathBuf,
    imu: Tail,
    heading: Option<Tail>,
    positions: Vec<Tail>,
    /// The one whose poses are shown, and the one that follows it, with the times at which they began.
    smoothers: Vec<(Online, f64)>,
    pose: Option<LivePose>,
    coverage: Coverage,
    /// Why the smoothers lost their way; `None` once there is a pose again.
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
        let name = format!("boresight-live-{}-{}", std::process::id(), folder.display());
        let name = name.replace(['/', '\\', ':'], "-");
        let scratch = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&scratch).map_err(|error| Error::io(&scratch, error))?;
        let tail = |path: &Path, name: &str| Tail::new(path, &scratch.join(name));
        let mut settings = logs.settings.clone();
        settings.estimate.clear();
        for position in &mut settings.positions {
            if let Some(station) = &mut position.station_m {
                *station -= project.origin_m;
            }
        }
        Ok(Self {
            imu: tail(&logs.imu.path, "imu"),
            heading: logs.heading.as_ref().map(|log| tail(&log.path, "heading")),
            positions: logs
                .positions
                .iter()
                .enumerate()
                .map(|(i, log)| tail(&log.path, &format!("position-{i}")))
                .collect(),
            coverage: Coverage::new(&field.boards, &project),
            settings,
            smoothers: Vec::new(),
            pose: None,
            failure: None,
            scratch,
            project,
        })
    }

    /// The smoothers lost their way.
    fn begin_again(&mut self, error: &Error) {
        self.smoothers.clear();
        self.pose = None;
        self.failure = Some(error.to_string());
    }

    /// Why there is no pose.
    fn missing(&self) -> Option<String> {
        if self.pose.is_some() {
            return None;
        }
        let mut tails = [&self.imu]
            .into_iter()
            .chain(&self.heading)
            .chain(&self.positions);
        let smoother = self.smoothers.first();
        let why = self.failure.as_deref();
        let why = why.or_else(|| tails.find_map(Tail::trouble));
        let why = why.or_else(|| smoother.and_then(|(smoother, _)| smoother.waits_for()));
        Some(why.unwrap_or("waits for the IMU and positions").to_owned())
    }

    /// Reads what is new and takes it in.
    fn look(&mut self, common_s: f64) -> Result<()> {
        let Motion::Logs(logs) = &self.project.motion else {
            return Ok(());
        };
        let logs: Logs = (**logs).clone();
        let mut imu = self
            .imu
            .next(common_s, format::read_imu, |s: &mut ImuSample| {
                &mut s.time_s
            })?;
        for sample in &mut imu {
            sample.time_s += logs.imu.time_offset_s;
        }
        let mut headings: Vec<HeadingFix> = Vec::new();
        if let (Some(tail), Some(log)) = (&mut self.heading, &logs.heading) {
            headings = tail.next(common_s, format::read_heading, |h: &mut HeadingFix| {
                &mut h.time_s
            })?;
            for fix in &mut headings {
                fix.time_s += log.time_offset_s;
            }
        }
        let mut fixes: Vec<(usize, PositionFix)> = Vec::new();
        for (sensor, (tail, log)) in self.positions.iter_mut().zip(&logs.positions).enumerate() {
            let crs = self.project.crs.as_ref();
            // New rows may all lack a range, which is no error of a part of a table.
            let is_table = log.path.extension().is_some_and(|end| end == "csv");
            let read = |path: &Path| {
                let read = if is_table {
                    format::read_new_positions(path, &log.observations)
                } else {
                    format::read_projected_positions(path, &log.observations, crs)
                };
                read.map(|found| found.fixes)
            };
            let new = tail.next(common_s, read, |f: &mut PositionFix| &mut f.time_s)?;
            fixes.extend(new.into_iter().map(|mut fix| {
                fix.time_s += log.time_offset_s;
                fix.position_m -= self.project.origin_m;
                (sensor, fix)
            }));
        }
        self.renew(common_s)?;
        let mut newest: Option<Update> = None;
        for (i, (smoother, _)) in self.smoothers.iter_mut().enumerate() {
            let mut updates = Vec::new();
            headings.iter().try_for_each(|fix| smoother.heading(*fix))?;
            for (sensor, fix) in &fixes {
                updates.extend(smoother.position(*sensor, *fix)?);
            }
            for sample in &imu {
                updates.extend(smoother.imu(*sample)?);
            }
            if i > 0 {
                continue;
            }
            for update in &updates {
                let mut pose = update.pose.world_from_body;
                pose.translation_m += self.project.origin_m;
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
                position_m: world_from_body.translation_m + self.project.origin_m,
                sigma_m: sigma.map_or(Vec3::repeat(f64::NAN), |sigma| sigma.position_m),
                heading_rad: heading_rad(&world_from_body.rotation),
                heading_sigma_rad: sigma.map_or(f64::NAN, |sigma| sigma.rotation_rad.z),
            });
        }
        Ok(())
    }

    /// Begins the next smoother, and ends the present one, where it is time.
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
