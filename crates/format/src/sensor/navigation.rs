//! Angles of navigation, their standard deviations, and poses on an ellipsoid.

use super::PoseSigma;
use crate::geometry::attitude::from_roll_pitch_heading;
use crate::geometry::{Rotation, Vec3};

/// The angles of navigation of a body with x forward, y left, z up, radians: roll is positive with the right side down,
/// pitch with the nose up, heading clockwise from north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavigationAngles {
    /// Radians.
    pub roll: f64,
    /// Radians.
    pub pitch: f64,
    /// Radians.
    pub heading: f64,
}

/// Standard deviations of a position and of the angles of navigation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavigationSigma {
    /// East, north, up, metres.
    pub position_m: Vec3,
    /// Roll, pitch, heading, radians.
    pub angles: NavigationAngles,
}

/// One pose of a body on an ellipsoid, usually WGS 84.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeographicPose {
    /// Seconds.
    pub time_s: f64,
    /// Positive to the north, radians.
    pub latitude_rad: f64,
    /// Positive to the east, radians.
    pub longitude_rad: f64,
    /// Above the ellipsoid, metres.
    pub height_m: f64,
    /// The heading counts from true north.
    pub angles: NavigationAngles,
    /// To the east, to the north and upwards if the file gives it, m/s.
    pub velocity_m_s: Option<Vec3>,
    /// Standard deviations if the file gives them.
    pub sigma: Option<NavigationSigma>,
}

impl GeographicPose {
    /// Checks latitude and longitude.
    ///
    /// # Errors
    /// There is no such place: what was found, in words.
    pub fn check(&self) -> Result<(), String> {
        let [latitude, longitude] = [self.latitude_rad, self.longitude_rad].map(f64::to_degrees);
        // Not a number must fail.
        if latitude.abs() <= 90.0 && longitude.abs() <= 360.0 {
            return Ok(());
        }
        Err(format!("latitude {latitude}°, longitude {longitude}°"))
    }
}

impl NavigationAngles {
    /// The angles in degrees as radians.
    pub fn from_deg([roll, pitch, heading]: [f64; 3]) -> Self {
        Self {
            roll: roll.to_radians(),
            pitch: pitch.to_radians(),
            heading: heading.to_radians(),
        }
    }

    /// world_from_body (east, north, up; x forward, y left, z up).
    pub fn rotation(&self) -> Rotation {
        from_roll_pitch_heading(self.roll, self.pitch, self.heading)
    }

    /// The standard deviations of a pose with these angles. An error of the roll turns the body about its x axis, one of
    /// the pitch about the level axis to its right, one of the heading about the vertical; they are independent.
    pub fn pose_sigma(&self, sigma: &NavigationSigma) -> PoseSigma {
        let (sin, cos) = self.heading.sin_cos();
        let NavigationSigma { position_m, angles } = sigma;
        let turns = [
            (self.rotation() * Vec3::x()) * angles.roll,
            Vec3::new(cos, -sin, 0.0) * angles.pitch,
            Vec3::z() * angles.heading,
        ];
        let variance: Vec3 = turns.iter().map(|turn| turn.component_mul(turn)).sum();
        PoseSigma {
            position_m: *position_m,
            rotation_rad: variance.map(f64::sqrt),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each angle is changed by its standard deviation.
    #[test]
    fn deviations_turn_the_body_about_their_axes() {
        let angles = NavigationAngles::from_deg([3.0, -20.0, 200.0]);
        let step = 1e-6;
        let changed = |roll: f64, pitch: f64, heading: f64| {
            let other = NavigationAngles {
                roll: angles.roll + roll,
                pitch: angles.pitch + pitch,
                heading: angles.heading + heading,
            };
            (other.rotation() * angles.rotation().inverse()).scaled_axis()
        };
        let sigma = |[roll, pitch, heading]: [f64; 3]| {
            let sigma = NavigationSigma {
                position_m: Vec3::new(1.0, 2.0, 3.0),
                angles: NavigationAngles {
                    roll,
                    pitch,
                    heading,
                },
            };
            angles.pose_sigma(&sigma)
        };
        let mut sum = Vec3::zeros();
        for given in [[step, 0.0, 0.0], [0.0, step, 0.0], [0.0, 0.0, step]] {
            let turn = changed(given[0], given[1], given[2]);
            let found = sigma(given);
            assert!(
                (found.rotation_rad - turn.abs()).amax() < 1e-11,
                "{found:?} {turn}"
            );
            assert_eq!(found.position_m, Vec3::new(1.0, 2.0, 3.0));
            sum += turn.component_mul(&turn);
        }
        let all = sigma([step; 3]).rotation_rad;
        assert!((all.component_mul(&all) - sum).amax() < 1e-17);
    }
}
