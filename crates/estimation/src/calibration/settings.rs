//! Settings of the calibration.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Estimation method for mountings on a given trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Reweighted least squares with analytic derivatives, one point per voxel, scanner and pass. It is
    /// the second of two steps: the trajectory stays as the first step estimated it.
    #[default]
    TwoStep,
    /// One adjustment of mountings and trajectory, which starts from the result of two steps.
    /// [`calibrate`](super::calibrate) treats it as [`Method::TwoStep`].
    Joint,
    /// The paper's method: numeric Jacobian of the omnivariances, one point per voxel,
    /// Gauss-Newton.
    Paper,
}

/// A distance between mountings: a shift and a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Metres.
    pub shift_m: f64,
    /// Radians.
    pub turn_rad: f64,
}

impl Reach {
    /// Largest error of initial values that were measured with a tape, or taken from a drawing.
    pub const ROUGH: Self = Self {
        shift_m: 0.1,
        turn_rad: 0.06,
    };
    /// An error that initial values do not have unless they are wrong.
    pub const WRONG: Self = Self {
        shift_m: 0.4,
        turn_rad: 0.35,
    };

    /// Whether a perturbation of a mounting is larger than this: a rotation vector (radians) or a shift (metres).
    pub fn is_exceeded(&self, (turn, shift): &(Vec3, Vec3)) -> bool {
        shift.norm() > self.shift_m || turn.norm() > self.turn_rad
    }

    /// The distance by which it moves a point at this range, metres.
    pub fn displacement_m(&self, range_m: f64) -> f64 {
        self.shift_m + self.turn_rad * range_m
    }
}

/// Standard deviation of initial values along any direction, metres: a quarter of their largest error. Rotations are
/// converted by [`LEVER_M`](super::observability::LEVER_M).
pub(super) const INITIAL_SIGMA_M: f64 = 0.25 * Reach::ROUGH.shift_m;
/// Standard deviation of initial rotations about an axis, radians: a quarter of their largest error.
pub(super) const INITIAL_SIGMA_RAD: f64 = 0.25 * Reach::ROUGH.turn_rad;

/// Standard deviation of the initial value of an entry of (δp, δφ) of all mountings.
pub(super) fn initial_sigma(row: usize) -> f64 {
    if row % 6 < 3 {
        INITIAL_SIGMA_M
    } else {
        INITIAL_SIGMA_RAD
    }
}

/// Standard deviations of the initial position (metres) and rotation (radians) of a mounting along and about each axis,
/// as observations of a joint adjustment: half of their largest errors, since all scanners may share one, as that of the
/// measured position of the IMU.
pub const INITIAL_SIGMA: [f64; 2] = [0.5 * Reach::ROUGH.shift_m, 0.5 * Reach::ROUGH.turn_rad];

/// Settings of the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationSettings {
    /// Voxel sizes from coarse to fine, metres.
    pub voxel_sizes_m: Vec<f64>,
    /// Number of points in each neighbourhood (k).
    pub neighbours: usize,
    /// Estimation method.
    pub method: Method,
    /// Maximum number of iterations per scale.
    pub max_iterations: usize,
    /// Time after which a point in the same voxel belongs to another pass of the scanner, seconds.
    pub pass_gap_s: f64,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self {
            voxel_sizes_m: vec![0.05, 0.04, 0.03, 0.02, 0.01, 0.005],
            neighbours: 50,
            method: Method::TwoStep,
            max_iterations: 50,
            pass_gap_s: 3.0,
        }
    }
}

impl CalibrationSettings {
    /// Returns the coarser voxel sizes and the finest.
    ///
    /// # Errors
    /// No voxel size, or sizes that are not positive and decreasing; neighbourhoods of fewer than
    /// four points.
    pub(super) fn scales(&self) -> Result<(&[f64], f64)> {
        let sizes = &self.voxel_sizes_m;
        let is_positive = sizes.iter().all(|&size| size > 0.0 && size.is_finite());
        let falls = sizes.is_sorted_by(|a, b| a > b);
        let (true, true, Some((&finest, coarser))) = (is_positive, falls, sizes.split_last())
        else {
            return Err(Error::data(
                format!("voxel_sizes_m = {sizes:?}"),
                "give at least one size above 0 m, each smaller than the one before",
            ));
        };
        if self.neighbours < 4 {
            return Err(Error::data(
                format!(
                    "neighbours = {}: three points always lie in a plane",
                    self.neighbours
                ),
                "use 4 or more",
            ));
        }
        Ok((coarser, finest))
    }
}
