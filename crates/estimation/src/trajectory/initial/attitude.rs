//! The attitude before any adjustment, by a complementary filter.

use super::heading_prior::HeadingPrior;
use super::prism_motion::{Motion, interpolated};
use crate::geometry::heading::{heading_rad, wrap};
use crate::geometry::so3::exp;
use crate::geometry::{Rotation, Vec3};
use crate::trajectory::rest::REST_BLOCK_S;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::streams::Streams;
use crate::trajectory::timeline::Timeline;

/// Rate at which the attitude is pulled to the tilt and the headings, 1/s: slow enough to average
/// the noise of smoothed accelerations, fast enough to hold an uncalibrated gyro within degrees.
const PULL_PER_S: f64 = 0.5;

/// The complementary filter.
pub struct Filter<'a> {
    pub streams: &'a Streams,
    pub timeline: &'a Timeline,
    pub motion: &'a [Motion],
    pub priors: &'a [HeadingPrior],
    pub gravity_m_s2: f64,
}

/// The result of a pass over the drive.
pub struct Pass {
    pub end: Rotation,
    /// Sum of all corrections towards the tilt and the headings, body frame, radians.
    pub pulled: Vec3,
}

impl Filter<'_> {
    /// The attitude levelled by the mean specific force of the first second, at the first heading.
    pub fn level_start(&self, settings: &TrajectorySettings) -> Rotation {
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
        let heading = self.priors[0].heading_rad;
        let level = settings.axes.level_world_from_body(heading);
        let tilt = Rotation::rotation_between(&(level * force), &Vec3::z())
            .unwrap_or_else(Rotation::identity);
        let rotation = tilt * level;
        turned_to_heading(&rotation, heading, 1.0)
    }

    /// The rotation, pulled towards the tilt by the specific force of sample `i` for `dt_s`.
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

    /// From the first sample to the end; `record` receives the attitude at each sample and at the end.
    pub fn forward(
        &self,
        start: Rotation,
        bias: &Vec3,
        mut record: Option<&mut Vec<Rotation>>,
    ) -> Pass {
        let mut rotation = start;
        let mut pulled = Vec3::zeros();
        let (mut cursor, mut prior) = (0, 0);
        let mut prior_s = self.timeline.pose_s[0];
        for i in 0..self.streams.imu.len() {
            if let Some(record) = record.as_deref_mut() {
                record.push(rotation);
            }
            let dt = self.timeline.pose_s[i + 1] - self.timeline.pose_s[i];
            let before = rotation;
            rotation = self.tilted(&rotation, i, &mut cursor, dt);
            while let Some(at) = self
                .priors
                .get(prior)
                .filter(|h| h.time_s <= self.timeline.pose_s[i])
            {
                let gain = 1.0 - (-PULL_PER_S * (at.time_s - prior_s)).exp();
                rotation = turned_to_heading(&rotation, at.heading_rad, gain);
                prior_s = at.time_s;
                prior += 1;
            }
            pulled += (before.inverse() * rotation).scaled_axis();
            rotation *= exp(&((self.streams.imu[i].gyro_rad_s - bias) * dt));
            rotation.renormalize_fast();
        }
        if let Some(record) = record {
            record.push(rotation);
        }
        Pass {
            end: rotation,
            pulled,
        }
    }

    /// From the last node back to the first.
    pub fn backward(&self, end: Rotation, bias: &Vec3) -> Rotation {
        let mut rotation = end;
        let (mut cursor, mut prior) = (0, self.priors.len());
        let mut prior_s = self.timeline.pose_s[self.streams.imu.len()];
        for i in (0..self.streams.imu.len()).rev() {
            let dt = self.timeline.pose_s[i + 1] - self.timeline.pose_s[i];
            rotation *= exp(&((self.streams.imu[i].gyro_rad_s - bias) * -dt));
            rotation = self.tilted(&rotation, i, &mut cursor, dt);
            while prior > 0 && self.priors[prior - 1].time_s >= self.timeline.pose_s[i] {
                prior -= 1;
                let at = self.priors[prior];
                let gain = 1.0 - (-PULL_PER_S * (prior_s - at.time_s)).exp();
                rotation = turned_to_heading(&rotation, at.heading_rad, gain);
                prior_s = at.time_s;
            }
            rotation.renormalize_fast();
        }
        rotation
    }
}

/// The rotation, turned about the vertical by `gain` times the error of its heading.
fn turned_to_heading(rotation: &Rotation, heading: f64, gain: f64) -> Rotation {
    let miss = wrap(heading - heading_rad(rotation));
    Rotation::from_axis_angle(&Vec3::z_axis(), -gain * miss) * rotation
}

#[cfg(test)]
mod tests {
    use super::*;

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
