//! The spacing of points on the surface that they sample.

use crate::cloud::voxel::occupied;
use crate::geometry::Vec3;

/// Voxels grow by this factor from size to size.
const STEP: f64 = 1.25;
/// Edge of the smallest voxels, as a share of the range; the largest voxels are as large as the range.
const FINEST_SHARE: f64 = 1e-4;
/// Number of occupied voxels over that of voxels with twice the edge, above which points form a surface. The
/// ratio is 4 on a surface, 2 along a line, and 1 if each voxel holds at most one point.
const SURFACE_RATIO: f64 = 3.0;
/// Fewest points for an estimate.
const MIN_POINTS: usize = 1000;

/// The smallest edge of voxels in which points at this range form surfaces, not lines or single points,
/// metres; `None` if they never do.
pub fn point_spacing_m(points: &[Vec3], range_m: f64) -> Option<f64> {
    if points.len() < MIN_POINTS {
        return None;
    }
    let count = |voxel_m: f64| occupied(points.iter().copied(), voxel_m).len() as f64;
    let mut sizes = std::iter::successors(Some(FINEST_SHARE * range_m), |size| Some(size * STEP));
    let fills = |size: &f64| count(*size) > SURFACE_RATIO * count(2.0 * size);
    let within_range = sizes.by_ref().take_while(|size| *size < range_m);
    within_range.into_iter().find(fills)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_form_a_surface_at_their_spacing() {
        // Lines 20 mm apart with points every millimetre on a slope.
        let points: Vec<Vec3> = (0..100)
            .flat_map(|line| (0..2000).map(move |i| (0.02 * f64::from(line), 1e-3 * f64::from(i))))
            .map(|(x, y)| Vec3::new(x, y, 0.3 * x + 0.1 * y))
            .collect();
        let spacing_m = point_spacing_m(&points, 1.0).unwrap();
        assert!((0.01..0.04).contains(&spacing_m), "{spacing_m}");
        assert_eq!(point_spacing_m(&points[..100], 1.0), None);
    }
}
