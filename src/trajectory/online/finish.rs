//! The whole trajectory: so far, and at the end.

use super::{Online, Stage};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::sensor::{ImuBias, PoseRecord};
use crate::trajectory::estimate::{Estimate, estimate, estimate_from};
use crate::trajectory::initial::Initial;
use crate::trajectory::interpolate::Trajectory;
use crate::trajectory::recovery::recover;
use crate::trajectory::timeline::SAME_INSTANT_S;

impl Online {
    /// The trajectory so far: a pose at every IMU sample up to the newest node, smoothed by all
    /// records taken in, at the present linearisation points. Costs as much as the drive is long.
    ///
    /// # Errors
    /// The start has not been made, or there is a single node.
    pub fn full(&mut self) -> Result<Trajectory> {
        let Stage::Running(running) = &mut self.stage else {
            return Err(Error::data(
                "there is no trajectory yet",
                "wait for the first update",
            ));
        };
        let state = running.smoother.estimate();
        let mut graph = running.smoother.graph.clone();
        let newest_s = running.smoother.newest_s();
        let pose_s = &mut graph.timeline.pose_s;
        pose_s.truncate(pose_s.partition_point(|&t| t < newest_s - SAME_INSTANT_S));
        pose_s.push(newest_s);
        // From the last step to the first, as the recursion runs.
        let mut steps: Vec<Vec<PoseRecord>> = Vec::new();
        running.smoother.factor.marginals(|step, covariance| {
            let joint = covariance.joint();
            let mut poses = Vec::new();
            recover(&graph, &state, step, |pose| {
                poses.push(pose.with_sigma(&joint));
            });
            steps.push(poses);
        });
        Trajectory::new(steps.into_iter().rev().flatten().collect())
    }

    /// The end of the drive: every node linearised anew, every record tested with all others, the
    /// constants of the settings estimated: the adjustment of the whole drive, from the online
    /// estimates as start values.
    ///
    /// # Errors
    /// As for [`estimate`].
    pub fn finish(self, progress: &dyn Progress) -> Result<Estimate> {
        let logs = self.given.logs();
        let Stage::Running(mut running) = self.stage else {
            return estimate(&logs, &self.asked, progress);
        };
        let state = running.smoother.estimate();
        let graph = &running.smoother.graph;
        let count = state.biases.len() as f64;
        let gyro_rad_s = state.biases.iter().map(|b| b.gyro_rad_s).sum::<Vec3>() / count;
        estimate_from(
            &|_, timeline, _, _| {
                let at = |time_s: &f64| graph.state_at(&state, *time_s);
                Ok(Initial {
                    nodes: timeline.node_s.iter().map(|t| at(t).0).collect(),
                    // The accelerometer's prior is about zero.
                    bias: ImuBias {
                        gyro_rad_s,
                        accel_m_s2: Vec3::zeros(),
                    },
                    biases: timeline.bias_start_s.iter().map(|t| at(t).1).collect(),
                    rest: None,
                    heading_from_motion: self.given.heading.is_empty(),
                })
            },
            &logs,
            &self.asked,
            progress,
        )
    }
}
