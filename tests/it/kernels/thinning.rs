//! Voxels, and the point that is kept of each.

use super::nasty_clouds;
use boresight::cloud::voxel::{thin, thin_by, voxel_key};
use boresight::geometry::Vec3;

#[test]
fn thinning_keeps_the_point_nearest_to_the_centre_of_each_voxel() {
    for (name, points) in nasty_clouds() {
        for voxel_m in [0.003, 0.25, 10.0] {
            let groups = |at: usize| at as u64 % 3;
            for grouped in [false, true] {
                // A point is kept if there is no better one in its voxel and group.
                let rating = |i: usize| {
                    let cell = points[i].map(|x| (x / voxel_m).floor());
                    let offset = points[i] / voxel_m - cell - Vec3::repeat(0.5);
                    (
                        cell,
                        if grouped { groups(i) } else { 0 },
                        offset.norm_squared(),
                    )
                };
                let rated: Vec<_> = (0..points.len()).map(rating).collect();
                let expected: Vec<u32> = (0..points.len())
                    .filter(|&i| {
                        !rated.iter().enumerate().any(|(j, other)| {
                            other.0 == rated[i].0
                                && other.1 == rated[i].1
                                && (other.2, j) < (rated[i].2, i)
                        })
                    })
                    .map(|i| i as u32)
                    .collect();
                let thinned = if grouped {
                    thin_by(&points, voxel_m, groups)
                } else {
                    thin(&points, voxel_m)
                };
                assert_eq!(thinned, expected, "{name}, {voxel_m} m, grouped {grouped}");
            }
        }
    }
}

#[test]
fn voxels_are_half_open_and_the_same_on_both_sides_of_zero() {
    assert_eq!(voxel_key(&Vec3::new(0.0, -1e-9, 0.5), 0.5), [0, -1, 1]);
    assert_eq!(voxel_key(&Vec3::new(-0.5, -0.25, 0.25), 0.25), [-2, -1, 1]);
    // With voxels of 0.5 mm, the index of a projected northing exceeds an i32.
    assert_eq!(
        voxel_key(&Vec3::new(0.0, 5_157_700.25, 0.0), 0.0005)[1],
        10_315_400_500
    );
}
