//! The online smoother: records in, poses out.
//!
//! Records are passed in as they arrive, those of each sensor in their own order. The first seconds are
//! kept until they determine the attitude; from then on every position fix gives the newest pose.
//! The cost of an update does not depend on how long the drive has lasted.

use super::finish::{finish, trajectory_so_far};
use super::options::OnlineOptions;
use super::overlap::check_overlap_so_far;
use super::records::{ReceivedLogs, Record};
use super::running::Running;
use super::scatter::{self, Scatter};
use super::start::{Start, UNIT_KNOWN_AFTER, start};
use super::update::{Jump, Update};
use crate::error::{Error, Problem, Result};
use crate::progress::Progress;
use crate::sensor::{self, HeadingFix, ImuSample, PositionFix};
use crate::trajectory::estimate::{Estimate, estimate};
use crate::trajectory::gaps::{MAX_IMU_GAP_S, check_interval, median_interval_s};
use crate::trajectory::imu_series::SAME_INSTANT_S;
use crate::trajectory::interpolate::Trajectory;
use crate::trajectory::settings::{Nodes, TrajectorySettings};
use crate::trajectory::solution::{Rejection, RejectionReason};
use crate::trajectory::streams::{Numbered, check_settings, is_valid_fix, is_valid_heading};
use crate::trajectory::timeline::MAX_STEP_S;
use std::collections::VecDeque;

/// After this time without a fix a node is added anyway, seconds: late enough that a fix every second
/// comes first.
const MAX_WAIT_S: f64 = MAX_STEP_S + 0.25;
/// Largest number of IMU stamps in a row that leap by more than a gap that can be bridged; after more,
/// the log has really moved to another time.
const MAX_LEAPS: usize = 10;

/// What the smoother is doing.
#[derive(Debug, Clone)]
enum Stage {
    /// Records are kept until they determine the attitude; the next attempt is at this time.
    Starting {
        next_s: f64,
    },
    Running(Box<Running>),
}

/// The online smoother.
#[derive(Debug, Clone)]
pub struct Online {
    /// The settings of the project.
    project_settings: TrajectorySettings,
    /// The settings used during the drive; constants are estimated only at its end.
    settings: TrajectorySettings,
    options: OnlineOptions,
    received: ReceivedLogs,
    waiting: VecDeque<Record>,
    newest_imu_s: f64,
    leaps: usize,
    /// Time of the newest record taken in of each position sensor, then of the heading.
    taken_s: Vec<f64>,
    /// For the same sensors, how many records in a row were far from the IMU's newest sample when they
    /// arrived.
    apart: Vec<usize>,
    scatter: Scatter,
    stage: Stage,
    waits_for: Option<String>,
}

impl Online {
    /// A smoother before its first record.
    ///
    /// # Errors
    /// Settings that are not valid.
    pub fn new(settings: &TrajectorySettings, options: OnlineOptions) -> Result<Self> {
        let sensors = settings.positions.len();
        let received = ReceivedLogs {
            positions: vec![Vec::new(); sensors],
            ..ReceivedLogs::default()
        };
        check_settings(&received.logs(), settings)?;
        Ok(Self {
            project_settings: settings.clone(),
            settings: TrajectorySettings {
                nodes: Nodes::Prism,
                estimate: Vec::new(),
                ..settings.clone()
            },
            options: OnlineOptions {
                reach: options.reach.max(2),
                ..options
            },
            received,
            waiting: VecDeque::new(),
            newest_imu_s: f64::NEG_INFINITY,
            leaps: 0,
            taken_s: vec![f64::NEG_INFINITY; sensors + 1],
            apart: vec![0; sensors + 1],
            scatter: Scatter::default(),
            stage: Stage::Starting {
                next_s: f64::NEG_INFINITY,
            },
            waits_for: None,
        })
    }

    /// Takes a record of any sensor; returns the updates of the fixes that the IMU has reached.
    ///
    /// # Errors
    /// Those of [`imu`](Self::imu), [`position`](Self::position) and [`heading`](Self::heading).
    pub fn take(&mut self, record: sensor::Record) -> Result<Vec<Update>> {
        match record {
            sensor::Record::Imu(sample) => self.imu(sample),
            sensor::Record::Position(sensor, fix) => self.position(sensor, fix),
            sensor::Record::Heading(fix) => self.heading(fix).map(|()| Vec::new()),
        }
    }

    /// Takes an IMU sample; returns the updates of the fixes that it has reached.
    ///
    /// # Errors
    /// Values that are not finite, times that are not in seconds, a gap of minutes, times that go back by
    /// minutes, a trajectory that is not determined.
    pub fn imu(&mut self, sample: ImuSample) -> Result<Vec<Update>> {
        if !scatter::is_finite(&sample) {
            return Err(not_finite(
                "IMU log",
                self.received.imu.len(),
                sample.time_s,
            ));
        }
        let record = self.received.imu.len();
        self.received.imu.push(sample);
        let ahead_s = sample.time_s - self.newest_imu_s;
        let leaps = ahead_s.abs() > MAX_IMU_GAP_S && record > 0;
        if ahead_s <= 0.0 || leaps {
            self.leaps = if leaps { self.leaps + 1 } else { 0 };
            if self.leaps > MAX_LEAPS {
                check_interval(median_interval_s(&self.received.imu))?;
                return Err(leap(self.newest_imu_s, sample.time_s));
            }
            self.refuse("imu".into(), record, sample.time_s);
            return Ok(Vec::new());
        }
        self.leaps = 0;
        self.newest_imu_s = sample.time_s;
        self.scatter.add(&sample);
        match &mut self.stage {
            Stage::Starting { next_s } if *next_s == f64::NEG_INFINITY => {
                *next_s = sample.time_s + self.options.start_s;
            }
            Stage::Starting { .. } if record == UNIT_KNOWN_AFTER => {
                check_interval(median_interval_s(&self.received.imu))?;
            }
            Stage::Starting { .. } => {}
            Stage::Running(running) => running.sample(sample, &self.scatter, &self.settings.imu)?,
        }
        self.advance()
    }

    /// Takes a fix of a position sensor; returns updates if the IMU has already reached it.
    ///
    /// # Errors
    /// A sensor that the settings do not have, values that are not finite, a matrix that is
    /// not a covariance, fixes that do not overlap with the IMU in time, a trajectory that is not
    /// determined.
    pub fn position(&mut self, sensor: usize, fix: PositionFix) -> Result<Vec<Update>> {
        let Some(received) = self.received.positions.get_mut(sensor) else {
            return Err(Error::data(
                format!(
                    "there is no position sensor {} to take a fix of",
                    sensor + 1
                ),
                format!(
                    "the settings have {} position sensors",
                    self.settings.positions.len()
                ),
            ));
        };
        if !(is_valid_fix(&fix) && fix.time_s.is_finite()) {
            let name = format!("{} log", self.settings.positions[sensor].name);
            return Err(not_finite(&name, received.len(), fix.time_s));
        }
        let record = received.len();
        received.push(fix);
        if let Some(imu_s) = self.starting_s() {
            let name = format!("{} log", self.settings.positions[sensor].name);
            let fixes = &self.received.positions[sensor];
            check_overlap_so_far(&mut self.apart[sensor], imu_s, &name, fixes)?;
        }
        self.wait(Record::Position(sensor, Numbered { record, value: fix }));
        self.advance()
    }

    /// Takes a heading; it takes effect with the next update.
    ///
    /// # Errors
    /// Values that are not finite, headings that do not overlap with the IMU in time.
    pub fn heading(&mut self, fix: HeadingFix) -> Result<()> {
        let record = self.received.heading.len();
        if !(is_valid_heading(&fix) && fix.time_s.is_finite()) {
            return Err(not_finite("heading log", record, fix.time_s));
        }
        self.received.heading.push(fix);
        if let (Some(imu_s), Some(apart)) = (self.starting_s(), self.apart.last_mut()) {
            check_overlap_so_far(apart, imu_s, "heading log", &self.received.heading)?;
        }
        self.wait(Record::Heading(Numbered { record, value: fix }));
        Ok(())
    }

    /// First and newest time of the IMU, if there are samples and the start has not been made.
    fn starting_s(&self) -> Option<(f64, f64)> {
        let first = self.received.imu.first().filter(|_| !self.is_running())?;
        Some((first.time_s, self.newest_imu_s))
    }

    fn wait(&mut self, record: Record) {
        let after = self
            .waiting
            .partition_point(|waiting| waiting.time_s() <= record.time_s());
        self.waiting.insert(after, record);
    }

    fn refuse(&mut self, sensor: String, record: usize, time_s: f64) {
        // The start itself lists the records refused before it.
        if let Stage::Running(running) = &mut self.stage {
            running.rejections.push(Rejection {
                sensor,
                record: record + 1,
                time_s,
                reason: RejectionReason::TimeOrder,
                normalised: None,
            });
        }
    }

    /// Makes the updates that the records so far allow.
    fn advance(&mut self) -> Result<Vec<Update>> {
        let mut updates = Vec::new();
        if let Stage::Starting { next_s } = &mut self.stage {
            let first = self.received.imu.first();
            let Some(first) = first.filter(|_| self.newest_imu_s >= *next_s) else {
                return Ok(updates);
            };
            let first_s = first.time_s;
            // Ever longer intervals, so that all attempts together cost no more than a few.
            *next_s = self.newest_imu_s + (0.25 * (self.newest_imu_s - first_s)).max(0.5);
            match start(
                &self.received,
                self.newest_imu_s,
                &self.settings,
                self.options,
            )? {
                Start::Made(running, update) => {
                    self.started(running);
                    updates.push(update);
                }
                Start::NotYet(Error::Data { problem, .. }) => self.waits_for = Some(problem),
                Start::NotYet(error) => self.waits_for = Some(error.to_string()),
            }
            return Ok(updates);
        }
        loop {
            let reached_s = self.newest_imu_s + SAME_INSTANT_S;
            let fix = self.waiting.iter().position(|record| {
                matches!(record, Record::Position(..)) || record.time_s() > reached_s
            });
            let fix = fix.filter(|&at| self.waiting[at].time_s() <= reached_s);
            let Stage::Running(running) = &mut self.stage else {
                return Ok(updates);
            };
            let until_s = match fix {
                Some(at) => self.waiting[at].time_s(),
                None if self.newest_imu_s - running.smoother.newest_s() >= MAX_WAIT_S => {
                    self.newest_imu_s - (MAX_WAIT_S - MAX_STEP_S)
                }
                None => return Ok(updates),
            };
            // All records up to that time, including fixes of other sensors at the same time.
            let count = self
                .waiting
                .partition_point(|record| record.time_s() <= until_s + SAME_INSTANT_S);
            let mut in_order = Vec::with_capacity(count);
            for record in self.waiting.drain(..count) {
                let (stream, number) = match &record {
                    Record::Position(sensor, fix) => (*sensor, fix.record),
                    Record::Heading(fix) => (self.taken_s.len() - 1, fix.record),
                };
                if record.time_s() > self.taken_s[stream] {
                    self.taken_s[stream] = record.time_s();
                    in_order.push(record);
                } else {
                    running.rejections.push(Rejection {
                        sensor: match &record {
                            Record::Position(sensor, _) => {
                                self.settings.positions[*sensor].name.clone()
                            }
                            Record::Heading(_) => "heading".into(),
                        },
                        record: number + 1,
                        time_s: record.time_s(),
                        reason: RejectionReason::TimeOrder,
                        normalised: None,
                    });
                }
            }
            if in_order.is_empty() && fix.is_some() {
                continue;
            }
            updates.push(running.advance(in_order.into_iter(), until_s, &self.settings)?);
        }
    }

    /// The smoother runs from now on: the records that the start took in no longer wait.
    fn started(&mut self, running: Box<Running>) {
        self.waits_for = None;
        let newest_s = self.newest_imu_s;
        self.waiting.retain(|record| record.time_s() > newest_s);
        let last = |times: Option<f64>| times.unwrap_or(f64::NEG_INFINITY);
        let streams = &running.streams;
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            self.taken_s[sensor] = last(fixes.last().map(|f| f.value.time_s));
        }
        let sensors = streams.positions.len();
        self.taken_s[sensors] = last(streams.heading.last().map(|f| f.value.time_s));
        self.stage = Stage::Running(running);
    }

    /// Whether the start has been made.
    pub fn is_running(&self) -> bool {
        matches!(self.stage, Stage::Running(_))
    }

    /// Why the last attempt to start failed; `None` before the first attempt, and once the smoother runs.
    pub fn waits_for(&self) -> Option<&str> {
        self.waits_for.as_deref()
    }

    /// Records refused so far, in the order in which they were refused.
    pub fn rejections(&self) -> &[Rejection] {
        match &self.stage {
            Stage::Starting { .. } => &[],
            Stage::Running(running) => &running.rejections,
        }
    }

    /// The trajectory so far: a pose at every IMU sample up to the newest node, smoothed by all
    /// records taken in, at the present linearisation points. The cost grows with the length of
    /// the drive.
    ///
    /// # Errors
    /// The start has not been made, or there is only one node.
    pub fn full(&mut self) -> Result<Trajectory> {
        match &mut self.stage {
            Stage::Running(running) => trajectory_so_far(running),
            Stage::Starting { .. } => Err(Error::of(
                Problem::TooFew,
                "there is no trajectory yet",
                "wait for the first update",
            )),
        }
    }

    /// Ends the drive: adjusts it as a whole, with the online estimates as start values. Every node is
    /// relinearised, every record is tested against all others, and the constants that the settings name
    /// are estimated.
    ///
    /// # Errors
    /// As for [`estimate`].
    pub fn finish(self, progress: &dyn Progress) -> Result<Estimate> {
        match self.stage {
            Stage::Running(running) => {
                finish(&self.received, *running, &self.project_settings, progress)
            }
            Stage::Starting { .. } => {
                estimate(&self.received.logs(), &self.project_settings, progress)
            }
        }
    }

    /// When the estimate was lost and followed the records again.
    pub fn jumps(&self) -> &[Jump] {
        match &self.stage {
            Stage::Starting { .. } => &[],
            Stage::Running(running) => &running.jumps,
        }
    }
}

/// The error of an IMU log that continues at another time.
fn leap(from_s: f64, to_s: f64) -> Error {
    let by_s = to_s - from_s;
    let problem = if by_s > 0.0 {
        format!("the IMU log has a gap of {by_s:.3} s from {from_s:.3} s to {to_s:.3} s")
    } else {
        format!(
            "the times of the IMU log go back by {:.3} s, from {from_s:.3} s to {to_s:.3} s",
            -by_s
        )
    };
    let remedy =
        format!("cut the drive there; gaps longer than {MAX_IMU_GAP_S} s cannot be bridged");
    Error::data(problem, remedy)
}

fn not_finite(log: &str, record: usize, time_s: f64) -> Error {
    Error::data(
        format!(
            "{log}: record {} at {time_s:.6} s holds a value that is not finite, or a standard \
             deviation that is not positive",
            record + 1
        ),
        "remove the record or correct the value",
    )
}
