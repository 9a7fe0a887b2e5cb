//! Rotations, rigid transforms, Euler conventions, headings, projections of the ellipsoid.
//!
//! A transform is named after what it maps: `world_from_body * body_from_scanner` is
//! `world_from_scanner`; adjacent frames cancel. [`Transform`] defines how it is perturbed.

pub mod attitude;
mod bending;
pub mod euler;
mod grid;
pub mod heading;
#[cfg_attr(not(feature = "projections"), path = "projection_absent.rs")]
mod projection;
pub mod so3;
mod transform;

pub use bending::{Bending, bent};
pub use euler::EulerConvention;
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
/// Whether all components of `x` are finite.
#[inline]
pub fn is_finite(x: &Vec3) -> bool {
    x.iter().all(|component| component.is_finite())
}
