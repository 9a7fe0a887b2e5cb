//! Rotations, rigid transforms, Euler conventions, headings, projections of the ellipsoid.
//!
//! A transform is named after what it maps: `world_from_body * body_from_scanner` is
//! `world_from_scanner`; adjacent frames cancel. [`Transform`] defines how it is perturbed.

pub mod attitude;
mod bending;
pub mod euler;
mod geocentric;
mod grid;
pub mod heading;
#[cfg_attr(not(feature = "projections"), path = "projection_absent.rs")]
mod projection;
pub mod so3;
mod transform;

pub use bending::{Bending, bent};
pub use euler::EulerConvention;
pub use geocentric::Geodetic;
pub use grid::{GridPoint, Misfit};
pub use heading::BodyAxes;
pub use projection::Projection;
pub use transform::{
    Body, BodyFromScanner, Scanner, Transform, World, WorldFromBody, WorldFromScanner,
};

/// A vector or point, in metres unless its name says otherwise.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A 3 × 3 matrix.
pub type Mat3 = nalgebra::Matrix3<f64>;
/// A rotation as a unit quaternion (Hamilton; stored x, y, z, w).
pub type Rotation = nalgebra::UnitQuaternion<f64>;

/// `matrix` · `x`. nalgebra's operator is a call of a loop over rows and columns, which takes most of the time of loops
/// over points; this is compiled into them, with the same result to the last bit.
#[inline]
pub fn product(matrix: &Mat3, x: &Vec3) -> Vec3 {
    let row = |i: usize| matrix[(i, 0)] * x.x + matrix[(i, 1)] * x.y + matrix[(i, 2)] * x.z;
    Vec3::new(row(0), row(1), row(2))
}

/// `matrix`ᵀ · `x`, like [`product`].
#[inline]
pub fn transposed_product(matrix: &Mat3, x: &Vec3) -> Vec3 {
    let row = |i: usize| matrix[(0, i)] * x.x + matrix[(1, i)] * x.y + matrix[(2, i)] * x.z;
    Vec3::new(row(0), row(1), row(2))
}

/// Whether all components of `x` are finite.
#[inline]
pub fn is_finite(x: &Vec3) -> bool {
    x.iter().all(|component| component.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_nalgebra_to_the_last_bit() {
        for turn in 0..100 {
            let angles = Vec3::new(0.31, -0.17, 0.05) * f64::from(turn);
            let matrix = so3::exp(&angles).to_rotation_matrix().into_inner();
            let x = Vec3::new(1.7, -0.3, 0.9) * f64::from(turn + 1);
            assert_eq!(product(&matrix, &x), matrix * x);
            assert_eq!(transposed_product(&matrix, &x), matrix.tr_mul(&x));
        }
    }
}
