//! Errors of a trajectory against a reference: absolute (ATE) and relative (RPE), as Sturm et al. (*A benchmark for the
//! evaluation of RGB-D SLAM systems*, IROS 2012) define them, with the alignments of Zhang and Scaramuzza (*A tutorial
//! on quantitative trajectory evaluation for visual(-inertial) odometry*, IROS 2018).
//!
//! With the aligned estimate Q_i and the reference P_i at the same times:
//!
//! - **ATE**: the translation is |p_i − q_i|, the rotation the angle of P_i⁻¹ Q_i.
//! - **RPE** over a time or a distance Δ: of E = (P_i⁻¹ P_j)⁻¹ (Q_i⁻¹ Q_j), the length of the translation and the angle
//!   of the rotation, for every i and the first j that lies Δ or more behind it. It does not depend on the alignment.
//!
//! Rigid alignments have no scale: poses are in metres.

mod alignment;
mod association;
mod errors;

pub use alignment::Alignment;
pub use association::{Association, PosePair};
pub use errors::{Over, PoseError, RelativeErrors, Spread};

use crate::error::Result;
use crate::geometry::{Transform, World};
use crate::sensor::PoseRecord;
use errors::{absolute, relative};

/// How two trajectories are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// How the estimate is moved before it is compared.
    pub alignment: Alignment,
    /// What relative errors are taken over.
    pub over: Over,
    /// Longest interval between poses in which the denser trajectory is interpolated, seconds; `None` for 2.5 times its
    /// median interval, which bridges a missing pose.
    pub max_gap_s: Option<f64>,
    /// Time of the reference minus that of the estimate, seconds.
    pub time_offset_s: f64,
}

/// The errors of a trajectory.
#[derive(Debug, Clone)]
pub struct TrajectoryErrors {
    /// Which poses were compared.
    pub association: Association,
    /// Maps the estimate to the reference.
    pub alignment: Transform<World, World>,
    /// The error of each pose, in order of time.
    pub poses: Vec<PoseError>,
    /// Absolute translations, metres.
    pub translation_m: Spread,
    /// Absolute rotations, radians.
    pub rotation_rad: Spread,
    /// Relative errors; `None` if no two poses are that far apart.
    pub relative: Option<RelativeErrors>,
}

/// Compares two trajectories, each in order of time.
///
/// # Errors
/// Trajectories without common times; too few poses for the alignment, or positions on a line for a rotation in space.
pub fn compare(
    estimate: &[PoseRecord],
    reference: &[PoseRecord],
    comparison: &Comparison,
) -> Result<TrajectoryErrors> {
    let &Comparison {
        alignment,
        over,
        max_gap_s,
        time_offset_s,
    } = comparison;
    let association = Association::of(estimate, reference, time_offset_s, max_gap_s)?;
    let alignment = alignment.of(&association.pairs)?;
    let poses = absolute(&association.pairs, &alignment);
    let spread = |value: fn(&PoseError) -> f64| Spread::of(poses.iter().map(value));
    Ok(TrajectoryErrors {
        translation_m: spread(|pose| pose.offset_m.norm()),
        rotation_rad: spread(|pose| pose.rotation_rad),
        relative: relative(&association.pairs, over),
        association,
        alignment,
        poses,
    })
}

#[cfg(test)]
mod tests;
