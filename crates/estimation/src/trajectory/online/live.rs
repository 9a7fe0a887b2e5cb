//! The online smoother: records in, poses out.
//!
//! Records are given as they come, each sensor's in its own time and order. The first seconds are
//! kept until they determine the attitude; from then on every position fix gives the newest pose.
//! The cost of an update does not depend on how long the drive has lasted.

use super::finish::{finish, trajectory_so_far};
use super::meeting::check_meeting;
use super::options::OnlineOptions;
use super::records::{Given, Record};
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
use crate::trajectory::streams::{
    Numbered, check_settings, check_value_of_fix, check_value_of_heading,
};
use crate::trajectory::timeline::MAX_STEP_S;
use std::collections::VecDeque;

/// Without a fix for so long a node is set by itself, seconds: late enough that a fix every second
/// comes first.
const MAX_WAIT_S: f64 = MAX_STEP_S + 0.25;
/// IMU stamps in a row that leap by more than a gap that can be bridged: after more, the log continues
/// there.
const MAX_LEAPS: usize = 10;

/// What the smoother is doing.
#[derive(Debug, Clone)]
enum Stage {
    /// Records are kept until they determine the attitude; tried again from this time on.
    Starting {
        next_s: f64,
    },
    Running(Box<Running>),
}

/// The online smoother.
#[derive(Debug, Clone)]
pub struct Online {
    /// As the project has them.
    asked: TrajectorySettings,
    /// Those that hold during the drive: constants are estimated at the end.
    settings: TrajectorySettings,
    options: OnlineOptions,
    given: Given,
    waiting: VecDeque<Record>,
    newest_imu_s: f64,
    leaps: usize,
    /// Time of the newest record of each position sensor that was taken in, and of the heading.
    taken_s: Vec<f64>,
    /// Of each, how many records in a row were far from the IMU's newest sample when they came.
    apart: Vec<usize>,
    scatter: Scatter,
    stage: Stage,
    waits_for: Option<String>,
}

impl Online {
    /// Before the first record.
    ///
    /// # Errors
    /// Settings that make no sense.
    pub fn new(settings: &TrajectorySettings, options: OnlineOptions) -> Result<Self> {
        let sensors = settings.positions.len();
        let given = Given {
            positions: vec![Vec::new(); sensors],
            ..Given::default()
        };
        check_settings(&given.logs(), settings)?;
        Ok(Self {
            asked: settings.clone(),
            settings: TrajectorySettings {
                nodes: Nodes::Prism,
                estimate: Vec::new(),
                ..settings.clone()
            },
            options: OnlineOptions {
                reach: options.reach.max(2),
                ..options
            },
            given,
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

    /// Takes a record of any sensor; the updates of the fixes that the IMU has reached.
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

    /// Takes an IMU sample; the updates of the fixes that it has reached.
    ///
    /// # Errors
    /// Values that are not finite, times that are not in seconds, a gap of minutes, times that go back by
    /// minutes, a trajectory that is not determined.
    pub fn imu(&mut self, sample: ImuSample) -> Result<Vec<Update>> {
        if !scatter::is_finite(&sample) {
            return Err(not_finite("IMU log", self.given.imu.len(), sample.time_s));
        }
        let record = self.given.imu.len();
        self.given.imu.push(sample);
        let ahead_s = sample.time_s - self.newest_imu_s;
        let leaps = ahead_s.abs() > MAX_IMU_GAP_S && record > 0;
        if ahead_s <= 0.0 || leaps {
            self.leaps = if leaps { self.leaps + 1 } else { 0 };
            if self.leaps > MAX_LEAPS {
                check_interval(median_interval_s(&self.given.imu))?;
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
                check_interval(median_interval_s(&self.given.imu))?;
            }
            Stage::Starting { .. } => {}
            Stage::Running(running) => running.sample(sample, &self.scatter, &self.settings.imu)?,
        }
        self.advance()
    }

    /// Takes a fix of a position sensor; updates where the IMU is there already.
    ///
    /// # Errors
    /// A sensor that the settings do not have, values that are not finite, a covariance that is
    /// none, fixes that do not meet the IMU, a trajectory that is not determined.
    pub fn position(&mut self, sensor: usize, fix: PositionFix) -> Result<Vec<Update>> {
        let Some(given) = self.given.positions.get_mut(sensor) else {
            return Err(Error::data(
                format!("a fix of position sensor {}", sensor + 1),
                format!("the settings have {}", self.settings.positions.len()),
            ));
        };
        if !(check_value_of_fix(&fix) && fix.time_s.is_finite()) {
            let name = format!("{} log", self.settings.positions[sensor].name);
            return Err(not_finite(&name, given.len(), fix.time_s));
        }
        let record = given.len();
        given.push(fix);
        if let Some(imu_s) = self.starting_s() {
            let name = format!("{} log", self.settings.positions[sensor].name);
            let fixes = &self.given.positions[sensor];
            check_meeting(&mut self.apart[sensor], imu_s, &name, fixes)?;
        }
        self.wait(Record::Position(sensor, Numbered { record, value: fix }));
        self.advance()
    }

    /// Takes a heading; it takes effect with the next update.
    ///
    /// # Errors
    /// Values that are not finite, headings that do not meet the IMU.
    pub fn heading(&mut self, fix: HeadingFix) -> Result<()> {
        let record = self.given.heading.len();
        if !(check_value_of_heading(&fix) && fix.time_s.is_finite()) {
            return Err(not_finite("heading log", record, fix.time_s));
        }
        self.given.heading.push(fix);
        if let (Some(imu_s), Some(apart)) = (self.starting_s(), self.apart.last_mut()) {
            check_meeting(apart, imu_s, "heading log", &self.given.heading)?;
        }
        self.wait(Record::Heading(Numbered { record, value: fix }));
        Ok(())
    }

    /// First and newest time of the IMU, if there are samples and the start has not been made.
    fn starting_s(&self) -> Option<(f64, f64)> {
        let first = self.given.imu.first().filter(|_| !self.is_running())?;
        Some((first.time_s, self.newest_imu_s))
    }

    fn wait(&mut self, record: Record) {
        let after = self
            .waiting
            .partition_point(|other| other.time_s() <= record.time_s());
        self.waiting.insert(after, record);
    }

    fn refuse(&mut self, sensor: String, record: usize, time_s: f64) {
        // What comes before the start is named by the start.
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

    /// Does what the records so far allow.
    fn advance(&mut self) -> Result<Vec<Update>> {
        let mut updates = Vec::new();
        if let Stage::Starting { next_s } = &mut self.stage {
            let first = self.given.imu.first();
            let Some(first) = first.filter(|_| self.newest_imu_s >= *next_s) else {
                return Ok(updates);
            };
            let first_s = first.time_s;
            // Later and later, so that all tries together cost no more than a few.
            *next_s = self.newest_imu_s + (0.25 * (self.newest_imu_s - first_s)).max(0.5);
            match start(&self.given, self.newest_imu_s, &self.settings, self.options)? {
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
            // All that is no later, fixes of other sensors at the same time included.
            let count = self
                .waiting
                .partition_point(|record| record.time_s() <= until_s + SAME_INSTANT_S);
            let mut fit = Vec::with_capacity(count);
            for record in self.waiting.drain(..count) {
                let (stream, number) = match &record {
                    Record::Position(sensor, fix) => (*sensor, fix.record),
                    Record::Heading(fix) => (self.taken_s.len() - 1, fix.record),
                };
                if record.time_s() > self.taken_s[stream] {
                    self.taken_s[stream] = record.time_s();
                    fit.push(record);
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
            if fit.is_empty() && fix.is_some() {
                continue;
            }
            updates.push(running.advance(fit.into_iter(), until_s, &self.settings)?);
        }
    }

    /// From now on the smoother runs: what it has taken in waits no more.
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

    /// Why the start has not been made, as of the last try; `None` before it, and once the smoother runs.
    pub fn waits_for(&self) -> Option<&str> {
        self.waits_for.as_deref()
    }

    /// Records refused so far, in the order in which that was seen.
    pub fn rejections(&self) -> &[Rejection] {
        match &self.stage {
            Stage::Starting { .. } => &[],
            Stage::Running(running) => &running.rejections,
        }
    }

    /// The trajectory so far: a pose at every IMU sample up to the newest node, smoothed by all
    /// records taken in, at the present linearisation points. Costs as much as the drive is long.
    ///
    /// # Errors
    /// The start has not been made, or there is a single node.
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

    /// The end of the drive: every node relinearised, every record tested with all others, the
    /// constants of the settings estimated: the adjustment of the whole drive, from the online
    /// estimates as start values.
    ///
    /// # Errors
    /// As for [`estimate`].
    pub fn finish(self, progress: &dyn Progress) -> Result<Estimate> {
        match self.stage {
            Stage::Running(running) => finish(&self.given, *running, &self.asked, progress),
            Stage::Starting { .. } => estimate(&self.given.logs(), &self.asked, progress),
        }
    }

    /// Where the estimate was lost and followed the records again.
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
        "remove the record or mend the value",
    )
}
