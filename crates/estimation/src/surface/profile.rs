//! Profiles: points measured together, which share one pose.

use crate::geometry::{Vec3, WorldFromBody};

/// The measurements of a scanner at one time, from one pose. If every point has its own time, every
/// point is a profile.
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
    /// Index of its profile in the table of profiles.
    pub profile: u32,
    /// x_s: scanner frame, metres.
    pub position_m: Vec3,
    /// Number of laser points that it represents, itself included.
    pub count: u32,
}
