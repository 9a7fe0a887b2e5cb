//! Rotations, rigid transforms, Euler conventions, headings.
//!
//! A transform is named after what it maps: `world_from_body * body_from_scanner` is
//! `world_from_scanner`; adjacent frames cancel.

pub mod euler;
pub mod heading;
pub mod so3;

pub use euler::EulerConvention;
pub use heading::BodyAxes;

/// A vector or point, metres unless its name says otherwise.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A 3 × 3 matrix.
pub type Mat3 = nalgebra::Matrix3<f64>;
/// A rotation as a unit quaternion (Hamilton; stored x, y, z, w).
pub type Rotation = nalgebra::UnitQuaternion<f64>;
/// A rigid transform: rotation, then translation in metres. `pose * Point3` maps points;
/// [`transform`] maps a [`Vec3`] taken as a point.
pub type Pose = nalgebra::Isometry3<f64>;

/// Maps the point `x` by `pose`: R x + t.
#[inline]
pub fn transform(pose: &Pose, x: &Vec3) -> Vec3 {
    pose.rotation * x + pose.translation.vector
}

/// Whether no component of `x` is infinite or NaN.
#[inline]
pub(crate) fn is_finite(x: &Vec3) -> bool {
    x.iter().all(|component| component.is_finite())
}

/// The pose with this rotation and translation (metres).
pub fn pose(rotation: Rotation, translation: Vec3) -> Pose {
    Pose::from_parts(translation.into(), rotation)
}
