//! The times of the nodes, and the nodes between which every record lies.
//!
//! Nodes lie at position fixes or at every IMU sample; poses are given at every IMU sample in either
//! case. An IMU sample holds from its time to the next sample's, so that a step from node to node
//! is a run of whole samples with cut ones at its ends.

use super::imu_series::SAME_INSTANT_S;
use super::settings::{Nodes, TrajectorySettings};
use super::streams::Streams;
use crate::adjustment::ChainLayout;

/// Longest time for which one bias is held, and longest step unless the settings ask for shorter ones:
/// biases walk even while the prism is out of sight.
pub const MAX_STEP_S: f64 = TrajectorySettings::MAX_STEP_S;

/// The chain of one drive.
#[derive(Debug, Clone)]
pub struct Timeline {
    /// Times of the nodes, seconds.
    pub node_s: Vec<f64>,
    /// Times of the poses, seconds: every IMU sample and the end of the last.
    pub pose_s: Vec<f64>,
    pub layout: ChainLayout,
    /// When each bias begins, seconds.
    pub bias_start_s: Vec<f64>,
}

impl Timeline {
    pub fn new(streams: &Streams, nodes: Nodes, max_step_s: f64) -> Self {
        let mut pose_s: Vec<f64> = streams.imu.iter().map(|s| s.time_s).collect();
        pose_s.push(streams.span_s().1);
        let mut fixes_s: Vec<f64> = streams
            .positions
            .iter()
            .flatten()
            .map(|fix| fix.value.time_s)
            .collect();
        fixes_s.sort_by(f64::total_cmp);
        let node_s = match nodes {
            Nodes::Imu => pose_s.clone(),
            Nodes::Prism => sparse_nodes(&pose_s, &fixes_s, streams.imu.interval_s, max_step_s),
        };
        let (layout, bias_start_s) = biases(&node_s, &fixes_s);
        Self {
            node_s,
            pose_s,
            layout,
            bias_start_s,
        }
    }

    pub fn steps(&self) -> usize {
        self.node_s.len() - 1
    }

    /// The step that contains `time_s`, and the time since its node, seconds; the end belongs to the last
    /// step.
    pub fn place(&self, time_s: f64) -> (usize, f64) {
        let after = self
            .node_s
            .partition_point(|&t| t <= time_s + SAME_INSTANT_S);
        let step = after.saturating_sub(1).min(self.steps() - 1);
        let after_node_s = time_s - self.node_s[step];
        let exact = after_node_s.abs() <= SAME_INSTANT_S;
        (step, if exact { 0.0 } else { after_node_s })
    }

    /// The poses from the node of `step` up to the next node, or to the end for the last step.
    pub fn poses_of(&self, step: usize) -> std::ops::Range<usize> {
        let first_at = |node: usize| {
            self.pose_s
                .partition_point(|&t| t < self.node_s[node] - SAME_INSTANT_S)
        };
        let end = if step + 1 == self.steps() {
            self.pose_s.len()
        } else {
            first_at(step + 1)
        };
        first_at(step)..end
    }
}

/// Nodes at the ends, at the fixes, and in between where steps would be too long.
fn sparse_nodes(pose_s: &[f64], fixes_s: &[f64], interval_s: f64, max_step_s: f64) -> Vec<f64> {
    let end_s = pose_s[pose_s.len() - 1];
    let mut nodes = vec![pose_s[0]];
    let push = |nodes: &mut Vec<f64>, time_s: f64| {
        let from_s = nodes[nodes.len() - 1];
        // Steps of equal length, each ending at an IMU sample, and no longer than allowed.
        let count = ((time_s - from_s) / max_step_s - SAME_INSTANT_S)
            .ceil()
            .max(1.0);
        for k in 1..count as usize {
            let wanted = from_s + (time_s - from_s) * k as f64 / count;
            let pose = pose_s.partition_point(|&t| t < wanted);
            let last = nodes[nodes.len() - 1];
            if pose_s[pose] > last + 0.5 * interval_s && pose_s[pose] < time_s - 0.5 * interval_s {
                nodes.push(pose_s[pose]);
            }
        }
        nodes.push(time_s);
    };
    for &fix_s in fixes_s {
        let close = |t: f64| (t - fix_s).abs() < SAME_INSTANT_S;
        let pose = pose_s.partition_point(|&t| t < fix_s - SAME_INSTANT_S);
        let time_s = if pose < pose_s.len() && close(pose_s[pose]) {
            pose_s[pose]
        } else {
            fix_s
        };
        // A fix close behind a node belongs to that node; so does one close before the end.
        if time_s > nodes[nodes.len() - 1] + 0.5 * interval_s && time_s < end_s - 0.5 * interval_s {
            push(&mut nodes, time_s);
        }
    }
    push(&mut nodes, end_s);
    nodes
}

/// A new bias at the first node at or after each fix, and at least one a second.
fn biases(node_s: &[f64], fixes_s: &[f64]) -> (ChainLayout, Vec<f64>) {
    let mut begins = vec![false; node_s.len()];
    for &fix_s in fixes_s {
        let node = node_s.partition_point(|&t| t < fix_s - SAME_INSTANT_S);
        begins[node.min(node_s.len() - 1)] = true;
    }
    let steps = node_s.len() - 1;
    let mut segment_of_step = Vec::with_capacity(steps);
    let mut start_s = vec![node_s[0]];
    for (&time_s, &begins) in node_s[..steps].iter().zip(&begins) {
        let held = time_s - start_s[start_s.len() - 1];
        if held > 0.0 && (begins || held >= MAX_STEP_S) {
            start_s.push(time_s);
        }
        segment_of_step.push((start_s.len() - 1) as u32);
    }
    (ChainLayout { segment_of_step }, start_s)
}

/// For records sorted by step: those of step i are `starts[i]..starts[i + 1]`.
pub fn starts(steps_of_records: impl Iterator<Item = usize>, steps: usize) -> Vec<u32> {
    let mut starts = vec![0; steps + 1];
    for step in steps_of_records {
        starts[step + 1] += 1;
    }
    for i in 0..steps {
        starts[i + 1] += starts[i];
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tenths(times: &[f64]) -> Vec<i32> {
        times.iter().map(|t| (t * 10.0).round() as i32).collect()
    }

    #[test]
    fn biases_change_after_each_fix_and_every_second() {
        let nodes: Vec<f64> = (0..=30).map(|i| f64::from(i) * 0.1).collect();
        // A fix on node 0 changes nothing, one on node 4 changes at node 4, one after node 6 at
        // node 7, one at the end would change where no step is left.
        let (layout, start_s) = biases(&nodes, &[0.0, 0.4, 0.65, 3.0]);
        assert_eq!(tenths(&start_s), [0, 4, 7, 17, 27]);
        assert_eq!(layout.segments(), start_s.len());
        assert_eq!(layout.segment_of_step[3..5], [0, 1]);
        assert_eq!(layout.segment_of_step[6..8], [1, 2]);
    }

    #[test]
    fn sparse_nodes_stand_at_fixes_and_no_farther_apart_than_allowed() {
        let poses: Vec<f64> = (0..=400).map(|i| f64::from(i) * 0.01).collect();
        let nodes = sparse_nodes(&poses, &[0.0, 0.5, 0.503, 0.734, 3.1, 4.0], 0.01, 0.25);
        // 0.503 belongs to 0.5; 0.734 to 3.1 is cut in ten.
        assert_eq!(nodes.len(), 1 + 2 + 1 + 10 + 4, "{nodes:?}");
        assert_eq!(nodes[3], 0.734);
        assert!(nodes.windows(2).all(|w| w[1] - w[0] < 0.25 + 0.01));
        assert_eq!((nodes[0], nodes[17]), (0.0, 4.0));
    }

    #[test]
    fn times_and_poses_belong_to_the_step_of_their_node() {
        let pose_s: Vec<f64> = (0..=5).map(|i| f64::from(i) * 0.1).collect();
        let (layout, bias_start_s) = biases(&pose_s, &[]);
        let line = Timeline {
            node_s: vec![0.0, 0.25, 0.5],
            pose_s,
            layout,
            bias_start_s,
        };
        assert_eq!(line.place(0.25), (1, 0.0));
        assert_eq!(line.place(0.5).0, 1);
        assert_eq!(line.poses_of(0), 0..3);
        assert_eq!(line.poses_of(1), 3..6);
    }

    #[test]
    fn starts_count_the_records_before() {
        assert_eq!(starts([0, 0, 2].into_iter(), 3), [0, 2, 2, 3]);
    }
}
