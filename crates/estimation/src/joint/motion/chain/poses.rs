//! The poses of a chain between its nodes.

use std::f64::consts::PI;

use nalgebra::DMatrix;

use super::ChainMotion;
use crate::adjustment::{ChainProblem, NODE, STEP};
use crate::geometry::so3::exp;
use crate::joint::motion::knots::{AT_BRIDGE, Knot, StepPoses, node_derivative};
use crate::sensor::PoseRecord;
use crate::trajectory::imu_series::SAME_INSTANT_S;
use crate::trajectory::recovery::{Recovered, Recovery, SampleEnd};
use crate::trajectory::states::NodeState;

impl ChainMotion {
    /// Visits the poses of a step at the present state, by the IMU between its nodes.
    pub(super) fn recover(&self, step: usize, take: impl FnMut(Recovered)) {
        let recovery = Recovery {
            graph: &self.graph,
            state: &self.state,
            imu: &self.imu,
        };
        let ends = || SampleEnd::of_step(&self.graph, &self.imu, step);
        recovery.step_from(step, self.ends[step].get_or_init(ends), take);
    }

    /// The value of a step's bridge at a time, as a share of its middle value.
    fn bridge_share(&self, step: usize, time_s: f64) -> f64 {
        let node_s = &self.graph.timeline.node_s;
        let u = (time_s - node_s[step]) / (node_s[step + 1] - node_s[step]);
        (PI * u).sin()
    }

    /// The pose of a step with its bridge.
    pub(super) fn bridged(&self, step: usize, mut record: PoseRecord) -> PoseRecord {
        let turn_rad = self.bridges[step] * self.bridge_share(step, record.time_s);
        record.world_from_body.rotation *= exp(&turn_rad);
        record
    }

    /// The poses within a step. The effect of the bias on the poses between two nodes is neglected: over the eighth of a
    /// second from node to node it is Δt²/16 of an accelerometer's bias, a micrometre.
    pub(super) fn recovered(&self, step: usize) -> StepPoses {
        let node_s = &self.graph.timeline.node_s;
        let at_node = |node: usize, first: usize| {
            let NodeState {
                world_from_body,
                velocity_m_s,
            } = self.state.nodes[node];
            Knot {
                time_s: node_s[node],
                world_from_body,
                velocity_m_s: Some(velocity_m_s),
                by: node_derivative(first),
            }
        };
        let mut knots = Vec::with_capacity(self.graph.timeline.poses_of(step).len() + 2);
        knots.push(at_node(step, 0));
        self.recover(step, |pose| {
            let time_s = pose.record.time_s;
            let inside = time_s > node_s[step] + SAME_INSTANT_S
                && time_s < node_s[step + 1] - SAME_INSTANT_S;
            if inside {
                let rows = pose.rows();
                let share = self.bridge_share(step, time_s);
                let record = self.bridged(step, pose.record);
                knots.push(Knot {
                    time_s,
                    world_from_body: record.world_from_body,
                    velocity_m_s: record.velocity_m_s,
                    by: std::array::from_fn(|i| {
                        std::array::from_fn(|j| match j {
                            j if j < AT_BRIDGE => rows[i][j],
                            j if j - AT_BRIDGE == i => share,
                            _ => 0.0,
                        })
                    }),
                });
            }
        });
        knots.push(at_node(step + 1, NODE));
        StepPoses { knots, width: NODE }
    }

    /// The covariance of the unknowns of a step: both nodes and the bias.
    pub(super) fn step_covariance(
        &self,
        step: usize,
        covariance: &dyn Fn(usize, usize) -> Option<DMatrix<f64>>,
    ) -> Option<[[f64; STEP]; STEP]> {
        let segment = self.nodes() + self.graph.layout().segment(step);
        let blocks = [(step, 0), (step + 1, NODE), (segment, 2 * NODE)];
        let mut all = [[0.0; STEP]; STEP];
        for (a, row) in blocks {
            for (b, column) in blocks {
                let part = covariance(a, b)?;
                for i in 0..part.nrows() {
                    for j in 0..part.ncols() {
                        all[row + i][column + j] = part[(i, j)];
                    }
                }
            }
        }
        Some(all)
    }
}
