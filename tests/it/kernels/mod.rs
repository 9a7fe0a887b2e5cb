//! Neighbours, voxels and structure tensor, compared with slow, obvious references and with another
//! program on the same data.

mod neighbours;
mod tensor;
mod thinning;

use boresight::geometry::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

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
