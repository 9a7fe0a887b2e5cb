//! The passes of a drive: stretches without a turn in one direction.

use crate::geometry::Vec3;
use crate::geometry::heading::{heading_rad, wrap};
use crate::trajectory::Trajectory;

/// Sampling interval of the trajectory, seconds.
const STEP_S: f64 = 0.25;
/// Longest drive: only times of a damaged file span more.
const LONGEST_S: f64 = 7.0 * 86_400.0;
/// How long before and after a time the headings are compared, seconds.
const REACH_S: f64 = 1.0;
/// Smallest change of heading over twice the reach that is a turn, radians.
const TURN_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Smallest displacement over twice the reach that is not rest, metres.
const MOVED_M: f64 = 0.05;

/// The passes along a drive.
#[derive(Debug)]
pub struct Passes {
    first_s: f64,
    /// One number every [`STEP_S`].
    numbers: Vec<u16>,
}

impl Passes {
    /// The passes of a trajectory.
    pub fn of(trajectory: &Trajectory) -> Self {
        let trajectory = trajectory.clone().without_limits();
        let (first_s, last_s) = trajectory.span_s();
        // Times after a week belong to no pass.
        let steps = ((last_s - first_s).min(LONGEST_S) / STEP_S).ceil() as usize;
        let mut passes = 0_u16;
        // Whether the pass goes forwards; `None` on no pass.
        let mut under_way = None;
        let at = |time_s: f64| trajectory.pose_at(time_s.clamp(first_s, last_s));
        let number = |step: usize| {
            let time_s = first_s + STEP_S * step as f64;
            let (Some(before), Some(after)) = (at(time_s - REACH_S), at(time_s + REACH_S)) else {
                return 0;
            };
            let turned = heading_rad(&after.rotation) - heading_rad(&before.rotation);
            let way_m = after.translation_m - before.translation_m;
            let ahead_m = way_m.dot(&(before.rotation * Vec3::x()));
            if wrap(turned).abs() > TURN_RAD {
                under_way = None;
            } else if ahead_m.abs() > MOVED_M && under_way != Some(ahead_m > 0.0) {
                under_way = Some(ahead_m > 0.0);
                passes = passes.saturating_add(1);
            }
            if under_way.is_some() { passes } else { 0 }
        };
        Self {
            first_s,
            numbers: (0..=steps).map(number).collect(),
        }
    }

    /// The number of the pass at a time, from 1; 0 while the body turns and before it moves.
    pub fn at(&self, time_s: f64) -> u16 {
        let step = ((time_s - self.first_s) / STEP_S).round().max(0.0) as usize;
        self.numbers.get(step).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Rotation, WorldFromBody};
    use crate::sensor::PoseRecord;

    #[test]
    fn a_turn_and_a_change_of_direction_begin_a_pass() {
        // East for 10 s, a turn on the spot for 10 s, back for 10 s, and then backwards for 10 s.
        let pose = |time_s: f64| {
            let yaw = std::f64::consts::PI * ((time_s - 10.0) / 10.0).clamp(0.0, 1.0);
            let east_m = match time_s {
                t if t < 10.0 => t,
                t if t < 20.0 => 10.0,
                t if t < 30.0 => 30.0 - t,
                t => t - 30.0,
            };
            let rotation = Rotation::from_euler_angles(0.0, 0.0, yaw);
            PoseRecord::new(
                time_s,
                WorldFromBody::new(rotation, Vec3::new(east_m, 0.0, 0.0)),
            )
        };
        let times_s = (0..=400).map(|i| 0.1 * f64::from(i));
        let passes = Passes::of(&Trajectory::new(times_s.map(pose).collect()).unwrap());
        let numbers = [5.0, 15.0, 25.0, 35.0, 99.0].map(|time_s| passes.at(time_s));
        assert_eq!(numbers, [1, 0, 2, 3, 0]);
    }
}
