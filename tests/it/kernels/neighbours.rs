//! Nearest neighbours and those within a radius, with their tensors.

use std::cmp::Ordering;

use super::nasty_clouds;
use boresight::cloud::voxel::thin;
use boresight::cloud::{NeighbourIndex, Neighbourhood, StructureTensor, Surroundings};
use boresight::geometry::Vec3;
use boresight::progress::Silent;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Squared distances and indices, sorted by distance, then by index: the definition.
fn brute_order(points: &[Vec3], query: &Vec3) -> Vec<(f64, u32)> {
    let mut all = distances(points, query);
    all.sort_by(by_distance);
    all
}

/// The squared distance of each point from the query, and its index.
fn distances(points: &[Vec3], query: &Vec3) -> Vec<(f64, u32)> {
    let distances = points.iter().map(|point| (point - query).norm_squared());
    distances.zip(0..).collect()
}

fn by_distance(a: &(f64, u32), b: &(f64, u32)) -> Ordering {
    a.partial_cmp(b).unwrap()
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

/// Coinciding points share their neighbours, and a search among them ends with the smallest indices:
/// each of these clouds would take hours if every query visited all of them.
#[test]
fn coinciding_points_take_no_more_time_than_others() {
    const MANY: usize = 200_000;
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
            let mut brute = distances(&points, query);
            brute.select_nth_unstable_by(50, by_distance);
            brute.truncate(50);
            brute.sort_by(by_distance);
            index.nearest(query, 50, &mut neighbours);
            let expected: Vec<u32> = brute.iter().map(|pair| pair.1).collect();
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
