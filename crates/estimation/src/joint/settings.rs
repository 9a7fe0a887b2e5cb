//! Settings of the joint adjustment, in SI units.

use serde::{Deserialize, Serialize};

use super::bend::Rung;
use crate::calibration::POSE_CORRELATION_S;

/// Size of a surfel in spacings of points.
const SURFEL_SPACINGS: f64 = 10.0;

/// Settings of the joint adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct JointSettings {
    /// Size of the surfels, metres; `None`: see [`Self::surfel_size_m`].
    pub surfel_m: Option<f64>,
    /// Largest total number of iterations.
    pub max_iterations: usize,
    /// How much the mountings may move.
    pub mounting: MountingMotion,
    /// Errors that all points of the reference share.
    pub reference: ReferenceSigma,
    /// Correlation time of the errors of poses that come from a file, seconds.
    pub correlation_s: f64,
}

/// Standard deviations of errors that all points of the reference share: they do not average out over
/// the points, and most of them do not show in residuals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReferenceSigma {
    /// Shift of the reference against the world of the poses, along each axis, metres.
    pub shift_m: f64,
    /// Tilt of the reference about each horizontal axis, radians.
    pub tilt_rad: f64,
    /// Whether shift and tilt are assumed, because neither was given.
    pub assumed: bool,
    /// Errors of the surface that span several surfels, metres; with `None` the adjustment assumes
    /// them.
    pub surface_m: Option<f64>,
}

/// How much the mountings may move: the adjustment starts at the first rung and climbs while its tests contradict it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MountingMotion {
    /// The first rung.
    pub least: Rung,
    /// The last rung.
    pub most: Rung,
}

impl Default for MountingMotion {
    fn default() -> Self {
        Self {
            least: Rung::Rigid,
            most: Rung::DenseKnots,
        }
    }
}

impl Default for JointSettings {
    fn default() -> Self {
        Self {
            surfel_m: None,
            max_iterations: 100,
            mounting: MountingMotion::default(),
            reference: ReferenceSigma::default(),
            correlation_s: POSE_CORRELATION_S,
        }
    }
}

impl JointSettings {
    /// The size of the surfels of points with this spacing, metres: the given size, or ten times the spacing, so that a
    /// surfel holds enough points for its slopes.
    pub fn surfel_size_m(&self, spacing_m: f64) -> f64 {
        self.surfel_m.unwrap_or(SURFEL_SPACINGS * spacing_m)
    }
}

impl Default for ReferenceSigma {
    /// The errors that usually remain after a registration to points of a total station.
    fn default() -> Self {
        Self {
            shift_m: 0.002,
            tilt_rad: 0.005_f64.to_radians(),
            assumed: true,
            surface_m: None,
        }
    }
}
