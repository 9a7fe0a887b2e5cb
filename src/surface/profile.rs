//! Points that were measured together stand with one pose.

use crate::geometry::{Vec3, WorldFromBody};

/// What a scanner measured at one time, from one pose. A scanner whose points each have a time of
/// their own has a profile a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    /// Seconds.
    pub time_s: f64,
    /// Pose of the body at `time_s`.
    pub world_from_body: WorldFromBody,
}

/// A laser point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePoint {
    /// Index of its profile in the table beside the points.
    pub profile: u32,
    /// x_s: scanner frame, metres.
    pub position_m: Vec3,
}
