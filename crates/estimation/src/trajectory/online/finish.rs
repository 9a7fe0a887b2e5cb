//! The whole trajectory: so far, and at the end.

use super::records::ReceivedLogs;
use super::running::Running;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::sensor::{ImuBias, PoseRecord};
use crate::trajectory::estimate::{Estimate, estimate_from};
use crate::trajectory::imu_series::SAME_INSTANT_S;
use crate::trajectory::initial::Initial;
use crate::trajectory::interpolate::Trajectory;
use crate::trajectory::recovery::Recovery;
use crate::trajectory::settings::TrajectorySettings;

/// A pose at every IMU sample up to the newest node, and one at that node.
pub fn trajectory_so_far(running: &mut Running) -> Result<Trajectory> {
    let state = running.smoother.estimate();
    let mut graph = running.smoother.graph.clone();
    let newest_s = running.smoother.newest_s();
    let pose_s = &mut graph.timeline.pose_s;
    pose_s.truncate(pose_s.partition_point(|&t| t < newest_s - SAME_INSTANT_S));
    pose_s.push(newest_s);
    let recovery = Recovery {
        graph: &graph,
        state: &state,
        imu: &running.streams.imu,
    };
    // The recursion runs from the last step to the first.
    let mut steps: Vec<Vec<PoseRecord>> = Vec::new();
    running.smoother.factor.marginals(|step, marginal| {
        let covariance = marginal.joint();
        let mut poses = Vec::new();
        recovery.step(step, |pose| {
            poses.push(pose.with_sigma(&covariance.unknowns))
        });
        steps.push(poses);
    });
    Trajectory::new(steps.into_iter().rev().flatten().collect())
}

/// Adjusts the whole drive, with the online estimates as start values.
pub fn finish(
    received: &ReceivedLogs,
    mut running: Running,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Estimate> {
    let state = running.smoother.estimate();
    let (graph, imu) = (&running.smoother.graph, &running.streams.imu);
    let count = state.biases.len() as f64;
    let gyro_rad_s = state.biases.iter().map(|b| b.gyro_rad_s).sum::<Vec3>() / count;
    estimate_from(
        &|_, timeline, _, _| {
            let at = |time_s: &f64| graph.state_at(imu, &state, *time_s);
            Ok(Initial {
                nodes: timeline.node_s.iter().map(|t| at(t).0).collect(),
                // The accelerometer's prior is about zero.
                bias: ImuBias {
                    gyro_rad_s,
                    accel_m_s2: Vec3::zeros(),
                },
                biases: timeline.bias_start_s.iter().map(|t| at(t).1).collect(),
                rest: None,
                heading_from_motion: received.heading.is_empty(),
            })
        },
        &received.logs(),
        settings,
        progress,
    )
}
