//! Start values of every node.
//!
//! Prism fixes are smoothed by local parabolas. The gyro is integrated, and the attitude is pulled
//! towards the headings and towards the tilt at which the specific force agrees with the smoothed
//! acceleration and gravity: once forward to find the gyro bias, once backward to find the attitude at
//! the start, and once forward for the result.

use super::attitude::Filter;
use super::heading_prior::heading_priors;
use super::prism_motion::{Motion, fixes, interpolated, parabola};
use crate::error::{Error, Result};
use crate::geometry::so3::exp;
use crate::geometry::{Vec3, WorldFromBody};
use crate::sensor::ImuBias;
use crate::trajectory::rest::Rest;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::states::NodeState;
use crate::trajectory::streams::Streams;
use crate::trajectory::timeline::Timeline;

/// The start values.
pub struct Initial {
    pub nodes: Vec<NodeState>,
    /// Centre of the prior of the bias, about which the IMU is integrated.
    pub bias: ImuBias,
    /// One for each bias of the timeline.
    pub biases: Vec<ImuBias>,
    /// The rest that gave the gyro bias.
    pub rest: Option<Rest>,
    /// Whether the direction of travel stood in for headings.
    pub heading_from_motion: bool,
}

/// Start values of every node.
///
/// # Errors
/// Neither headings nor enough motion to determine the heading; no positions, or no headings, that
/// agree with each other.
pub fn initial(
    streams: &Streams,
    timeline: &Timeline,
    rests: &[Rest],
    settings: &TrajectorySettings,
) -> Result<Initial> {
    let (prism, arm) = fixes(streams, settings);
    if prism.is_empty() {
        return Err(Error::data(
            "no two positions lie near each other, as those of a drive do",
            "check the unit of the position log: metres",
        ));
    }
    let motion: Vec<Motion> = (0..prism.len()).map(|i| parabola(&prism, i)).collect();
    let length = |rest: &Rest| rest.to_s - rest.from_s;
    let rest = rests
        .iter()
        .copied()
        .max_by(|a, b| length(a).total_cmp(&length(b)));
    let mut gyro_bias = rest.map_or_else(Vec3::zeros, |rest| rest.gyro_rad_s);
    let (priors, heading_from_motion) = heading_priors(streams, &motion, settings, &gyro_bias)?;

    let filter = Filter {
        streams,
        timeline,
        motion: &motion,
        priors: &priors,
        gravity_m_s2: settings.gravity_m_s2,
    };
    let start = filter.level_start(settings);
    let first = filter.forward(start, &gyro_bias, None);
    if rest.is_none() {
        let (from, to) = streams.span_s();
        gyro_bias -= first.pulled / (to - from);
    }
    let start = filter.backward(first.end, &gyro_bias);
    let mut rotations = Vec::with_capacity(timeline.pose_s.len());
    filter.forward(start, &gyro_bias, Some(&mut rotations));

    let mut cursor = 0;
    let nodes = timeline
        .node_s
        .iter()
        .map(|&time_s| {
            let at = interpolated(&motion, &mut cursor, time_s);
            let sample = streams.imu.at(time_s);
            let rate = streams.imu[sample].gyro_rad_s - gyro_bias;
            let after_sample_s = time_s - streams.imu[sample].time_s;
            let rotation = rotations[sample] * exp(&(rate * after_sample_s));
            let position_m = at.position_m - rotation * arm;
            NodeState {
                world_from_body: WorldFromBody::new(rotation, position_m),
                velocity_m_s: at.velocity_m_s - rotation * rate.cross(&arm),
            }
        })
        .collect();
    let bias = ImuBias {
        gyro_rad_s: gyro_bias,
        accel_m_s2: Vec3::zeros(),
    };
    Ok(Initial {
        nodes,
        bias,
        biases: vec![bias; timeline.layout.segments()],
        rest,
        heading_from_motion,
    })
}
