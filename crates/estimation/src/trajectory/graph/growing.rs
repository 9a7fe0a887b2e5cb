//! A graph that grows step by step as the records arrive.
//!
//! No step begins at its last node yet: records at that node or after it wait for the step, and
//! [`Graph::newest_system`] gives their normal equations until then.

use super::build::imu_factor;
use super::context::FactorContext;
use super::factor_graph::Graph;
use crate::adjustment::{BorderSystem, ChainLayout, ChainProblem, StepSystem, assemble};
use crate::error::Result;
use crate::sensor::{HeadingFix, ImuBias, PositionFix};
use crate::trajectory::factors::ImuFactor;
use crate::trajectory::imu_series::ImuSeries;
use crate::trajectory::rest::Rest;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::states::{NodeState, State};
use crate::trajectory::streams::{Numbered, Streams};
use crate::trajectory::timeline::Timeline;
use nalgebra::SMatrix;
use std::ops::Range;

impl Graph {
    /// A graph with a single node at the first sample of the streams, and a pose at each sample.
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
            layout: ChainLayout::default(),
        };
        Self::without_steps(timeline, settings, first)
    }

    /// Adds the step from the newest node to a new one at `time_s`, which the IMU has reached; its
    /// motion is integrated about the bias `about`. With `begins`, a new bias begins at the newest node.
    /// The records that wait there become records of the step.
    ///
    /// # Errors
    /// An IMU noise whose covariance is not positive definite.
    pub fn push_step(
        &mut self,
        imu: &ImuSeries,
        time_s: f64,
        begins: bool,
        about: &ImuBias,
    ) -> Result<()> {
        let step = self.timeline.steps();
        let node_s = self.timeline.node_s[step];
        let layout = &mut self.timeline.layout.segment_of_step;
        match layout.last() {
            Some(&bias) => layout.push(bias + u32::from(begins)),
            None => layout.push(0),
        }
        if step > 0 && begins {
            self.timeline.bias_start_s.push(node_s);
        }
        self.timeline.node_s.push(time_s);
        let factor = imu_factor(&self.preintegrated(imu, step, about))?;
        self.imu.push(factor);
        self.position_start.push(self.positions.len() as u32);
        self.heading_start.push(self.headings.len() as u32);
        self.rests.push(None);
        Ok(())
    }

    /// Integrates the motion of a step again, about another bias. The factor stays as it is if the
    /// covariance is not positive definite.
    pub fn reintegrate(&mut self, imu: &ImuSeries, step: usize, about: &ImuBias) {
        if let Some(factor) = ImuFactor::new(&self.preintegrated(imu, step, about)) {
            self.imu[step] = factor;
        }
    }

    /// Lets the newest step jump: these standard deviations of rotation, position and velocity are added
    /// to that of its closing error.
    pub fn loosen_newest_step(&mut self, imu: &ImuSeries, about: &ImuBias, sigma: [f64; 3]) {
        let step = self.timeline.steps() - 1;
        let mut sums = self.preintegrated(imu, step, about);
        sums.covariance +=
            SMatrix::<f64, 9, 9>::from_diagonal(&nalgebra::SVector::<f64, 9>::from_fn(|i, _| {
                sigma[i / 3].powi(2)
            }));
        if let Some(factor) = ImuFactor::new(&sums) {
            self.imu[step] = factor;
        }
    }

    /// Adds a position; returns its step and its index among the positions.
    pub fn push_position(
        &mut self,
        context: &FactorContext<'_>,
        sensor: usize,
        fix: &Numbered<PositionFix>,
    ) -> (usize, usize) {
        let (step, after_node_s) = self.place(fix.value.time_s);
        let at = (self.timeline.node_s[step], after_node_s);
        let factor = context.position(sensor, fix, at);
        let places = insert(
            &mut self.positions,
            &mut self.position_start,
            step,
            vec![factor],
        );
        (step, places.start)
    }

    /// Adds a heading, and its pitch where it has one; returns the step and the indices.
    pub fn push_heading(
        &mut self,
        context: &FactorContext<'_>,
        fix: &Numbered<HeadingFix>,
    ) -> (usize, Range<usize>) {
        let (step, after_node_s) = self.place(fix.value.time_s);
        let at = (self.timeline.node_s[step], after_node_s);
        let factors = context.headings(fix, at);
        let places = insert(&mut self.headings, &mut self.heading_start, step, factors);
        (step, places)
    }

    /// Holds the velocity at zero at the nodes during `rest` at which a bias begins; returns the first
    /// step that was not held before.
    pub fn hold_rest(&mut self, rest: &Rest) -> Option<usize> {
        let node_s = &self.timeline.node_s;
        let first = node_s.partition_point(|&t| t < rest.from_s);
        let end = node_s.partition_point(|&t| t <= rest.to_s);
        let mut earliest = None;
        for step in first..end.min(self.timeline.steps()) {
            if self.rests[step].is_none() {
                self.rests[step] = self.rest_factor(step, std::slice::from_ref(rest));
                earliest = earliest.or(self.rests[step].map(|_| step));
            }
        }
        earliest
    }

    /// The normal equations of one step at `state`.
    pub fn step_system(&self, state: &State, step: usize) -> StepSystem {
        let (mut system, mut border) = (StepSystem::ZERO, BorderSystem::new(0));
        self.linearise(state, step, &mut system, &mut border);
        system
    }

    /// The normal equations of the records that wait at the newest node.
    pub fn newest_system(&self, state: &State) -> StepSystem {
        let (mut system, mut border) = (StepSystem::ZERO, BorderSystem::new(0));
        self.record_rows(state, self.timeline.steps(), |_, rows| {
            assemble(&rows, &mut system, &mut border);
        });
        system
    }
}

/// Adds factors to those of a step; returns their indices.
fn insert<F>(all: &mut Vec<F>, starts: &mut [u32], step: usize, factors: Vec<F>) -> Range<usize> {
    let count = factors.len();
    let at = starts.get(step + 1).map_or(all.len(), |&end| end as usize);
    all.splice(at..at, factors);
    for start in starts.iter_mut().skip(step + 1) {
        *start += count as u32;
    }
    at..at + count
}
