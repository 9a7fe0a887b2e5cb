//! Events while tracking.

use super::measurement::Measurement;

/// An event while tracking.
#[derive(Debug, Clone, PartialEq)]
pub enum Event<S> {
    /// A measurement, with or without distance.
    Measured(Measurement<S>),
    /// The instrument no longer follows the prism.
    Lost,
    /// The instrument follows the prism again.
    Found,
    /// A message to the user.
    Note(String),
}
