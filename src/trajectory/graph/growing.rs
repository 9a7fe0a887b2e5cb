//! A graph that grows step by step with the records as they come.
//!
//! Its last node bounds no step yet: records at that node or after it wait in the step to come,
//! and [`Graph::newest_system`] says what they mean for the node until then.

use super::Graph;
use super::adjustment::{PRIOR_SIGMA, per_unknown};
use crate::error::{Error, Result};
use crate::sensor::{HeadingFix, ImuBias, ImuSample, PositionFix};
use crate::trajectory::TrajectorySettings;
use crate::trajectory::chain::{Border, ChainLayout, PriorSystem, StepSystem};
use crate::trajectory::constants::Constants;
use crate::trajectory::factors::{ImuFactor, NodeState, RestFactor};
use crate::trajectory::graph::State;
use crate::trajectory::preintegration::Preintegrated;
use crate::trajectory::rest::Rest;
use crate::trajectory::streams::{Numbered, Streams};
use crate::trajectory::timeline::Timeline;
use nalgebra::SMatrix;

impl Graph {
    /// Of a single node at the first sample of the streams, with their IMU samples.
    pub fn growing(
        streams: &Streams,
        settings: &TrajectorySettings,
        first: (NodeState, ImuBias),
    ) -> Self {
        let pose_s: Vec<f64> = streams.imu.iter().map(|s| s.time_s).collect();
        let timeline = Timeline {
            node_s: vec![pose_s[0]],
            bias_start_s: vec![pose_s[0]],
            pose_s,
            layout: ChainLayout {
                bias_of_step: Vec::new(),
            },
        };
        let known = Constants::new(settings, &[]);
        Self {
            sensors: super::position_sensors(settings, &known),
            samples: streams.imu.clone(),
            bridged: streams.bridged.clone(),
            noise: settings.imu,
            bridge_noise: streams.bridge_noise,
            imu: Vec::new(),
            imu_scale: 1.0,
            positions: Vec::new(),
            position_start: vec![0],
            headings: Vec::new(),
            heading_start: vec![0],
            rests: Vec::new(),
            known,
            first,
            timeline,
        }
    }

    /// One more IMU sample, later than all before.
    pub fn push_sample(&mut self, sample: ImuSample, bridged: bool) {
        self.timeline.pose_s.push(sample.time_s);
        self.samples.push(sample);
        self.bridged.push(bridged);
    }

    /// Noise of samples that bridge gaps from now on.
    pub fn set_bridge_noise(&mut self, noise: crate::trajectory::ImuNoise) {
        self.bridge_noise = noise;
    }

    /// The step from the newest node to a new one at `time_s`, which the IMU has reached; its
    /// motion is summed up about `about`. A new bias begins at the newest node where `begins`.
    /// The records that wait at the newest node become the step's.
    ///
    /// # Errors
    /// An IMU noise that makes no positive definite covariance.
    pub fn push_step(&mut self, time_s: f64, begins: bool, about: &ImuBias) -> Result<()> {
        let step = self.timeline.steps();
        let node_s = self.timeline.node_s[step];
        let layout = &mut self.timeline.layout.bias_of_step;
        match layout.last() {
            Some(&bias) => layout.push(bias + u32::from(begins)),
            None => layout.push(0),
        }
        if step > 0 && begins {
            self.timeline.bias_start_s.push(node_s);
        }
        self.timeline.node_s.push(time_s);
        let factor = ImuFactor::new(&self.preintegrated(step, about));
        self.imu.push(factor.ok_or_else(|| {
            Error::data(
                "the IMU noise makes no positive definite covariance",
                "check the IMU's noise densities",
            )
        })?);
        self.position_start.push(self.positions.len() as u32);
        self.heading_start.push(self.headings.len() as u32);
        self.rests.push(None);
        Ok(())
    }

    /// Sums up the motion of a step about another bias, where the noise allows.
    pub fn sum_anew(&mut self, step: usize, about: &ImuBias) {
        if let Some(factor) = ImuFactor::new(&self.preintegrated(step, about)) {
            self.imu[step] = factor;
        }
    }

    /// Lets the newest step jump: its closing error may be larger by these standard deviations of
    /// rotation, position and velocity.
    pub fn loosen_newest_step(&mut self, about: &ImuBias, sigma: [f64; 3]) {
        let step = self.timeline.steps() - 1;
        let mut sums = self.preintegrated(step, about);
        sums.covariance +=
            SMatrix::<f64, 9, 9>::from_diagonal(&nalgebra::SVector::<f64, 9>::from_fn(|i, _| {
                sigma[i / 3].powi(2)
            }));
        if let Some(factor) = ImuFactor::new(&sums) {
            self.imu[step] = factor;
        }
    }

    /// The step that holds `time_s`, and how long after its node; the step to come where that is
    /// at the newest node or later.
    pub fn place(&self, time_s: f64) -> (usize, f64) {
        use crate::trajectory::timeline::SAME_INSTANT_S;
        let after = self
            .timeline
            .node_s
            .partition_point(|&t| t <= time_s + SAME_INSTANT_S);
        let step = after.saturating_sub(1);
        let rest_s = time_s - self.timeline.node_s[step];
        let exact = rest_s.abs() <= SAME_INSTANT_S;
        (step, if exact { 0.0 } else { rest_s })
    }

    /// Adds a position; its step and its place among the positions.
    pub fn push_position(
        &mut self,
        sensor: usize,
        fix: &Numbered<PositionFix>,
        settings: &TrajectorySettings,
        about: &ImuBias,
    ) -> (usize, usize) {
        let (step, rest_s) = self.place(fix.value.time_s);
        let factor = self.position_factor(sensor, fix, settings, (step, rest_s), about);
        let at = self
            .position_start
            .get(step + 1)
            .map_or(self.positions.len(), |&end| end as usize);
        self.positions.insert(at, factor);
        for start in self.position_start.iter_mut().skip(step + 1) {
            *start += 1;
        }
        (step, at)
    }

    /// Adds a heading, and its pitch where it has one; its step and the places.
    pub fn push_heading(
        &mut self,
        fix: &Numbered<HeadingFix>,
        settings: &TrajectorySettings,
        about: &ImuBias,
    ) -> (usize, std::ops::Range<usize>) {
        let (step, rest_s) = self.place(fix.value.time_s);
        let factors = self.heading_factors(fix, settings, (step, rest_s), about);
        let at = self
            .heading_start
            .get(step + 1)
            .map_or(self.headings.len(), |&end| end as usize);
        let count = factors.len();
        self.headings.splice(at..at, factors);
        for start in self.heading_start.iter_mut().skip(step + 1) {
            *start += count as u32;
        }
        (step, at..at + count)
    }

    /// Holds the velocity at the nodes of these steps at which the body rests and a bias begins;
    /// the first of them that is new.
    pub fn rest(&mut self, rest: &Rest) -> Option<usize> {
        let node_s = &self.timeline.node_s;
        let first = node_s.partition_point(|&t| t < rest.from_s);
        let end = node_s.partition_point(|&t| t <= rest.to_s);
        let mut earliest = None;
        for step in first..end.min(self.timeline.steps()) {
            let time_s = self.timeline.node_s[step];
            let begins = step == 0 || self.timeline.layout.changes_before(step);
            if begins && rest.holds_at(time_s) && self.rests[step].is_none() {
                self.rests[step] = Some(RestFactor {
                    sigma_m_s: Rest::SIGMA_M_S,
                });
                earliest = earliest.or(Some(step));
            }
        }
        earliest
    }

    /// The normal equations of one step at `state`.
    pub fn step_system(&self, state: &State, step: usize) -> StepSystem {
        let (mut system, mut border) = (StepSystem::ZERO, Border::new(0));
        self.linearise(state, step, &mut system, &mut border);
        system
    }

    /// The normal equations of the records that wait at the newest node, under the bias `bias`.
    pub fn newest_system(&self, state: &State, bias: &ImuBias) -> StepSystem {
        let (mut system, mut border) = (StepSystem::ZERO, Border::new(0));
        let node = &state.nodes[self.timeline.steps()];
        let at = (node, bias, state.constants.as_slice());
        let waiting = |starts: &[u32]| starts[starts.len() - 1] as usize;
        for fix in &self.positions[waiting(&self.position_start)..] {
            let sensor = &self.sensors[fix.sensor];
            fix.add_to(&mut system, &mut border, sensor, &self.known, at);
        }
        for fix in &self.headings[waiting(&self.heading_start)..] {
            fix.add_to(&mut system, &mut border, &self.known, at);
        }
        system
    }

    /// The prior at `state`.
    pub fn prior(&self, state: &State) -> PriorSystem {
        let weight = per_unknown(PRIOR_SIGMA).map(|s| 1.0 / (s * s));
        let miss = self.prior_miss(state);
        // The derivative of the attitude's miss is the identity to first order of the miss, and
        // the prior's weight is small: no more is needed.
        PriorSystem {
            weight,
            g: std::array::from_fn(|i| -weight[i] * miss[i]),
        }
    }
}

impl Graph {
    /// Motion and bias at any time, by the IMU from the node before.
    pub fn state_at(&self, state: &State, time_s: f64) -> (NodeState, ImuBias) {
        let (step, rest_s) = self.place(time_s.max(self.timeline.node_s[0]));
        let bias = match self.timeline.layout.bias_of_step.get(step) {
            Some(&bias) => state.biases[bias as usize],
            None => state.biases[state.biases.len() - 1],
        };
        let from = &state.nodes[step];
        if rest_s == 0.0 {
            return (*from, bias);
        }
        let mut sums = Preintegrated::new(bias);
        for piece in self.timeline.pieces(self.timeline.node_s[step], time_s) {
            let sample = &self.samples[piece.sample];
            let noise = self.noise_of(piece.sample);
            sums.add(
                sample.gyro_rad_s,
                sample.accel_m_s2,
                piece.duration_s,
                noise,
            );
        }
        let gravity_m_s2 = self.known.gravity_m_s2(&state.constants);
        (sums.sums.lead(&bias, gravity_m_s2, from), bias)
    }
}
