//! Rigid transforms that carry their frames in their types.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::Quaternion;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::so3::{exp, log};
use super::{Rotation, Vec3};

/// The world frame: right-handed, z up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum World {}
/// The body frame: the axes of the IMU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {}
/// The frame of a scanner; a profile scanner measures in its x-z plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scanner {}

/// The pose of the body in the world.
pub type WorldFromBody = Transform<World, Body>;
/// The mounting of a scanner on the body.
pub type BodyFromScanner = Transform<Body, Scanner>;
/// The pose of a scanner in the world.
pub type WorldFromScanner = Transform<World, Scanner>;

/// A rigid transform that maps coordinates in `From` to coordinates in `To`: R x + t.
///
/// Transforms compose only if their adjacent frames agree:
///
/// ```
/// use boresight_cloud::geometry::{BodyFromScanner, WorldFromBody, WorldFromScanner};
/// let (world_from_body, body_from_scanner) = (WorldFromBody::identity(), BodyFromScanner::identity());
/// let world_from_scanner: WorldFromScanner = world_from_body * body_from_scanner;
/// ```
///
/// ```compile_fail
/// use boresight_cloud::geometry::{BodyFromScanner, WorldFromBody};
/// let wrong = BodyFromScanner::identity() * WorldFromBody::identity();
/// ```
///
/// # Perturbations
/// All Jacobians use one convention: (δφ, δp) perturb a transform with **δφ a rotation vector in
/// body axes**, radians, and δp added to the translation, metres.
///
/// | transform | perturbed |
/// |---|---|
/// | `world_from_body` | R ← R Exp(δφ), t ← t + δp, δp in world axes |
/// | `body_from_scanner` | R ← Exp(δφ) R, t ← t + δp, δp in body axes |
///
/// Both rotations of equation (1) are therefore perturbed about the same axes: a point x_m = t_mb +
/// R_mb (t_bs + R_bs x_s) moves by
/// δp_mb + R_mb (δφ_mb × (t_bs + R_bs x_s) + δp_bs + δφ_bs × R_bs x_s).
pub struct Transform<To, From> {
    /// R.
    pub rotation: Rotation,
    /// t: the origin of `From` in `To`, metres.
    pub translation_m: Vec3,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Transform<To, From> {
    /// The transform with this rotation and translation (metres).
    #[inline]
    pub fn new(rotation: Rotation, translation_m: Vec3) -> Self {
        Self {
            rotation,
            translation_m,
            frames: PhantomData,
        }
    }

    /// The identity: both frames coincide.
    #[inline]
    pub fn identity() -> Self {
        Self::new(Rotation::identity(), Vec3::zeros())
    }

    /// The inverse transform.
    #[inline]
    pub fn inverse(&self) -> Transform<From, To> {
        let rotation = self.rotation.inverse();
        Transform::new(rotation, -(rotation * self.translation_m))
    }

    /// The coordinates in `To` of the point that has the coordinates `x` in `From`: R x + t.
    #[inline]
    pub fn map(&self, x: &Vec3) -> Vec3 {
        self.rotation * x + self.translation_m
    }

    /// The coordinates in `From` of the point that has the coordinates `x` in `To`: R⁻¹ (x − t).
    /// More accurate than the inverse transform if x and t are large and close together.
    #[inline]
    pub fn map_back(&self, x: &Vec3) -> Vec3 {
        self.rotation.inverse() * (x - self.translation_m)
    }
}

impl WorldFromBody {
    /// R Exp(δφ), t + δp: see [perturbations](Transform#perturbations).
    #[inline]
    pub fn perturbed(&self, dphi_rad: &Vec3, dp_m: &Vec3) -> Self {
        let rotation = self.rotation * exp(dphi_rad);
        Self::new(normalised(rotation), self.translation_m + dp_m)
    }

    /// The perturbation (δφ, δp) that leads from `origin` to this transform.
    pub fn perturbation_from(&self, origin: &Self) -> (Vec3, Vec3) {
        (
            log(&(origin.rotation.inverse() * self.rotation)),
            self.translation_m - origin.translation_m,
        )
    }
}

impl BodyFromScanner {
    /// Exp(δφ) R, t + δp: see [perturbations](Transform#perturbations).
    #[inline]
    pub fn perturbed(&self, dphi_rad: &Vec3, dp_m: &Vec3) -> Self {
        let rotation = exp(dphi_rad) * self.rotation;
        Self::new(normalised(rotation), self.translation_m + dp_m)
    }

    /// The perturbation (δφ, δp) that leads from `origin` to this transform.
    pub fn perturbation_from(&self, origin: &Self) -> (Vec3, Vec3) {
        (
            log(&(self.rotation * origin.rotation.inverse())),
            self.translation_m - origin.translation_m,
        )
    }
}

/// Renormalises a rotation, as products of many drift off the unit sphere.
fn normalised(rotation: Rotation) -> Rotation {
    Rotation::new_normalize(rotation.into_inner())
}

impl<To, Between, From> Mul<Transform<Between, From>> for Transform<To, Between> {
    type Output = Transform<To, From>;

    #[inline]
    fn mul(self, other: Transform<Between, From>) -> Transform<To, From> {
        Transform::new(
            self.rotation * other.rotation,
            self.translation_m + self.rotation * other.translation_m,
        )
    }
}

// Derived impls would require the same traits of the frames, which are uninhabited.
impl<To, From> Clone for Transform<To, From> {
    #[inline]
    fn clone(&self) -> Self {
        *self
    }
}

impl<To, From> Copy for Transform<To, From> {}

impl<To, From> PartialEq for Transform<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.rotation == other.rotation && self.translation_m == other.translation_m
    }
}

impl<To, From> fmt::Debug for Transform<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Transform")
            .field("rotation", &self.rotation)
            .field("translation_m", &self.translation_m)
            .finish()
    }
}

/// What a transform is serialised as.
#[derive(Serialize, Deserialize)]
struct Written {
    translation_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// Serialises as `translation_m` and `quaternion_xyzw`.
impl<To, From> Serialize for Transform<To, From> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Written {
            translation_m: self.translation_m.into(),
            quaternion_xyzw: self.rotation.coords.into(),
        }
        .serialize(serializer)
    }
}

/// Reads the output of [`Serialize`]. A quaternion in a text is normalised, because a user may have written it; in a
/// binary format it stays as it is, bit by bit.
impl<'de, To, From> Deserialize<'de> for Transform<To, From> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let is_text = deserializer.is_human_readable();
        let written = Written::deserialize(deserializer)?;
        let quaternion = Quaternion::from(written.quaternion_xyzw);
        let rotation = if is_text {
            Rotation::try_new(quaternion, f64::MIN_POSITIVE).ok_or_else(|| {
                D::Error::custom("quaternion_xyzw = [0, 0, 0, 0], which is not a rotation")
            })?
        } else {
            Rotation::new_unchecked(quaternion)
        };
        Ok(Self::new(rotation, written.translation_m.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_moves_as_the_convention_says() {
        let world_from_body =
            WorldFromBody::new(exp(&Vec3::new(0.3, -0.2, 1.1)), Vec3::new(4.0, -2.0, 1.5));
        let body_from_scanner =
            BodyFromScanner::new(exp(&Vec3::new(-2.1, 0.4, 0.7)), Vec3::new(1.2, -0.5, 0.6));
        let x = Vec3::new(0.2, 0.0, -1.1);
        let place = |d: &[Vec3; 4]| {
            (world_from_body.perturbed(&d[0], &d[1]) * body_from_scanner.perturbed(&d[2], &d[3]))
                .map(&x)
        };
        let arm = body_from_scanner.rotation * x;
        let lever = body_from_scanner.map(&x);
        let r = world_from_body.rotation;
        // Central differences with step 1e-6 are accurate to about 1e-10.
        let h = 1e-6;
        for (part, axis) in (0..4).flat_map(|part| (0..3).map(move |axis| (part, axis))) {
            let mut d = [Vec3::zeros(); 4];
            d[part][axis] = h;
            let numeric = (place(&d) - place(&d.map(|x| -x))) / (2.0 * h);
            d[part][axis] = 1.0;
            let moved = d[0].cross(&lever) + d[3] + d[2].cross(&arm);
            assert!((numeric - (d[1] + r * moved)).norm() < 1e-9);
        }
    }

    #[test]
    fn transforms_survive_a_round_trip_through_json() {
        let pose = BodyFromScanner::new(exp(&Vec3::new(-2.1, 0.4, 0.7)), Vec3::new(1.2, -0.5, 0.6));
        let text = serde_json::to_string(&pose).unwrap();
        let read: BodyFromScanner = serde_json::from_str(&text).unwrap();
        let (turn, shift) = read.perturbation_from(&pose);
        assert!(turn.norm() < 1e-15 && shift == Vec3::zeros());
        let none = text.replace(
            "\"quaternion_xyzw\":[",
            "\"quaternion_xyzw\":[0,0,0,0],\"old\":[",
        );
        assert!(serde_json::from_str::<BodyFromScanner>(&none).is_err());
    }

    #[test]
    fn an_inverse_maps_back() {
        let pose = WorldFromBody::new(exp(&Vec3::new(0.3, -0.2, 1.1)), Vec3::new(4.0, -2.0, 1.5));
        let x = Vec3::new(0.2, 0.7, -1.1);
        assert!((pose.inverse().map(&pose.map(&x)) - x).norm() < 1e-14);
        assert!((pose.map_back(&pose.map(&x)) - x).norm() < 1e-14);
        let identity = pose.inverse() * pose;
        assert!(identity.translation_m.norm() < 1e-14 && identity.rotation.angle() < 1e-14);
    }
}
