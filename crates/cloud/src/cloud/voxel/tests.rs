//! Thinning compared with its definition.

use std::collections::BTreeMap;

use super::*;
use crate::geometry::Vec3;

/// The definition, applied point by point.
fn slow(points: &[Vec3], voxel_m: f64) -> Vec<u32> {
    let mut best: BTreeMap<VoxelKey, (f64, u32)> = BTreeMap::new();
    for (point, index) in points.iter().zip(0..) {
        if !(point / voxel_m).iter().all(|v| v.is_finite()) {
            continue;
        }
        let distance = squared_distance_to_centre(point, voxel_m);
        let nearest = best
            .entry(voxel_key(point, voxel_m))
            .or_insert((distance, index));
        if distance < nearest.0 {
            *nearest = (distance, index);
        }
    }
    let mut indices: Vec<u32> = best.into_values().map(|(_, index)| index).collect();
    indices.sort_unstable();
    indices
}

/// `n` pseudo-random points in a box of size `extent_m` about `centre`, the same in every run.
fn scattered(n: u64, centre: Vec3, extent_m: Vec3) -> Vec<Vec3> {
    let part = |k: u64| {
        let mixed = k.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (mixed ^ mixed >> 27) as f64 / 2f64.powi(64) - 0.5
    };
    (0..n)
        .map(|i| {
            let unit = Vec3::new(part(3 * i), part(3 * i + 1), part(3 * i + 2));
            centre + unit.component_mul(&extent_m)
        })
        .collect()
}

fn in_order(mut points: Vec<Vec3>) -> Vec<Vec3> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points
}

#[test]
fn large_clouds_are_thinned_as_defined_with_any_number_of_threads() {
    // Enough for several chunks and buckets.
    let n = 150_000;
    let utm = Vec3::new(362_328.5, 5_157_700.25, 108.5);
    let surface = Vec3::new(3.0, 3.0, 0.01);
    let clouds = [
        ("about zero", scattered(n, Vec3::zeros(), surface)),
        ("projected", scattered(n, utm, surface)),
        ("in order", in_order(scattered(n, utm, surface))),
        // 25 bits per axis at 5 mm: numbered once the extent is known.
        ("wide and flat", scattered(n, utm, Vec3::new(1e5, 1e5, 0.1))),
        // More than 64 bits in all.
        ("wide and high", scattered(n, utm, Vec3::repeat(1e6))),
        (
            "beyond whole numbers",
            scattered(n, utm, Vec3::repeat(1e20)),
        ),
    ];
    for (name, mut points) in clouds {
        // Every voxel of the first third contains another point further on.
        for i in 0..points.len() / 3 {
            let place = points.len() - 1 - i;
            points[place] = points[i] + Vec3::new(1e-4, -1e-4, 1e-4);
        }
        for voxel_m in [0.005, 0.3] {
            let expected = slow(&points, voxel_m);
            for threads in [1, 2, 5] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
                let indices = pool.build().unwrap().install(|| thin(&points, voxel_m));
                assert!(
                    indices == expected,
                    "{name}, {voxel_m} m, {threads} threads"
                );
            }
            let indices = thin_by(&points, voxel_m, |_| 7);
            assert!(indices == expected, "{name}, {voxel_m} m, by group");
        }
    }
}

#[test]
fn the_first_of_equally_near_points_is_kept() {
    // Mirror images about the centres of two voxels, alternating, in many chunks.
    let offsets = [0.25, -0.25].map(|x| Vec3::new(x, 0.125, 0.0));
    let points: Vec<Vec3> = (0..200_000)
        .map(|i| {
            let centre = Vec3::new(if i % 3 == 0 { 0.5 } else { 40.5 }, 0.5, 0.5);
            centre + offsets[usize::from(i % 2 == 0)]
        })
        .collect();
    assert_eq!(thin(&points, 1.0), [0, 1]);
}

#[test]
fn distances_that_are_equal_in_f32_are_compared_in_f64() {
    // 0.25² + ε rounds to the same f32 for all of these.
    let at = |steps: i32| Vec3::new(0.75 + f64::from(steps) * 1e-12, 0.5, 0.5);
    assert_eq!(thin(&[at(3), at(2), at(5)], 1.0), [1]);
    assert_eq!(thin(&[at(1), at(2), at(1), at(0), at(0)], 1.0), [3]);
    let alternating = [at(1), at(2), at(0), at(4)].map(|p| [p, p + Vec3::x() * 9.0]);
    assert_eq!(thin(alternating.as_flattened(), 1.0), [4, 5]);
}

#[test]
fn the_borders_of_voxels_are_where_the_division_rounds_to_whole_numbers() {
    // Multiples of the edge length and the adjacent floating-point numbers, near zero and far from it.
    for voxel_m in [0.1, 0.005, 0.3, 1.0 / 3.0] {
        for far in [0.0f64, 5_157_700.0, -362_328.0] {
            let points: Vec<Vec3> = (-500..500)
                .flat_map(|k| {
                    let border = (far / voxel_m).round() * voxel_m + f64::from(k) * voxel_m;
                    [border.next_down(), border, border.next_up()]
                })
                .map(|x| Vec3::new(x, -x, 0.0))
                .collect();
            assert_eq!(thin(&points, voxel_m), slow(&points, voxel_m), "{voxel_m}");
        }
    }
}

#[test]
fn points_that_are_not_finite_are_never_kept() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut points = scattered(5000, Vec3::zeros(), Vec3::repeat(1.0));
        for (i, point) in points.iter_mut().enumerate() {
            if i % 3 == 0 {
                point[i % 9 / 3] = bad;
            }
        }
        for far in [0.0, 1e9] {
            // One far point makes the extent too large for packed keys.
            points[1].z = far;
            let expected = slow(&points, 0.02);
            assert!(expected.iter().all(|i| i % 3 != 0) && expected.len() > 2500);
            assert_eq!(thin(&points, 0.02), expected, "{bad}");
            assert_eq!(thin_by(&points, 0.02, |_| 0), expected, "{bad}");
        }
        assert!(thin(&[Vec3::new(0.0, bad, 0.0)], 1.0).is_empty());
    }
    // Finite, but not in units of voxels.
    assert_eq!(thin(&[Vec3::repeat(1e300), Vec3::zeros()], 1e-9), [1]);
}

#[test]
fn voxels_may_be_far_larger_or_smaller_than_the_cloud() {
    let points = scattered(300_000, Vec3::repeat(50.0), Vec3::repeat(1.0));
    let distance = |p: &Vec3| squared_distance_to_centre(p, 1e6);
    let nearest = points
        .iter()
        .zip(0..)
        .min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)))
        .unwrap();
    assert_eq!(thin(&points, 1e6), [nearest.1]);
    // All points lie in eight voxels: no table may grow with the number of points.
    assert_eq!(thin(&points, 50.0), slow(&points, 50.0));
    assert!(thin(&points, 1e-9).into_iter().eq(0..300_000));
    assert_eq!(thin(&points[..1], 0.1), [0]);
    assert!(thin(&[], 0.1).is_empty());
}

#[test]
fn tables_grow_with_the_voxels_in_them() {
    // One bucket with more voxels than it was allocated for, as after a poor hash.
    let entries: Vec<(u64, u64)> = (0..100_000).map(|i| (i * 8, i)).collect();
    let mut table = thinning::Table::new();
    table.clear(3);
    let place = |key: u64| key.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    for round in 0..2 {
        for (key, rating) in &entries {
            let stored = table.rating_mut(*key, place);
            if round == 0 {
                *stored = *rating;
                table.count_added(place);
            }
            assert_eq!(*table.rating_mut(*key, place), *rating);
        }
    }
}
