//! Neighbours, voxels and structure tensor, compared with slow, obvious references and with another
//! program on the same data.

use crate::common;
use crate::common::kernels::{naive_covariance, read_las};
use crate::common::tables::numbers;
use boresight::cloud::voxel::{thin, thin_by, voxel_key};
use boresight::cloud::{NeighbourIndex, Neighbourhood, StructureTensor, Surroundings};
use boresight::geometry::{Mat3, Vec3};
use boresight::progress::Silent;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Squared distances and indices, sorted by distance, then by index: the definition.
fn brute_order(points: &[Vec3], query: &Vec3) -> Vec<(f64, u32)> {
    let mut all: Vec<(f64, u32)> = points
        .iter()
        .zip(0..)
        .map(|(p, index)| ((p - query).norm_squared(), index))
        .collect();
    all.sort_by(|a, b| a.partial_cmp(b).unwrap());
    all
}

/// Both sum in different orders, which leaves √n roundings of the largest entry, of offsets up to the
/// reach, or of the coordinates of the mean.
fn check_tensor(near: &Surroundings, expected: &StructureTensor, reach_m: f64) {
    assert_eq!(near.tensor.count, expected.count);
    assert_eq!(near.reach_m.is_finite(), reach_m.is_finite());
    if reach_m.is_finite() {
        assert!((near.reach_m - reach_m).abs() <= 4.0 * f64::EPSILON * reach_m);
    }
    if expected.count == 0 {
        assert!(near.tensor.mean.iter().all(|x| x.is_nan()));
        return;
    }
    if !expected.covariance.trace().is_finite() {
        return;
    }
    let n = expected.count as f64;
    let tolerance = 8.0 * f64::EPSILON * n.sqrt();
    let difference = (near.tensor.covariance - expected.covariance).norm();
    assert!(
        difference <= tolerance * 16.0 * expected.covariance.trace(),
        "{difference:e} of {:e}, {n} points",
        expected.covariance.trace()
    );
    let shift = (near.tensor.mean - expected.mean).norm();
    assert!(
        shift <= tolerance * (expected.mean.norm() + expected.covariance.trace().sqrt()),
        "{shift:e}"
    );
}

#[test]
fn an_index_of_a_part_in_the_extent_of_the_whole_gives_the_same_bits() {
    for (name, points) in nasty_clouds() {
        let [low, high] = [f64::min, f64::max].map(|end| {
            points
                .iter()
                .copied()
                .reduce(|a, b| a.zip_map(&b, end))
                .unwrap_or_default()
        });
        let index = NeighbourIndex::new(&points);
        let place: Vec<usize> = {
            let mut place = vec![0; points.len()];
            for (at, &i) in index.spatial_order().iter().enumerate() {
                place[i as usize] = at;
            }
            place
        };
        // The lower half of the cloud along x.
        let middle = (low.x + high.x) / 2.0;
        let part: Vec<usize> = (0..points.len())
            .filter(|&i| points[i].x <= middle)
            .collect();
        let some: Vec<Vec3> = part.iter().map(|&i| points[i]).collect();
        let partial = NeighbourIndex::in_extent(&some, &low, &high);
        let order = partial
            .spatial_order()
            .iter()
            .map(|&i| place[part[i as usize]]);
        assert!(order.is_sorted(), "{name}");
        // Compare the neighbourhoods that lie completely within the part.
        for neighbourhood in [Neighbourhood::Nearest(20), Neighbourhood::Within(0.05)] {
            let [all, of_part] = [&index, &partial].map(|index| {
                let copy = |_: usize, near: &Surroundings| *near;
                index.surroundings(&some, neighbourhood, &Silent, copy)
            });
            for ((all, of_part), point) in all.unwrap().iter().zip(&of_part.unwrap()).zip(&some) {
                if all.reach_m < middle - point.x {
                    assert_eq!(all, of_part, "{name}");
                }
            }
        }
    }
}

#[test]
fn neighbours_are_right_at_astronomical_distances() {
    // Squared distances that overflow f32, and in the second case f64 as well.
    for (far, radii) in [(1e25, &[2e25][..]), (1e160, &[])] {
        let points: Vec<Vec3> = (0..300)
            .map(|i| Vec3::new(far * f64::from(i), 0.0, f64::from(i % 7)))
            .collect();
        check_neighbours(&points, &points[..40], &[3, 50], radii);
    }
}

fn check_neighbours(points: &[Vec3], queries: &[Vec3], ks: &[usize], radii: &[f64]) {
    let index = NeighbourIndex::new(points);
    let mut neighbours = Vec::new();
    for query in queries {
        let brute = brute_order(points, query);
        for &k in ks {
            index.nearest(query, k, &mut neighbours);
            let expected: Vec<u32> = brute.iter().take(k).map(|pair| pair.1).collect();
            assert_eq!(neighbours, expected, "k = {k} at {query:?}");
        }
        // A radius that is exactly the distance of a point tests that the ball is closed.
        let exact = brute.get(brute.len() / 2).map(|pair| pair.0.sqrt());
        for radius in radii.iter().copied().chain(exact) {
            index.within(query, radius, &mut neighbours);
            let mut expected: Vec<u32> = brute
                .iter()
                .filter(|pair| pair.0 <= radius * radius)
                .map(|pair| pair.1)
                .collect();
            expected.sort_unstable();
            assert_eq!(neighbours, expected, "radius = {radius} at {query:?}");
        }
    }
    for &k in ks {
        let all = index.nearest_of_all(queries, k);
        let tensors = index.surroundings(queries, Neighbourhood::Nearest(k), &Silent, |at, s| {
            (at, *s)
        });
        let tensors = tensors.unwrap();
        let k_found = k.min(points.len());
        assert_eq!(all.len(), queries.len() * k_found);
        for (at, query) in queries.iter().enumerate() {
            let brute = brute_order(points, query);
            let mut expected: Vec<u32> = brute.iter().take(k).map(|pair| pair.1).collect();
            let reach_m = match expected.last() {
                Some(last) if expected.len() == k => (points[*last as usize] - query).norm(),
                _ => f64::INFINITY,
            };
            check_tensor(
                &tensors[at].1,
                &StructureTensor::of(points, &expected),
                reach_m,
            );
            assert_eq!(tensors[at].0, at);
            let mut members = all[at * k_found..(at + 1) * k_found].to_vec();
            members.sort_unstable();
            expected.sort_unstable();
            assert_eq!(members, expected, "all, k = {k} at {query:?}");
        }
    }
    for &radius in radii {
        let tensors = index
            .surroundings(queries, Neighbourhood::Within(radius), &Silent, |_, s| *s)
            .unwrap();
        for (tensor, query) in tensors.iter().zip(queries) {
            index.within(query, radius, &mut neighbours);
            check_tensor(tensor, &StructureTensor::of(points, &neighbours), radius);
        }
    }
    let mut order = index.spatial_order().to_vec();
    order.sort_unstable();
    assert!(order.into_iter().eq(0..points.len() as u32));
}

/// Clouds that have broken neighbour searches: name and points.
fn nasty_clouds() -> Vec<(&'static str, Vec<Vec3>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut uniform =
        |scale: Vec3| Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0)).component_mul(&scale);
    let utm = Vec3::new(362_328.5, 5_157_700.25, 108.5);
    let random: Vec<Vec3> = (0..1500).map(|_| uniform(Vec3::repeat(2.0))).collect();
    let grid: Vec<Vec3> = (0..1000)
        .map(|i| {
            Vec3::new(
                f64::from(i % 10),
                f64::from(i / 10 % 10),
                f64::from(i / 100),
            ) * 0.25
        })
        .collect();
    let line: Vec<Vec3> = (0..700)
        .map(|i| Vec3::new(1.0, 2.0, -3.0) * f64::from(i % 350) * 0.01)
        .collect();
    let one_place = vec![Vec3::new(1.0, 2.0, 3.0); 500];
    let mut uneven: Vec<Vec3> = (0..1200)
        .map(|_| uniform(Vec3::new(0.01, 0.01, 1e-6)))
        .collect();
    uneven.extend((0..100).map(|_| uniform(Vec3::repeat(50.0))));
    uneven.extend((0..10).map(|_| uniform(Vec3::repeat(1e7))));
    uneven.extend(vec![Vec3::new(0.001, 0.002, 0.0); 90]);
    let far: Vec<Vec3> = (0..800)
        .map(|_| utm + uniform(Vec3::new(0.5, 0.5, 0.01)))
        .collect();
    let quantised: Vec<Vec3> = far
        .iter()
        .map(|p| p.map(|x| (x * 100.0).round() / 100.0))
        .collect();
    vec![
        ("empty", Vec::new()),
        ("one point", vec![Vec3::new(1.0, 2.0, 3.0)]),
        ("random", random),
        ("grid", grid),
        ("line, every point twice", line),
        ("one place", one_place),
        ("dense plane in a sparse scene", uneven),
        ("projected coordinates", far),
        ("projected coordinates in centimetres", quantised),
    ]
}

#[test]
fn neighbours_are_those_of_brute_force_on_nasty_clouds() {
    for (name, points) in nasty_clouds() {
        println!("{name}");
        let mut queries: Vec<Vec3> = points.iter().step_by(37).copied().collect();
        queries.extend(
            points
                .iter()
                .step_by(101)
                .map(|p| p + Vec3::new(0.013, -0.2, 0.11)),
        );
        queries.push(Vec3::new(-1e6, 3.0, 1e9));
        check_neighbours(
            &points,
            &queries,
            &[0, 1, 2, 50, 333, 5000],
            &[0.0, 0.1, 0.25, 3.0, 1e8],
        );
    }
}

proptest! {
    #[test]
    fn neighbours_are_those_of_brute_force(
        cells in prop::collection::vec((-6..6i32, -6..6i32, -2..2i32), 0..400),
        query in (-7..7i32, -7..7i32, -3..3i32),
        step in prop::sample::select(vec![1.0, 0.1, 1e-4]),
        k in 1..120usize,
        radius in 0.0..5.0f64,
    ) {
        // Few distinct places: many ties and duplicates.
        let place = |(x, y, z): (i32, i32, i32)| Vec3::new(x.into(), y.into(), z.into()) * step;
        let points: Vec<Vec3> = cells.into_iter().map(place).collect();
        check_neighbours(&points, &[place(query)], &[k], &[radius * step]);
    }
}

#[test]
fn points_with_nan_coordinates_are_never_found() {
    let mut points: Vec<Vec3> = (0..200)
        .map(|i| Vec3::new(f64::from(i), 0.0, 0.0))
        .collect();
    for (i, point) in points.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
        point[i % 2] = f64::NAN;
    }
    let index = NeighbourIndex::new(&points);
    let mut neighbours = Vec::new();
    index.nearest(&Vec3::new(100.2, 0.0, 0.0), 3, &mut neighbours);
    assert_eq!(neighbours, [100, 101, 98]);
    index.nearest(&Vec3::zeros(), 200, &mut neighbours);
    assert_eq!(neighbours.len(), 133);
    index.within(&Vec3::zeros(), 1e9, &mut neighbours);
    assert_eq!(neighbours.len(), 133);
    index.nearest(&Vec3::new(f64::NAN, 0.0, 0.0), 3, &mut neighbours);
    assert!(neighbours.is_empty());
}

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

#[test]
fn the_tensor_equals_the_definition_near_the_origin_and_is_as_accurate_far_away() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for flatness in [1.0, 1e-2, 1e-4] {
        // Multiples of 2⁻²⁰ m can be moved to projected coordinates without rounding.
        let points: Vec<Vec3> = (0..50)
            .map(|_| {
                let x = Vec3::new(
                    rng.random_range(-1.0..1.0),
                    rng.random_range(-0.3..0.3),
                    flatness * rng.random_range(-0.1..0.1),
                );
                x.map(|x| (x * 1_048_576.0).round() / 1_048_576.0)
            })
            .collect();
        let tensor = StructureTensor::from_points(&points);
        let naive = naive_covariance(&points);
        assert!((tensor.covariance - naive).norm() < 1e-15 * naive.norm());
        let determinant = naive.determinant();
        let omnivariance = tensor.omnivariance();
        assert!((omnivariance / determinant.cbrt() - 1.0).abs() < 1e-9);

        let utm = Vec3::new(362_328.5, 5_157_700.25, 108.5);
        let moved: Vec<Vec3> = points.iter().map(|p| p + utm).collect();
        let far = StructureTensor::from_points(&moved);
        assert!((far.covariance - tensor.covariance).norm() < 1e-15 * naive.norm());
        assert!((far.omnivariance() / omnivariance - 1.0).abs() < 1e-9);
        // Half a unit in the last place of the northing.
        assert!((far.mean - utm - tensor.mean).norm() < 5e-10);
    }
}

/// A covariance with known eigenvalues: the points ±√(3 λᵢ) along rotated axes.
fn star(values: [f64; 3], rotation: &Mat3) -> Vec<Vec3> {
    (0..3)
        .flat_map(|i| {
            let tip: Vec3 = rotation.column(i) * (3.0 * values[i]).sqrt();
            [tip, -tip]
        })
        .collect()
}

#[test]
fn eigenvalues_of_flat_neighbourhoods_are_accurate() {
    let rotation = *nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.4).matrix();
    for values in [
        [1.0, 1.0, 1.0],
        [2.0, 1.0, 1e-4],
        [1e-4, 1e-4, 1e-10],
        [5.0, 1e-3, 1e-11],
    ] {
        let tensor = StructureTensor::from_points(&star(values, &rotation));
        let eigen = tensor.eigen();
        for i in 0..3 {
            // The entries of the covariance are rounded relative to its largest value.
            let error = (eigen.values[i] - values[i]).abs();
            assert!(
                error < 4.0 * f64::EPSILON * values[0],
                "{values:?}: {error:e}"
            );
        }
        let rebuilt =
            eigen.vectors * Mat3::from_diagonal(&eigen.values) * eigen.vectors.transpose();
        assert!((rebuilt - tensor.covariance).norm() < 1e-15 * values[0]);
        assert!((eigen.vectors.transpose() * eigen.vectors - Mat3::identity()).norm() < 1e-15);
        let expected = (values[0] * values[1] * values[2]).cbrt();
        let tolerance = 8.0 * f64::EPSILON * values[0] / values[2];
        assert!((tensor.omnivariance() / expected - 1.0).abs() < tolerance);
        if values[1] > values[2] {
            let normal = tensor.normal().unwrap();
            assert!(normal.cross(&rotation.column(2)).norm() < 1e-15 * values[0] / values[1]);
        }
    }
}

#[test]
fn degenerate_neighbourhoods_have_defined_results() {
    let a = Vec3::new(362_328.1, 5_157_700.7, 108.3);
    let (u, v) = (Vec3::new(0.3, 0.1, -0.7), Vec3::new(0.2, -0.9, 0.4));
    let plane: Vec<Vec3> = (0..20)
        .map(|i| u * f64::from(i % 5) + v * f64::from(i / 5))
        .collect();
    let line: Vec<Vec3> = (0..20).map(|i| u * f64::from(i)).collect();
    let cases: [(&str, Vec<Vec3>, usize); 5] = [
        ("plane", plane, 2),
        ("line", line, 1),
        ("one place", vec![a; 9], 0),
        ("one point", vec![a], 0),
        ("three points", vec![a, a + u, a + v], 2),
    ];
    for (name, points, rank) in cases {
        let tensor = StructureTensor::from_points(&points);
        assert_eq!(tensor.omnivariance(), 0.0, "{name}");
        let values = tensor.eigen().values;
        assert_eq!(
            values.iter().filter(|value| **value > 0.0).count(),
            rank,
            "{name}: {values:?}"
        );
        match tensor.normal() {
            Some(normal) => {
                assert_eq!(rank, 2, "{name}");
                assert!(
                    normal.cross(&u.cross(&v).normalize()).norm() < 1e-8,
                    "{name}"
                );
            }
            None => assert!(rank < 2, "{name}"),
        }
    }
    let none = StructureTensor::from_points(&[]);
    assert!(none.omnivariance().is_nan() && none.eigen().values.x.is_nan());
    assert_eq!((none.normal(), none.count), (None, 0));
}

#[test]
fn omnivariance_equals_jakteristics() {
    let folder = common::data("jakteristics");
    let points = read_las(&folder.join("test_0.02_seconde.las"));
    let table = numbers(&folder.join("omnivariance.npy"));
    assert_eq!(points.len(), table.len());
    let index = NeighbourIndex::new(&points);
    let mut neighbours = Vec::new();
    let (mut worst, mut worst_value, mut other_count, mut flat) = (0.0f64, 0.0f64, 0, 0);
    for (point, row) in points.iter().zip(&table) {
        index.within(point, 0.5, &mut neighbours);
        let (ours, n) = (StructureTensor::of(&points, &neighbours), row[1]);
        if ours.count as f64 != n {
            // In the file, which is rounded to millimetres, some neighbours are exactly 0.5 m away;
            // rounding decides whether they are inside.
            other_count += 1;
            continue;
        }
        let unbiased = n / (n - 1.0);
        if ours.count < 4 {
            // One to three points have no volume: 0 here, the rounding of zero in the file.
            assert_eq!(ours.omnivariance(), 0.0);
            assert!(ours.count == 1 || row[4] < 1e-15 * row[2]);
            flat += 1;
            continue;
        }
        worst = worst.max((ours.omnivariance() * unbiased / row[0] - 1.0).abs());
        let values = ours.eigen().values * unbiased;
        for (value, expected) in values.iter().zip(&row[2..5]) {
            worst_value = worst_value.max((value / expected - 1.0).abs());
        }
    }
    println!(
        "{} points, {other_count} with another count, {flat} below 4 points, omnivariance within {worst:.2e}, \
         eigenvalues within {worst_value:.2e}",
        points.len()
    );
    // The values in the file have single precision, with a unit in the last place of 1.2e-7.
    assert!(worst < 1.3e-7 && worst_value < 1.3e-7);
    assert!(other_count * 1000 < points.len());
}

/// Coinciding points share their neighbours, and a search among them ends with the smallest indices:
/// each of these clouds would take hours if every query visited all of them.
#[test]
fn coinciding_points_take_no_more_time_than_others() {
    const MANY: usize = 100_000;
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let mut surface = |count: usize| -> Vec<Vec3> {
        let point = |_| {
            Vec3::new(
                random.random(),
                random.random(),
                0.01 * random.random::<f64>(),
            )
        };
        (0..count).map(point).collect()
    };
    let place = Vec3::new(0.5, 0.5, 0.005);
    let mut clustered = surface(MANY / 2);
    clustered.extend(std::iter::repeat_n(place, MANY / 2));
    let mut with_outlier = surface(MANY);
    with_outlier.push(Vec3::new(1e30, -1e30, 0.0));
    // From 1e-30 to 1e30: for each point, some neighbours are nearer by many powers of ten.
    let magnitude = |x: f64| (2.0 * x - 1.0).signum() * 10f64.powf(60.0 * x - 30.0);
    let all_sizes = surface(MANY / 4).iter().map(|p| p.map(magnitude)).collect();
    let clouds = [
        ("of all sizes", all_sizes),
        ("at one place", vec![place; MANY]),
        ("half of them at one place", clustered),
        ("one far away", with_outlier),
    ];
    for (name, points) in clouds {
        let start = std::time::Instant::now();
        let index = NeighbourIndex::new(&points);
        let mut some: Vec<Vec3> = points.iter().step_by(MANY / 7).copied().collect();
        some.push(place + Vec3::new(0.0, 0.0, 0.001));
        let mut neighbours = Vec::new();
        for query in &some {
            let brute = brute_order(&points, query);
            index.nearest(query, 50, &mut neighbours);
            let expected: Vec<u32> = brute.iter().take(50).map(|pair| pair.1).collect();
            assert_eq!(neighbours, expected, "{name}");
        }
        let nearest = Neighbourhood::Nearest(50);
        let all = index
            .surroundings(&points, nearest, &Silent, |_, s| *s)
            .unwrap();
        for query in &some[..some.len() - 1] {
            let alone = index
                .surroundings(&[*query], nearest, &Silent, |_, s| *s)
                .unwrap();
            let at = points.iter().position(|point| point == query).unwrap();
            assert_eq!(all[at].reach_m, alone[0].reach_m, "{name}");
            assert_eq!(all[at].tensor.count, alone[0].tensor.count, "{name}");
        }
        let members = index.nearest_of_all(&points, 20);
        assert_eq!(members.len(), 20 * points.len());
        let within = Neighbourhood::Within(0.003);
        let counts = index
            .surroundings(&points, within, &Silent, |_, s| s.tensor.count)
            .unwrap();
        index.within(&points[0], 0.003, &mut neighbours);
        assert_eq!(counts[0], neighbours.len(), "{name}");
        let thinned = thin(&points, 0.01);
        assert!(!thinned.is_empty() && thinned.len() <= points.len());
        let took = start.elapsed();
        println!("{name}: {took:.2?}");
        assert!(took.as_secs() < 30, "{name}: {took:?}");
    }
}
