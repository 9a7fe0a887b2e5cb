//! The points at which clouds are compared.

use super::settings::ComparisonSettings;
use crate::cloud::voxel;
use crate::geometry::Vec3;

/// Core points for a comparison with `reference`: its points, thinned to `core_spacing_m`.
pub fn core_points(reference: &[Vec3], settings: &ComparisonSettings) -> Vec<Vec3> {
    core_indices(reference, settings)
        .into_iter()
        .map(|index| reference[index as usize])
        .collect()
}

/// As [`core_points`], but returns the indices of the points in `reference`, ascending.
pub fn core_indices(reference: &[Vec3], settings: &ComparisonSettings) -> Vec<u32> {
    voxel::thin(reference, settings.core_spacing_m)
}
