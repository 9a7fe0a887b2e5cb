//! Helpers shared by the tests of the kernels.

use std::path::Path;

use boresight::geometry::{Mat3, Vec3};

/// Σ (x − x̄)(x − x̄)ᵀ / n, computed literally.
pub fn naive_covariance(points: &[Vec3]) -> Mat3 {
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vec3>() / n;
    points
        .iter()
        .map(|p| (p - mean) * (p - mean).transpose())
        .sum::<Mat3>()
        / n
}

/// The coordinates of a LAS file.
pub fn read_las(path: &Path) -> Vec<Vec3> {
    let points = las::Reader::from_path(path).unwrap().read_all().unwrap();
    points
        .x()
        .zip(points.y())
        .zip(points.z())
        .map(|((x, y), z)| Vec3::new(x, y, z))
        .collect()
}
