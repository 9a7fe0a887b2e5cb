//! Structure tensor, its eigenvalues, and omnivariance.

use crate::common;
use crate::common::kernels::{naive_covariance, read_las};
use crate::common::tables::numbers;
use boresight::cloud::{NeighbourIndex, StructureTensor};
use boresight::geometry::{Mat3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

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
