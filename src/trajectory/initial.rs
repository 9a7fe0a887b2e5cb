//! Where the adjustment starts, from the data alone.
//!
//! Prism fixes are smoothed by local parabolas. The gyro is integrated and pulled to the tilt that
//! makes the specific force agree with the smoothed acceleration and gravity, and to the headings:
//! once forward to find the gyro bias, once backward so that the start is no longer a guess, once
//! forward for good.

use super::rest::{REST_BLOCK_S, Rest};
use super::settings::TrajectorySettings;
use super::states::NodeState;
use super::streams::Streams;
use super::timeline::Timeline;
use crate::error::{Error, Problem, Result};
use crate::geometry::heading::{heading_rad, wrap};
use crate::geometry::so3::exp;
use crate::geometry::{Rotation, Vec3, WorldFromBody};
use crate::sensor::ImuBias;
use crate::statistics::median;

/// Fixes either side of a local parabola's middle.
const PARABOLA_REACH: usize = 2;
/// Fixes farther away in time do not take part in a parabola, seconds.
const PARABOLA_REACH_S: f64 = 1.0;
/// Rate at which the attitude is pulled to the tilt and the headings, 1/s: slow enough to average
/// the noise of smoothed accelerations, fast enough to hold an uncalibrated gyro within degrees.
const PULL_PER_S: f64 = 0.5;
/// Neighbours on either side whose median a start value must be near.
const MEDIAN_REACH: usize = 4;
/// How near: this many times the median distance plus this many standard deviations.
const ALIKE_MEDIANS: f64 = 6.0;
const ALIKE_SIGMAS: f64 = 10.0;
/// Neighbours on either side that a heading must agree with, turned by the gyro: more than a run of
/// wrong ones is long.
const HEADING_REACH: usize = 60;
/// What the gyro may turn in that time that the body does not, radians.
const GYRO_DRIFT_RAD: f64 = 0.35;
/// Slower motion gives no direction of travel, m/s.
const LEAST_SPEED_M_S: f64 = 0.05;
/// Without headings the prism must have moved this many standard deviations.
const LEAST_MOVE_SIGMAS: f64 = 50.0;

/// The start values.
pub(super) struct Initial {
    pub nodes: Vec<NodeState>,
    /// Centre of the biases' prior, and what the IMU is summed up about.
    pub bias: ImuBias,
    /// One for each bias of the timeline.
    pub biases: Vec<ImuBias>,
    /// The rest that gave the gyro bias.
    pub rest: Option<Rest>,
    /// Whether the direction of travel stood in for headings.
    pub heading_from_motion: bool,
}

/// Position, velocity and acceleration of the prism at a time.
#[derive(Debug, Clone, Copy)]
struct Motion {
    time_s: f64,
    position_m: Vec3,
    velocity_m_s: Vec3,
    acceleration_m_s2: Vec3,
}

/// A body heading to be pulled to.
#[derive(Debug, Clone, Copy)]
struct Hint {
    time_s: f64,
    heading_rad: f64,
}

/// Start values of every node.
///
/// # Errors
/// Neither headings nor enough motion to tell where the body points; positions or headings of which
/// none fits the others.
pub(super) fn initial(
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
    let (hints, heading_from_motion) = hints(streams, &motion, settings, &gyro_bias)?;

    let filter = Filter {
        streams,
        timeline,
        motion: &motion,
        hints: &hints,
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
            let rest_s = time_s - streams.imu[sample].time_s;
            let rotation = rotations[sample] * exp(&(rate * rest_s));
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

/// Times and positions of one point of the body, and where that is: all sensors that share the
/// lever arm of the one with the most fixes, without fixes far off their neighbours.
fn fixes(streams: &Streams, settings: &TrajectorySettings) -> (Vec<(f64, Vec3)>, Vec3) {
    let most = (0..streams.positions.len())
        .max_by_key(|&sensor| (streams.positions[sensor].len(), usize::MAX - sensor))
        .unwrap_or(0);
    let arm = settings.positions[most].lever_arm_m;
    let mut all: Vec<(f64, Vec3)> = streams
        .positions
        .iter()
        .zip(&settings.positions)
        .filter(|(_, sensor)| sensor.lever_arm_m == arm)
        .flat_map(|(fixes, _)| fixes.iter().map(|f| (f.value.time_s, f.value.position_m)))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let positions: Vec<Vec3> = all.iter().map(|f| f.1).collect();
    let keep = alike(&positions, settings.positions[most].sigma_m.max());
    let kept = all.into_iter().zip(keep).filter(|(_, keep)| *keep);
    (kept.map(|(fix, _)| fix).collect(), arm)
}

/// Indices from `reach` before to `reach` after.
fn around(i: usize, reach: usize, count: usize) -> std::ops::Range<usize> {
    i.saturating_sub(reach)..(i + reach + 1).min(count)
}

/// How far each value is from the median of its neighbours on either side.
fn off_neighbours(values: &[Vec3], reach: usize) -> Vec<f64> {
    (0..values.len())
        .map(|i| {
            let near = &values[around(i, reach, values.len())];
            let centre = Vec3::from_fn(|axis, _| {
                median(near.iter().map(|value| value[axis])).unwrap_or(f64::NAN)
            });
            (values[i] - centre).norm()
        })
        .collect()
}

/// Which values lie near the median of their neighbours, as near as the values around them do or
/// within ten standard deviations: enough to start from, with outliers of any size among them.
fn alike(values: &[Vec3], sigma: f64) -> Vec<bool> {
    let off = off_neighbours(values, MEDIAN_REACH);
    (0..values.len())
        .map(|i| {
            let near = &off[around(i, 4 * MEDIAN_REACH, off.len())];
            let usual = median(near.iter().copied()).unwrap_or(f64::NAN);
            off[i] <= ALIKE_MEDIANS * usual + ALIKE_SIGMAS * sigma
        })
        .collect()
}

/// The parabola through the fixes near fix `middle` by least squares, at its time. With two fixes
/// it is a line, with one a point.
fn parabola(prism: &[(f64, Vec3)], middle: usize) -> Motion {
    let (time_s, position_m) = prism[middle];
    let first = middle.saturating_sub(PARABOLA_REACH);
    let last = (middle + PARABOLA_REACH + 1).min(prism.len());
    let near = || {
        prism[first..last]
            .iter()
            .map(|(t, p)| (t - time_s, p))
            .filter(|(t, _)| t.abs() <= PARABOLA_REACH_S)
    };
    let columns = near().count().min(3);
    let mut normal = nalgebra::Matrix3::zeros();
    let mut right = nalgebra::Matrix3::zeros();
    for (t, p) in near() {
        let row = Vec3::new(1.0, t, 0.5 * t * t);
        normal += row * row.transpose();
        right += row * p.transpose();
    }
    for unused in columns..3 {
        normal.row_mut(unused).fill(0.0);
        normal.column_mut(unused).fill(0.0);
        normal[(unused, unused)] = 1.0;
        right.row_mut(unused).fill(0.0);
    }
    let solution = normal.lu().solve(&right).unwrap_or_else(|| {
        nalgebra::Matrix3::from_rows(&[
            position_m.transpose(),
            Vec3::zeros().transpose(),
            Vec3::zeros().transpose(),
        ])
    });
    Motion {
        time_s,
        position_m: solution.row(0).transpose(),
        velocity_m_s: solution.row(1).transpose(),
        acceleration_m_s2: solution.row(2).transpose(),
    }
}

/// The motion at `time_s`: Hermite between fixes for the position, linear for the rest; at rest
/// beyond the ends. `cursor` remembers the place and may move either way.
fn interpolated(motion: &[Motion], cursor: &mut usize, time_s: f64) -> Motion {
    let still = |m: &Motion| Motion {
        velocity_m_s: Vec3::zeros(),
        acceleration_m_s2: Vec3::zeros(),
        ..*m
    };
    let last = motion.len() - 1;
    if time_s <= motion[0].time_s {
        return still(&motion[0]);
    }
    if time_s >= motion[last].time_s {
        return still(&motion[last]);
    }
    while *cursor + 1 < last && motion[*cursor + 1].time_s <= time_s {
        *cursor += 1;
    }
    while *cursor > 0 && motion[*cursor].time_s > time_s {
        *cursor -= 1;
    }
    let (a, b) = (&motion[*cursor], &motion[*cursor + 1]);
    let dt = b.time_s - a.time_s;
    let u = (time_s - a.time_s) / dt;
    let (u2, u3) = (u * u, u * u * u);
    Motion {
        time_s,
        position_m: a.position_m * (2.0 * u3 - 3.0 * u2 + 1.0)
            + a.velocity_m_s * (dt * (u3 - 2.0 * u2 + u))
            + b.position_m * (3.0 * u2 - 2.0 * u3)
            + b.velocity_m_s * (dt * (u3 - u2)),
        velocity_m_s: a.velocity_m_s.lerp(&b.velocity_m_s, u),
        acceleration_m_s2: a.acceleration_m_s2.lerp(&b.acceleration_m_s2, u),
    }
}

/// Headings of the body: measured, or where none are, the direction of travel.
fn hints(
    streams: &Streams,
    motion: &[Motion],
    settings: &TrajectorySettings,
    gyro_bias: &Vec3,
) -> Result<(Vec<Hint>, bool)> {
    if !streams.heading.is_empty() {
        let hints = measured_hints(streams, settings, gyro_bias);
        if hints.is_empty() {
            return Err(Error::data(
                format!(
                    "none of the {} headings within the IMU's span agrees with the gyro and the \
                     headings around it",
                    streams.heading.len()
                ),
                "check the unit of the headings (degrees, clockwise from north), the axes of the \
                 IMU and the clocks, or leave the heading log out",
            ));
        }
        return Ok((hints, false));
    }
    let start = motion[0].position_m;
    let moved = motion
        .iter()
        .map(|m| (m.position_m - start).norm())
        .fold(0.0, f64::max);
    let needed = LEAST_MOVE_SIGMAS * settings.positions[0].sigma_m.max();
    let hints: Vec<Hint> = motion
        .iter()
        .filter(|m| m.velocity_m_s.xy().norm() > LEAST_SPEED_M_S)
        .map(|m| Hint {
            time_s: m.time_s,
            heading_rad: m.velocity_m_s.x.atan2(m.velocity_m_s.y),
        })
        .collect();
    if moved < needed || hints.is_empty() {
        return Err(Error::of(
            Problem::NotDetermined,
            format!(
                "there are no headings within the IMU's span, and the prism moves by {moved:.3} m \
                 only: nothing tells where the body points"
            ),
            format!("add a heading log, or a drive of more than {needed:.2} m"),
        ));
    }
    Ok((hints, true))
}

/// Headings of the body without those that the gyro and the headings around contradict, such as
/// baselines seen the wrong way round.
fn measured_hints(streams: &Streams, settings: &TrajectorySettings, gyro_bias: &Vec3) -> Vec<Hint> {
    let antennas = &settings.heading;
    let up = settings.axes.up();
    // The heading turns clockwise, rates about the body's upward axis count counter-clockwise.
    let mut turned = 0.0;
    let mut sample = 0;
    let all: Vec<(Hint, Vec3)> = streams
        .heading
        .iter()
        .map(|fix| {
            let time_s = fix.value.time_s;
            while sample + 1 < streams.imu.len() && streams.imu[sample + 1].time_s <= time_s {
                let dt = streams.imu[sample + 1].time_s - streams.imu[sample].time_s;
                turned -= (streams.imu[sample].gyro_rad_s - gyro_bias).dot(&up) * dt;
                sample += 1;
            }
            let heading_rad = wrap(
                fix.value.heading_rad + antennas.mounting_offset_rad
                    - antennas.grid_convergence_rad,
            );
            let (sin, cos) = (heading_rad - turned).sin_cos();
            let hint = Hint {
                time_s,
                heading_rad,
            };
            (hint, Vec3::new(cos, sin, 0.0))
        })
        .collect();
    let directions: Vec<Vec3> = all.iter().map(|(_, direction)| *direction).collect();
    let limit = GYRO_DRIFT_RAD + ALIKE_SIGMAS * antennas.sigma_rad;
    let kept = all
        .iter()
        .zip(off_neighbours(&directions, HEADING_REACH))
        .filter(|(_, off)| *off <= limit);
    kept.map(|((hint, _), _)| *hint).collect()
}

/// The complementary filter.
struct Filter<'a> {
    streams: &'a Streams,
    timeline: &'a Timeline,
    motion: &'a [Motion],
    hints: &'a [Hint],
    gravity_m_s2: f64,
}

struct Passed {
    end: Rotation,
    /// Sum of all pulls, body frame, radians.
    pulled: Vec3,
}

impl Filter<'_> {
    /// Level by the mean specific force of the first second, heading of the first hint.
    fn level_start(&self, settings: &TrajectorySettings) -> Rotation {
        let until = self.timeline.pose_s[0] + REST_BLOCK_S;
        let count = self
            .streams
            .imu
            .partition_point(|s| s.time_s < until)
            .max(1);
        let force = self.streams.imu[..count]
            .iter()
            .map(|s| s.accel_m_s2)
            .sum::<Vec3>();
        let heading = self.hints[0].heading_rad;
        let level = settings.axes.level_world_from_body(heading);
        let tilt = Rotation::rotation_between(&(level * force), &Vec3::z())
            .unwrap_or_else(Rotation::identity);
        let rotation = tilt * level;
        turned_to_heading(&rotation, heading, 1.0)
    }

    /// The rotation, pulled to the specific force of step `i` for `dt_s`.
    fn tilted(&self, rotation: &Rotation, i: usize, cursor: &mut usize, dt_s: f64) -> Rotation {
        let at = interpolated(self.motion, cursor, self.timeline.pose_s[i]);
        let expected = at.acceleration_m_s2 + Vec3::new(0.0, 0.0, self.gravity_m_s2);
        let seen = rotation * self.streams.imu[i].accel_m_s2;
        let scale = expected.norm() * seen.norm();
        if scale == 0.0 {
            return *rotation;
        }
        exp(&(seen.cross(&expected) * (PULL_PER_S * dt_s / scale))) * rotation
    }

    fn forward(
        &self,
        start: Rotation,
        bias: &Vec3,
        mut record: Option<&mut Vec<Rotation>>,
    ) -> Passed {
        let mut rotation = start;
        let mut pulled = Vec3::zeros();
        let (mut cursor, mut hint) = (0, 0);
        let mut hinted_s = self.timeline.pose_s[0];
        for i in 0..self.streams.imu.len() {
            if let Some(record) = record.as_deref_mut() {
                record.push(rotation);
            }
            let dt = self.timeline.pose_s[i + 1] - self.timeline.pose_s[i];
            let before = rotation;
            rotation = self.tilted(&rotation, i, &mut cursor, dt);
            while let Some(at) = self
                .hints
                .get(hint)
                .filter(|h| h.time_s <= self.timeline.pose_s[i])
            {
                let gain = 1.0 - (-PULL_PER_S * (at.time_s - hinted_s)).exp();
                rotation = turned_to_heading(&rotation, at.heading_rad, gain);
                hinted_s = at.time_s;
                hint += 1;
            }
            pulled += (before.inverse() * rotation).scaled_axis();
            rotation *= exp(&((self.streams.imu[i].gyro_rad_s - bias) * dt));
            rotation.renormalize_fast();
        }
        if let Some(record) = record {
            record.push(rotation);
        }
        Passed {
            end: rotation,
            pulled,
        }
    }

    /// From the last node back to the first.
    fn backward(&self, end: Rotation, bias: &Vec3) -> Rotation {
        let mut rotation = end;
        let (mut cursor, mut hint) = (0, self.hints.len());
        let mut hinted_s = self.timeline.pose_s[self.streams.imu.len()];
        for i in (0..self.streams.imu.len()).rev() {
            let dt = self.timeline.pose_s[i + 1] - self.timeline.pose_s[i];
            rotation *= exp(&((self.streams.imu[i].gyro_rad_s - bias) * -dt));
            rotation = self.tilted(&rotation, i, &mut cursor, dt);
            while hint > 0 && self.hints[hint - 1].time_s >= self.timeline.pose_s[i] {
                hint -= 1;
                let at = self.hints[hint];
                let gain = 1.0 - (-PULL_PER_S * (hinted_s - at.time_s)).exp();
                rotation = turned_to_heading(&rotation, at.heading_rad, gain);
                hinted_s = at.time_s;
            }
            rotation.renormalize_fast();
        }
        rotation
    }
}

/// Turned about the vertical by `gain` times what its heading misses.
fn turned_to_heading(rotation: &Rotation, heading: f64, gain: f64) -> Rotation {
    let miss = wrap(heading - heading_rad(rotation));
    Rotation::from_axis_angle(&Vec3::z_axis(), -gain * miss) * rotation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_reproduced_from_uneven_fixes() {
        let at = |t: f64| Vec3::new(1.0 + 2.0 * t + 3.0 * t * t, -t, 4.0);
        let prism: Vec<_> = [0.0, 0.1, 0.25, 0.4, 0.5].map(|t| (t, at(t))).to_vec();
        for (middle, &(t, p)) in prism.iter().enumerate() {
            let found = parabola(&prism, middle);
            assert!((found.position_m - p).norm() < 1e-9);
            assert!((found.velocity_m_s - Vec3::new(2.0 + 6.0 * t, -1.0, 0.0)).norm() < 1e-9);
            assert!((found.acceleration_m_s2 - Vec3::new(6.0, 0.0, 0.0)).norm() < 1e-9);
        }
        // Alone in time, a fix says where, not how fast.
        let lonely = parabola(&[(0.0, at(0.0)), (5.0, at(5.0))], 0);
        assert!((lonely.position_m - at(0.0)).norm() < 1e-12);
        assert_eq!(lonely.velocity_m_s, Vec3::zeros());
    }

    #[test]
    fn turning_to_a_heading_keeps_the_tilt() {
        let tilted = exp(&Vec3::new(0.2, -0.1, 2.0));
        for heading in [-3.0, 0.0, 1.0] {
            let turned = turned_to_heading(&tilted, heading, 1.0);
            assert!(wrap(heading_rad(&turned) - heading).abs() < 1e-12);
            let up = |r: &Rotation| r.inverse() * Vec3::z();
            assert!((up(&turned) - up(&tilted)).norm() < 1e-12);
        }
    }
}
