//! The rigid motion that brings an estimate to its reference.

use super::association::PosePair;
use crate::error::{Error, Problem, Result};
use crate::geometry::{Mat3, Rotation, Transform, Vec3, World};

/// How an estimate is moved before it is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alignment {
    /// Not at all: both are in one frame.
    None,
    /// By the rotation and translation with the least squares of the positions (Umeyama, *Least-squares estimation of
    /// transformation parameters between two point patterns*, 1991, without scale).
    Se3,
    /// As [`Self::Se3`], but the rotation is about the vertical: an inertial trajectory knows its roll and pitch.
    Yaw,
    /// By the motion that brings the first pose to its reference.
    Origin,
}

/// Spread across the line through the positions, relative to that along it, below which the rotation about the line is
/// noise.
const LINE: f64 = 1e-3;

impl Alignment {
    /// The motion for these pairs, of which there is at least one.
    pub(super) fn of(self, pairs: &[PosePair]) -> Result<Transform<World, World>> {
        match self {
            Self::None => Ok(Transform::identity()),
            Self::Origin => Ok(pairs.first().map_or_else(Transform::identity, |first| {
                first.reference * first.estimate.inverse()
            })),
            Self::Yaw => Ok(moved(yaw(&cross_covariance(pairs)), pairs)),
            Self::Se3 => Ok(moved(umeyama(&cross_covariance(pairs))?, pairs)),
        }
    }
}

fn means(pairs: &[PosePair]) -> [Vec3; 2] {
    let n = pairs.len() as f64;
    let [estimate, reference] = [
        |pair: &PosePair| pair.estimate,
        |pair: &PosePair| pair.reference,
    ]
    .map(|pose| {
        pairs
            .iter()
            .map(|pair| pose(pair).translation_m)
            .sum::<Vec3>()
    });
    [estimate / n, reference / n]
}

/// Σ (q − q̄)(p − p̄)ᵀ of the estimate's positions q and the reference's p.
fn cross_covariance(pairs: &[PosePair]) -> Mat3 {
    let [estimate, reference] = means(pairs);
    let each = pairs.iter().map(|pair| {
        let q = pair.estimate.translation_m - estimate;
        let p = pair.reference.translation_m - reference;
        q * p.transpose()
    });
    each.sum()
}

/// The motion with this rotation that brings the mean of the estimate to that of the reference.
fn moved(rotation: Rotation, pairs: &[PosePair]) -> Transform<World, World> {
    let [estimate, reference] = means(pairs);
    Transform::new(rotation, reference - rotation * estimate)
}

/// The rotation about the vertical: the angle θ for which Σ p·Rz(θ) q is largest.
fn yaw(covariance: &Mat3) -> Rotation {
    let sine = covariance[(0, 1)] - covariance[(1, 0)];
    let cosine = covariance[(0, 0)] + covariance[(1, 1)];
    Rotation::from_axis_angle(&Vec3::z_axis(), sine.atan2(cosine))
}

/// R = V diag(1, 1, det V Uᵀ) Uᵀ with the singular value decomposition U S Vᵀ of the covariance.
fn umeyama(covariance: &Mat3) -> Result<Rotation> {
    let decomposed = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (decomposed.u, decomposed.v_t) else {
        return Err(on_a_line());
    };
    let mut sizes = decomposed.singular_values;
    sizes.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    if sizes[1] <= LINE * LINE * sizes[0] {
        return Err(on_a_line());
    }
    let smallest = decomposed.singular_values.imin();
    let mut signs = Mat3::identity();
    signs[(smallest, smallest)] = (v_t.transpose() * u.transpose()).determinant().signum();
    let rotation = v_t.transpose() * signs * u.transpose();
    Ok(Rotation::from_matrix(&rotation))
}

fn on_a_line() -> Error {
    Error::of(
        Problem::NotDetermined,
        "the positions lie on a line, about which the alignment could turn freely",
        "align with --align yaw or --align origin",
    )
}
