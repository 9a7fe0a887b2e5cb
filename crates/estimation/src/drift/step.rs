//! Steps of a scanner in the frame of the first.

use nalgebra::Vector6;

use crate::calibration::ScannerFromScanner;
use crate::geometry::{Vec3, so3};

/// The pose after a step: Exp(δφ) R, t + δp.
pub fn perturbed(pose: &ScannerFromScanner, delta: &[f64]) -> ScannerFromScanner {
    let [shift, turn] = [&delta[..3], &delta[3..]].map(Vec3::from_column_slice);
    ScannerFromScanner::new(so3::exp(&turn) * pose.rotation, pose.translation_m + shift)
}

/// The step (δp, δφ) from one pose to the other.
pub fn offset(from: &ScannerFromScanner, to: &ScannerFromScanner) -> Vector6<f64> {
    let shift = to.translation_m - from.translation_m;
    let turn = so3::log(&(to.rotation * from.rotation.inverse()));
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}
