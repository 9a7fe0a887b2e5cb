//! What happens while tracking.

use super::measurement::Measurement;

/// What tracking gives.
#[derive(Debug, Clone, PartialEq)]
pub enum Event<S> {
    /// A measurement, with or without distance.
    Measured(Measurement<S>),
    /// The instrument follows the prism no more.
    Lost,
    /// The instrument follows the prism again.
    Found,
    /// Something to tell the user.
    Note(String),
}
