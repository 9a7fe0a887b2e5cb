//! Body axes and headings.

use serde::{Deserialize, Serialize};

use super::{Rotation, Vec3};

/// The axis convention of the IMU and thereby of the body frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum BodyAxes {
    /// x forward, y right, z down (SBG, the paper).
    #[default]
    #[serde(rename = "FRD")]
    Frd,
    /// x forward, y left, z up (ROS).
    #[serde(rename = "FLU")]
    Flu,
}

impl BodyAxes {
    /// The body's upward direction in body axes.
    pub fn up(self) -> Vec3 {
        match self {
            Self::Frd => -Vec3::z(),
            Self::Flu => Vec3::z(),
        }
    }

    /// The rotation from x forward, y left, z up to these axes; its own inverse.
    pub fn body_from_flu(self) -> Rotation {
        match self {
            Self::Flu => Rotation::identity(),
            Self::Frd => Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI),
        }
    }

    /// The rotation world_from_body of a level body with this heading (radians, clockwise from
    /// north).
    pub fn level_world_from_body(self, heading_rad: f64) -> Rotation {
        let yaw = std::f64::consts::FRAC_PI_2 - heading_rad;
        let flu = Rotation::from_axis_angle(&Vec3::z_axis(), yaw);
        flu * self.body_from_flu()
    }
}

/// The heading (radians, clockwise from north, in (−π, π]) of the body's x axis.
pub fn heading_rad(world_from_body: &Rotation) -> f64 {
    let x = world_from_body * Vec3::x();
    x.x.atan2(x.y)
}

/// `angle` (radians) wrapped into (−π, π].
pub fn wrap(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let wrapped = angle - TAU * (angle / TAU).round();
    if wrapped <= -PI {
        wrapped + TAU
    } else {
        wrapped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn level_bodies_head_where_they_should_and_stand_upright() {
        for axes in [BodyAxes::Frd, BodyAxes::Flu] {
            for deg in [-170.0f64, -90.0, 0.0, 33.0, 90.0, 180.0] {
                let r = axes.level_world_from_body(deg.to_radians());
                assert!(wrap(heading_rad(&r) - deg.to_radians()).abs() < 1e-12);
                assert!((r * axes.up() - Vec3::z()).norm() < 1e-12);
            }
        }
    }
}
