//! A mounting that moves along a drive.

use super::{BodyFromScanner, Vec3};
use crate::statistics::Series;

/// Offsets of a mounting from its mean along a drive: (δφ, δp) in body axes, radians and metres.
pub type Bending = Series<6>;

impl Bending {
    /// The mounting at `time_s`, given its mean.
    pub fn apply(&self, mean: &BodyFromScanner, time_s: f64) -> BodyFromScanner {
        bent(mean, &self.at(time_s))
    }
}

/// The mounting that deviates from `mean` by the offset (δφ, δp), radians and metres.
pub fn bent(mean: &BodyFromScanner, offset: &[f64; 6]) -> BodyFromScanner {
    let [turn, shift] = [&offset[..3], &offset[3..]].map(Vec3::from_column_slice);
    mean.perturbed(&turn, &shift)
}
