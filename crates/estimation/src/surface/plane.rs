//! The plane of a neighbourhood.

use crate::cloud::StructureTensor;
use crate::geometry::Vec3;

/// The least-squares plane of points, and their variance about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// x̄, metres.
    pub mean_m: Vec3,
    /// Unit normal, of either sign.
    pub normal: Vec3,
    /// λ₃, m²: the mean squared distance of the points from the plane.
    pub variance_m2: f64,
}

impl Plane {
    /// Fits a plane to the `points` with the indices `members`.
    pub fn fit(points: &[Vec3], members: &[u32]) -> Self {
        let tensor = StructureTensor::of(points, members);
        let eigen = tensor.eigen();
        Self {
            mean_m: tensor.mean,
            normal: eigen.vectors.column(2).into(),
            variance_m2: eigen.values.z,
        }
    }
}
