//! The smoother at work: records in time order become factors.

use super::gate::{Gate, Verdict, innovation};
use super::rests::RestWatch;
use super::smoother::{Smoother, Work};
use super::{Jump, Record, Update};
use crate::error::Result;
use crate::geometry::{Mat3, WorldFromBody};
use crate::sensor::{HeadingFix, ImuBias, PoseRecord, PoseSigma, PositionFix};
use crate::trajectory::TrajectorySettings;
use crate::trajectory::chain::TAIL;
use crate::trajectory::factors::NodeState;
use crate::trajectory::marginals::tail_covariance;
use crate::trajectory::solution::{Rejection, RejectionReason};
use crate::trajectory::streams::{Names, Numbered, Stream, Streams};
use crate::trajectory::timeline::{LONGEST_STEP_S, SAME_INSTANT_S};

/// Where a node is linearised whose start value is known.
pub(super) type Guess<'a> = dyn Fn(f64) -> (NodeState, ImuBias) + 'a;

/// Everything after the start.
#[derive(Debug, Clone)]
pub(super) struct Running {
    pub smoother: Smoother,
    /// What has been taken in, in time order.
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

    /// Nodes, no farther apart than allowed, until one is within the longest step of `time_s`.
    pub fn bridge_to(&mut self, time_s: f64, guess: Option<&Guess<'_>>) -> Result<()> {
        loop {
            let newest_s = self.smoother.newest_s();
            if time_s - newest_s <= LONGEST_STEP_S + SAME_INSTANT_S {
                return Ok(());
            }
            // At a sample, where it is not too near.
            let samples = &self.smoother.graph.timeline.pose_s;
            let after =
                samples.partition_point(|&t| t <= newest_s + LONGEST_STEP_S + SAME_INSTANT_S);
            let near_s = newest_s + 0.5 * LONGEST_STEP_S;
            let at_s = match samples[..after].last() {
                Some(&sample_s) if sample_s > near_s => sample_s,
                _ => newest_s + LONGEST_STEP_S,
            };
            self.node(at_s, guess)?;
        }
    }

    /// A new node.
    fn node(&mut self, time_s: f64, guess: Option<&Guess<'_>>) -> Result<()> {
        let step = self.smoother.steps();
        let timeline = &self.smoother.graph.timeline;
        let held_s =
            self.smoother.newest_s() - timeline.bias_start_s[timeline.bias_start_s.len() - 1];
        let begins = held_s > 0.0 && (self.fixed || held_s >= LONGEST_STEP_S);
        if begins || step == 0 {
            self.fixed = false;
        }
        let guess = guess.map(|guess| guess(time_s));
        self.smoother.append(time_s, begins, guess.as_ref())
    }

    /// A node at a fix, unless one is as near as half a sample.
    pub fn node_at_fix(&mut self, time_s: f64, guess: Option<&Guess<'_>>) -> Result<()> {
        self.bridge_to(time_s, guess)?;
        let samples = &self.smoother.graph.timeline.pose_s;
        let sample = samples.partition_point(|&t| t < time_s - SAME_INSTANT_S);
        let time_s = match samples.get(sample) {
            Some(&at_s) if (at_s - time_s).abs() < SAME_INSTANT_S => at_s,
            _ => time_s,
        };
        if time_s > self.smoother.newest_s() + 0.5 * self.streams.interval_s {
            self.node(time_s, guess)?;
        }
        Ok(())
    }

    /// Takes a position in; at its weight where that is known, else as the innovation test says.
    pub fn position(
        &mut self,
        sensor: usize,
        fix: &Numbered<PositionFix>,
        settings: &TrajectorySettings,
        weight: Option<f64>,
    ) -> Result<()> {
        let (step, _) = self.smoother.graph.place(fix.value.time_s);
        if step < self.smoother.reach() {
            self.late(
                Stream::Position(sensor),
                fix.record,
                fix.value.time_s,
                settings,
            );
            return Ok(());
        }
        self.streams.positions[sensor].push(*fix);
        self.fixed |= step >= self.smoother.steps();
        let bias = self.smoother.bias(step);
        let graph = &mut self.smoother.graph;
        let (_, at) = graph.push_position(sensor, fix, settings, &bias);
        let weight = match weight {
            Some(weight) => weight,
            None => {
                let node = self.smoother.node(step);
                let graph = &self.smoother.graph;
                let (known, place) = (&graph.known, &graph.sensors[sensor]);
                let factor = &graph.positions[at];
                let (rows, _, residual) = factor.rows(place, known, &node, &bias, &[]);
                let missed_m = factor
                    .residual(place, known.gravity_m_s2(&[]), &node, &bias, &[])
                    .norm();
                let square = innovation(&rows, &residual, &self.covariance());
                let verdict = self.positions[sensor].judge(square, fix.value.time_s);
                let stream = Stream::Position(sensor);
                let named = (stream, fix.record, fix.value.time_s);
                self.consequence(verdict, named, square, [0.0, missed_m, 0.0], settings)
            }
        };
        self.smoother.graph.positions[at].weight = weight;
        self.smoother.touch(step);
        Ok(())
    }

    /// Takes a heading in, likewise.
    pub fn heading(
        &mut self,
        fix: &Numbered<HeadingFix>,
        settings: &TrajectorySettings,
        weight: Option<f64>,
    ) -> Result<()> {
        let (step, _) = self.smoother.graph.place(fix.value.time_s);
        if step < self.smoother.reach() {
            self.late(Stream::Heading, fix.record, fix.value.time_s, settings);
            return Ok(());
        }
        self.streams.heading.push(*fix);
        let bias = self.smoother.bias(step);
        let (_, range) = self.smoother.graph.push_heading(fix, settings, &bias);
        for at in range {
            let weight = match weight {
                Some(weight) => weight,
                None => {
                    let node = self.smoother.node(step);
                    let graph = &self.smoother.graph;
                    let factor = &graph.headings[at];
                    let (rows, _, residual) = factor.rows(&graph.known, &node, &bias, &[]);
                    let missed_rad = residual[0].abs() * factor.sigma_rad;
                    let square = innovation(&rows, &residual, &self.covariance());
                    let verdict = self.heading.judge(square, fix.value.time_s);
                    let named = (Stream::Heading, fix.record, fix.value.time_s);
                    self.consequence(verdict, named, square, [missed_rad, 0.0, 0.0], settings)
                }
            };
            self.smoother.graph.headings[at].weight = weight;
        }
        self.smoother.touch(step);
        Ok(())
    }

    /// The weight of a judged record; names it where it is refused, and lets the estimate jump by
    /// what it misses the record where it follows.
    fn consequence(
        &mut self,
        verdict: Verdict,
        (stream, record, time_s): (Stream, usize, f64),
        square: f64,
        missed: [f64; 3],
        settings: &TrajectorySettings,
    ) -> f64 {
        let sensor = Names(settings).sensor(stream);
        match verdict {
            Verdict::Accept => 1.0,
            Verdict::Refuse => {
                self.rejections.push(Rejection {
                    sensor,
                    record: record + 1,
                    time_s,
                    reason: RejectionReason::Outlier,
                    normalised: Some(square.sqrt()),
                });
                0.0
            }
            Verdict::Follow => {
                self.smoother.loosen_newest_step(missed);
                self.jumps.push(Jump { sensor, time_s });
                1.0
            }
        }
    }

    fn late(&mut self, stream: Stream, record: usize, time_s: f64, settings: &TrajectorySettings) {
        self.rejections.push(Rejection {
            sensor: Names(settings).sensor(stream),
            record: record + 1,
            time_s,
            reason: RejectionReason::Late,
            normalised: None,
        });
    }

    /// Of the newest node and bias.
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
        let (rejected, jumped) = (self.rejections.len(), self.jumps.len());
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
        if until_s - self.smoother.newest_s() >= LONGEST_STEP_S {
            self.bridge_to(until_s, None)?;
            self.node_at_fix(until_s, None)?;
        }
        let node_s = self.smoother.newest_s();
        if settings.zero_velocity {
            while let Some(rest) = self.rests.seen(&self.streams, settings, node_s) {
                if let Some(step) = self.smoother.graph.rest(&rest) {
                    // Steps out of reach keep what they have.
                    self.smoother.touch(step.max(self.smoother.reach()));
                }
            }
        }
        let work = self.smoother.update()?;
        Ok(self.told(work, rejected, jumped))
    }

    /// The newest pose, and what has been refused since.
    pub fn told(&self, work: Work, rejected: usize, jumped: usize) -> Update {
        let step = self.smoother.steps();
        let node = self.smoother.node(step);
        let sigma = self.covariance();
        let block = |at: usize| Mat3::from_fn(|a, b| sigma[at + a][at + b]);
        let world = node.rotation.to_rotation_matrix();
        let rotation = world.matrix() * block(0) * world.matrix().transpose();
        let root = |m: &Mat3| m.diagonal().map(|x| x.max(0.0).sqrt());
        Update {
            pose: PoseRecord {
                time_s: self.smoother.newest_s(),
                world_from_body: WorldFromBody::new(node.rotation, node.position_m),
                velocity_m_s: Some(node.velocity_m_s),
                bias: Some(self.smoother.bias(step)),
                sigma: Some(PoseSigma {
                    position_m: root(&block(3)),
                    rotation_rad: root(&rotation),
                }),
            },
            relinearised: work.relinearised,
            eliminated: work.eliminated,
            rejected: self.rejections[rejected..].to_vec(),
            jumps: self.jumps[jumped..].to_vec(),
        }
    }
}
