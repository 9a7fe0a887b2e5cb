//! The running smoother: records in time order become factors.

use super::gate::{Decision, Gate, innovation};
use super::records::{Record, RecordId};
use super::rests::RestWatch;
use super::scatter::Scatter;
use super::smoother::{Smoother, Work};
use super::update::{Jump, Update};
use crate::adjustment::{TAIL, tail_covariance};
use crate::error::Result;
use crate::geometry::Mat3;
use crate::sensor::{HeadingFix, ImuBias, ImuSample, PoseRecord, PoseSigma, PositionFix};
use crate::trajectory::gaps::{GAP_INTERVALS, bridged_samples, bridging_samples, check_bridging};
use crate::trajectory::graph::FactorContext;
use crate::trajectory::imu_series::SAME_INSTANT_S;
use crate::trajectory::logs::Stream;
use crate::trajectory::settings::{ImuNoise, TrajectorySettings};
use crate::trajectory::solution::{Rejection, RejectionReason};
use crate::trajectory::states::NodeState;
use crate::trajectory::streams::{Names, Numbered, Streams};
use crate::trajectory::timeline::MAX_STEP_S;

/// Start values of motion and bias at a time, where they are known.
pub type Guess<'a> = dyn Fn(f64) -> (NodeState, ImuBias) + 'a;

/// Everything after the start.
#[derive(Debug, Clone)]
pub struct Running {
    pub smoother: Smoother,
    /// The records taken in, in time order.
    pub streams: Streams,
    pub rejections: Vec<Rejection>,
    pub jumps: Vec<Jump>,
    positions: Vec<Gate>,
    heading: Gate,
    pub rests: RestWatch,
    /// Whether a fix has come since the newest bias began.
    fixed: bool,
}

impl Running {
    pub fn new(smoother: Smoother, streams: Streams, settings: &TrajectorySettings) -> Self {
        let positions = settings.positions.iter();
        Self {
            rests: RestWatch::new(streams.imu[0].time_s),
            rejections: streams.dropped.clone(),
            smoother,
            streams,
            jumps: Vec::new(),
            positions: positions.map(|p| Gate::new(p.loss, 3.0)).collect(),
            heading: Gate::new(settings.heading.loss, 1.0),
            fixed: false,
        }
    }

    /// Takes a sample that is later than all before it, and adds those that bridge a gap before it.
    ///
    /// # Errors
    /// Gaps that would take too many samples to bridge.
    pub fn sample(&mut self, sample: ImuSample, scatter: &Scatter, noise: &ImuNoise) -> Result<()> {
        let last = self.streams.imu[self.streams.imu.len() - 1];
        let interval_s = self.streams.imu.interval_s;
        let gap_s = sample.time_s - last.time_s;
        if gap_s > GAP_INTERVALS * interval_s {
            let recorded = scatter.count();
            let bridging = self.streams.imu.len().saturating_sub(recorded);
            check_bridging(bridging + bridging_samples(gap_s, interval_s), recorded)?;
            let imu = &mut self.streams.imu;
            imu.gaps_s.push((last.time_s + interval_s, sample.time_s));
            imu.set_bridge_noise(scatter.bridge_noise(noise));
            for between in bridged_samples(&last, &sample, interval_s) {
                self.push(between, true);
            }
        }
        self.push(sample, false);
        Ok(())
    }

    fn push(&mut self, sample: ImuSample, bridged: bool) {
        self.streams.imu.push(sample, bridged);
        self.smoother.graph.timeline.pose_s.push(sample.time_s);
    }

    /// Adds nodes, no farther apart than allowed, until the newest is within the longest step of `time_s`.
    pub fn bridge_to(&mut self, time_s: f64, guess: Option<&Guess<'_>>) -> Result<()> {
        loop {
            let newest_s = self.smoother.newest_s();
            if time_s - newest_s <= MAX_STEP_S + SAME_INSTANT_S {
                return Ok(());
            }
            // At a sample, unless it is too near the newest node.
            let samples = &self.smoother.graph.timeline.pose_s;
            let after = samples.partition_point(|&t| t <= newest_s + MAX_STEP_S + SAME_INSTANT_S);
            let near_s = newest_s + 0.5 * MAX_STEP_S;
            let at_s = match samples[..after].last() {
                Some(&sample_s) if sample_s > near_s => sample_s,
                _ => newest_s + MAX_STEP_S,
            };
            self.node(at_s, guess)?;
        }
    }

    /// Adds a node.
    fn node(&mut self, time_s: f64, guess: Option<&Guess<'_>>) -> Result<()> {
        let step = self.smoother.steps();
        let timeline = &self.smoother.graph.timeline;
        let held_s =
            self.smoother.newest_s() - timeline.bias_start_s[timeline.bias_start_s.len() - 1];
        let begins = held_s > 0.0 && (self.fixed || held_s >= MAX_STEP_S);
        if begins || step == 0 {
            self.fixed = false;
        }
        let guess = guess.map(|guess| guess(time_s));
        self.smoother
            .append(&self.streams.imu, time_s, begins, guess.as_ref())
    }

    /// Adds a node at a fix, unless the newest is as near as half the interval between samples.
    pub fn node_at_fix(&mut self, time_s: f64, guess: Option<&Guess<'_>>) -> Result<()> {
        self.bridge_to(time_s, guess)?;
        let samples = &self.smoother.graph.timeline.pose_s;
        let sample = samples.partition_point(|&t| t < time_s - SAME_INSTANT_S);
        let time_s = match samples.get(sample) {
            Some(&at_s) if (at_s - time_s).abs() < SAME_INSTANT_S => at_s,
            _ => time_s,
        };
        if time_s > self.smoother.newest_s() + 0.5 * self.streams.imu.interval_s {
            self.node(time_s, guess)?;
        }
        Ok(())
    }

    /// Takes a position in, with this weight or, without one, with that of the innovation test.
    pub fn position(
        &mut self,
        sensor: usize,
        fix: &Numbered<PositionFix>,
        settings: &TrajectorySettings,
        weight: Option<f64>,
    ) -> Result<()> {
        let at = RecordId {
            stream: Stream::Position(sensor),
            record: fix.record,
            time_s: fix.value.time_s,
        };
        let (step, _) = self.smoother.graph.place(fix.value.time_s);
        if step < self.smoother.reach() {
            self.refuse(at, RejectionReason::Late, settings);
            return Ok(());
        }
        self.streams.positions[sensor].push(*fix);
        self.fixed |= step >= self.smoother.steps();
        let (node, bias) = (self.smoother.node(step), self.smoother.bias(step));
        let constants = &self.smoother.state.constants;
        let context = FactorContext {
            imu: &self.streams.imu,
            settings,
            constants,
            about: &bias,
        };
        let graph = &mut self.smoother.graph;
        let (_, place) = graph.push_position(&context, sensor, fix);
        let weight = match weight {
            Some(weight) => weight,
            None => {
                let (factor, sensors) = (&graph.positions[place], &graph.sensors);
                let rows = factor.rows(&sensors[sensor], constants, &node, &bias);
                let missed_m = factor.residual(&sensors[sensor], constants, &node, &bias);
                let missed = [0.0, missed_m.norm(), 0.0];
                let square = innovation(&rows, &self.covariance());
                let decision = self.positions[sensor].test(square, fix.value.time_s);
                self.consequence(decision, at, square, missed, settings)
            }
        };
        self.smoother.graph.positions[place].weight = weight;
        self.smoother.touch(step);
        Ok(())
    }

    /// Takes a heading in, with this weight or, without one, with that of the innovation test.
    pub fn heading(
        &mut self,
        fix: &Numbered<HeadingFix>,
        settings: &TrajectorySettings,
        weight: Option<f64>,
    ) -> Result<()> {
        let at = RecordId {
            stream: Stream::Heading,
            record: fix.record,
            time_s: fix.value.time_s,
        };
        let (step, _) = self.smoother.graph.place(fix.value.time_s);
        if step < self.smoother.reach() {
            self.refuse(at, RejectionReason::Late, settings);
            return Ok(());
        }
        self.streams.heading.push(*fix);
        let bias = self.smoother.bias(step);
        let context = FactorContext {
            imu: &self.streams.imu,
            settings,
            constants: &self.smoother.state.constants,
            about: &bias,
        };
        let (_, places) = self.smoother.graph.push_heading(&context, fix);
        for place in places {
            let weight = match weight {
                Some(weight) => weight,
                None => {
                    let node = self.smoother.node(step);
                    let factor = &self.smoother.graph.headings[place];
                    let rows = factor.rows(&self.smoother.state.constants, &node, &bias);
                    let missed = [rows.residual[0].abs() * factor.sigma_rad, 0.0, 0.0];
                    let square = innovation(&rows, &self.covariance());
                    let decision = self.heading.test(square, fix.value.time_s);
                    self.consequence(decision, at, square, missed, settings)
                }
            };
            self.smoother.graph.headings[place].weight = weight;
        }
        self.smoother.touch(step);
        Ok(())
    }

    /// The weight of a tested record. A refused one is listed. Where the estimate has to follow, it may jump
    /// by `missed`, its distances from the record in rotation, position and velocity.
    fn consequence(
        &mut self,
        decision: Decision,
        at: RecordId,
        square: f64,
        missed: [f64; 3],
        settings: &TrajectorySettings,
    ) -> f64 {
        let sensor = Names(settings).sensor(at.stream);
        match decision {
            Decision::Accept => 1.0,
            Decision::Refuse => {
                self.rejections.push(Rejection {
                    sensor,
                    record: at.record + 1,
                    time_s: at.time_s,
                    reason: RejectionReason::Outlier,
                    normalised: Some(square.sqrt()),
                });
                0.0
            }
            Decision::Follow => {
                self.smoother.loosen_newest_step(&self.streams.imu, missed);
                self.jumps.push(Jump {
                    sensor,
                    time_s: at.time_s,
                });
                1.0
            }
        }
    }

    /// Lists a record that is not used.
    pub fn refuse(&mut self, at: RecordId, reason: RejectionReason, settings: &TrajectorySettings) {
        self.rejections.push(Rejection {
            sensor: Names(settings).sensor(at.stream),
            record: at.record + 1,
            time_s: at.time_s,
            reason,
            normalised: None,
        });
    }

    /// The covariance of the newest node and bias.
    fn covariance(&self) -> [[f64; TAIL]; TAIL] {
        tail_covariance(&self.smoother.factor.tail().0.rows)
    }

    /// Takes in the waiting records up to `until_s`, in time order, with a node at the last fix or
    /// at `until_s`, and updates.
    pub fn advance(
        &mut self,
        records: impl Iterator<Item = Record>,
        until_s: f64,
        settings: &TrajectorySettings,
    ) -> Result<Update> {
        let (first_rejection, first_jump) = (self.rejections.len(), self.jumps.len());
        for record in records {
            match record {
                Record::Position(sensor, fix) => {
                    self.node_at_fix(fix.value.time_s, None)?;
                    // The test needs the prediction at the new node.
                    self.smoother.eliminate()?;
                    self.position(sensor, &fix, settings, None)?;
                }
                Record::Heading(fix) => {
                    self.bridge_to(fix.value.time_s, None)?;
                    self.smoother.eliminate()?;
                    self.heading(&fix, settings, None)?;
                }
            }
        }
        if until_s - self.smoother.newest_s() >= MAX_STEP_S {
            self.bridge_to(until_s, None)?;
            self.node_at_fix(until_s, None)?;
        }
        let node_s = self.smoother.newest_s();
        if settings.zero_velocity {
            self.hold_rests(settings, node_s);
        }
        let work = self.update()?;
        Ok(self.newest(work, first_rejection, first_jump))
    }

    /// Holds the velocity at zero at the nodes up to `until_s` at which the body rested.
    pub fn hold_rests(&mut self, settings: &TrajectorySettings, until_s: f64) {
        while let Some(rest) = self.rests.next_rest(&self.streams, settings, until_s) {
            if let Some(step) = self.smoother.graph.hold_rest(&rest) {
                // Steps out of reach keep what they have.
                self.smoother.touch(step.max(self.smoother.reach()));
            }
        }
    }

    /// Brings the estimate up to date.
    pub fn update(&mut self) -> Result<Work> {
        self.smoother.update(&self.streams.imu)
    }

    /// The newest pose, with the rejections and jumps from these numbers on.
    pub fn newest(&self, work: Work, first_rejection: usize, first_jump: usize) -> Update {
        let step = self.smoother.steps();
        let node = self.smoother.node(step);
        let sigma = self.covariance();
        let block = |at: usize| Mat3::from_fn(|a, b| sigma[at + a][at + b]);
        let world = node.world_from_body.rotation.to_rotation_matrix();
        let rotation = world.matrix() * block(0) * world.matrix().transpose();
        let root = |m: &Mat3| m.diagonal().map(|x| x.max(0.0).sqrt());
        Update {
            pose: PoseRecord {
                time_s: self.smoother.newest_s(),
                world_from_body: node.world_from_body,
                velocity_m_s: Some(node.velocity_m_s),
                bias: Some(self.smoother.bias(step)),
                sigma: Some(PoseSigma {
                    position_m: root(&block(3)),
                    rotation_rad: root(&rotation),
                }),
            },
            relinearised: work.relinearised,
            eliminated: work.eliminated,
            rejected: self.rejections[first_rejection..].to_vec(),
            jumps: self.jumps[first_jump..].to_vec(),
        }
    }
}
