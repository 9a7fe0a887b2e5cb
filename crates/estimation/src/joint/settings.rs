//! Settings of the joint adjustment, in SI units.

use super::bend::Rung;
use crate::calibration::POSE_CORRELATION_S;
use crate::stored::stored;

/// Size of a surfel in finest voxels of the calibration that precedes the adjustment.
const SURFEL_VOXELS: f64 = 10.0;

/// Settings of the joint adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct JointSettings {
    /// Size of the surfels, metres; `None`: see [`Self::surfel_size_m`].
    pub surfel_m: Option<f64>,
    /// Largest number of iterations in all.
    pub max_iterations: usize,
    /// How much mountings may move.
    pub mounting: MountingMotion,
    /// Errors that all points of the reference share.
    pub reference: ReferenceSigma,
    /// Correlation time of the errors of poses that come from a file, seconds.
    pub correlation_s: f64,
}

/// Standard deviations of errors that all points of the reference share: no number of points
/// averages them out, and most of them show in no residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceSigma {
    /// Shift of the reference against the world of the poses, along each axis, metres.
    pub shift_m: f64,
    /// Tilt of the reference about each horizontal axis, radians.
    pub tilt_rad: f64,
    /// Whether shift and tilt are assumed, as neither was given.
    pub assumed: bool,
    /// Errors of the surface that span several surfels, metres; `None` where the adjustment is to
    /// assume them.
    pub surface_m: Option<f64>,
}

/// How much mountings may move: from the first rung, the adjustment climbs where its tests contradict it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MountingMotion {
    /// Where it begins.
    pub least: Rung,
    /// Where it ends at the latest.
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
            max_iterations: 50,
            mounting: MountingMotion::default(),
            reference: ReferenceSigma::default(),
            correlation_s: POSE_CORRELATION_S,
        }
    }
}

impl JointSettings {
    /// The size of the surfels, metres, after a calibration with this finest voxel: the given size,
    /// or ten voxels, so that a surfel holds enough points for its slopes.
    pub fn surfel_size_m(&self, finest_voxel_m: f64) -> f64 {
        self.surfel_m.unwrap_or(SURFEL_VOXELS * finest_voxel_m)
    }
}

impl Default for ReferenceSigma {
    /// What registration to a total station's points usually leaves.
    fn default() -> Self {
        Self {
            shift_m: 0.002,
            tilt_rad: 0.005_f64.to_radians(),
            assumed: true,
            surface_m: None,
        }
    }
}

stored!(struct ReferenceSigma { shift_m, tilt_rad, assumed, surface_m });
