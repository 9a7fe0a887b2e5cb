//! The result of an update of the online smoother.

use crate::sensor::PoseRecord;
use crate::trajectory::solution::Rejection;

/// The newest pose after an update.
#[derive(Debug, Clone, PartialEq)]
pub struct Update {
    /// With velocity, biases and standard deviations.
    pub pose: PoseRecord,
    /// Nodes with a new linearisation point.
    pub relinearised: usize,
    /// Fronts eliminated.
    pub eliminated: usize,
    /// Records that this update has refused.
    pub rejected: Vec<Rejection>,
    /// The jumps of this update to records that had been refused for too long.
    pub jumps: Vec<Jump>,
}

/// The estimate was lost and follows the records of a sensor again: poses before and after are not
/// consistent until the drive is finished.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Jump {
    /// `heading`, or the name of the position sensor.
    pub sensor: String,
    /// Seconds.
    pub time_s: f64,
}
