//! The factors of one drive, step by step.

use crate::sensor::ImuBias;
use crate::trajectory::constants::Constants;
use crate::trajectory::factors::{
    HeadingFactor, ImuFactor, PositionFactor, PositionSensor, RestFactor,
};
use crate::trajectory::imu_series::{ImuSeries, SAME_INSTANT_S};
use crate::trajectory::logs::Stream;
use crate::trajectory::motion_sums::MotionSums;
use crate::trajectory::settings::ImuNoise;
use crate::trajectory::states::{NodeState, State};
use crate::trajectory::timeline::Timeline;
use std::ops::Range;

/// The factor graph.
#[derive(Debug, Clone)]
pub struct Graph {
    pub timeline: Timeline,
    /// Noise of the IMU.
    pub noise: ImuNoise,
    /// One for each step.
    pub imu: Vec<ImuFactor>,
    /// Factor on the standard deviations of the IMU.
    pub imu_scale: f64,
    /// Sorted by step.
    pub positions: Vec<PositionFactor>,
    pub(super) position_start: Vec<u32>,
    pub headings: Vec<HeadingFactor>,
    pub(super) heading_start: Vec<u32>,
    /// For each step, the factor of a body that rests at its node, if a bias begins there.
    pub rests: Vec<Option<RestFactor>>,
    pub sensors: Vec<PositionSensor>,
    /// Centre of the priors.
    pub(super) first: (NodeState, ImuBias),
}

impl Graph {
    /// The position factors of a step.
    pub fn positions_of(&self, step: usize) -> &[PositionFactor] {
        &self.positions[range(&self.position_start, self.positions.len(), step)]
    }

    /// The heading and pitch factors of a step.
    pub fn headings_of(&self, step: usize) -> &[HeadingFactor] {
        &self.headings[range(&self.heading_start, self.headings.len(), step)]
    }

    /// The bias in force in a step; in the step that is not complete yet, the newest.
    pub fn bias<'s>(&self, state: &'s State, step: usize) -> &'s ImuBias {
        &state.biases[self.timeline.layout.segment(step)]
    }

    /// Assigns to each record the clocks that apply to it.
    pub fn set_clocks(&mut self, constants: &Constants) {
        for fix in &mut self.positions {
            let stream = Stream::Position(fix.sensor);
            fix.clocks = constants.clocks_of(stream, fix.record, fix.time_s);
        }
        for fix in &mut self.headings {
            fix.clocks = constants.clocks_of(Stream::Heading, fix.record, fix.time_s);
        }
    }

    /// The step that contains `time_s`, and the time since its node, seconds. At the newest node or later
    /// it is the step that is not complete yet.
    pub fn place(&self, time_s: f64) -> (usize, f64) {
        let node_s = &self.timeline.node_s;
        let after = node_s.partition_point(|&t| t <= time_s + SAME_INSTANT_S);
        let step = after.saturating_sub(1);
        let after_node_s = time_s - node_s[step];
        let exact = after_node_s.abs() <= SAME_INSTANT_S;
        (step, if exact { 0.0 } else { after_node_s })
    }

    /// Motion and bias at any time, propagated by the IMU from the node before.
    pub fn state_at(&self, imu: &ImuSeries, state: &State, time_s: f64) -> (NodeState, ImuBias) {
        let node_s = &self.timeline.node_s;
        let (step, after_node_s) = self.place(time_s.max(node_s[0]));
        let (from, bias) = (&state.nodes[step], *self.bias(state, step));
        if after_node_s == 0.0 {
            return (*from, bias);
        }
        let sums = MotionSums::over(bias, imu.pieces(node_s[step], time_s));
        let gravity_m_s2 = state.constants.gravity_m_s2.value;
        (sums.predict(from, &bias, gravity_m_s2), bias)
    }
}

/// The indices of the records of a step; those of the step that is not complete yet come last.
fn range(starts: &[u32], count: usize, step: usize) -> Range<usize> {
    let end = starts.get(step + 1).map_or(count, |&end| end as usize);
    starts[step] as usize..end
}
