//! Geocentric coordinates on WGS 84.

use super::{Rotation, Vec3};

/// Semi-major axis of WGS 84, metres.
const A_M: f64 = 6_378_137.0;
/// Flattening of WGS 84.
const F: f64 = 1.0 / 298.257_223_563;

/// A place by latitude, longitude and height above the ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Positive to the north.
    pub latitude_rad: f64,
    /// Positive to the east.
    pub longitude_rad: f64,
    /// Above the ellipsoid.
    pub height_m: f64,
}

impl Geodetic {
    /// The place of geocentric coordinates in metres, by the iteration of Bowring (1976): tan φ = (z + e'² b sin³ β) /
    /// (p − e² a cos³ β), tan β = (1 − f) tan φ. Two steps leave less than 10 nm from the sea floor to 9 km height.
    pub fn from_geocentric(at_m: &Vec3) -> Self {
        let e2 = F * (2.0 - F);
        let b_m = A_M * (1.0 - F);
        let across_m = at_m.x.hypot(at_m.y);
        let mut beta = at_m.z.atan2(across_m * (1.0 - F));
        let mut latitude_rad = 0.0;
        for _ in 0..2 {
            let (sin, cos) = beta.sin_cos();
            let z_m = at_m.z + e2 / (1.0 - e2) * b_m * sin.powi(3);
            latitude_rad = z_m.atan2(across_m - e2 * A_M * cos.powi(3));
            beta = ((1.0 - F) * latitude_rad.sin()).atan2(latitude_rad.cos());
        }
        let (sin, cos) = latitude_rad.sin_cos();
        Self {
            latitude_rad,
            longitude_rad: at_m.y.atan2(at_m.x),
            height_m: across_m * cos + at_m.z * sin - A_M * (1.0 - e2 * sin * sin).sqrt(),
        }
    }

    /// Turns vectors along the geocentric axes to east, north and up at this place.
    pub fn local_from_geocentric(&self) -> Rotation {
        use std::f64::consts::FRAC_PI_2;
        Rotation::from_axis_angle(&Vec3::x_axis(), self.latitude_rad - FRAC_PI_2)
            * Rotation::from_axis_angle(&Vec3::z_axis(), -self.longitude_rad - FRAC_PI_2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geocentric_m(at: &Geodetic) -> Vec3 {
        let e2 = F * (2.0 - F);
        let (sin, cos) = at.latitude_rad.sin_cos();
        let normal_m = A_M / (1.0 - e2 * sin * sin).sqrt();
        let across_m = (normal_m + at.height_m) * cos;
        Vec3::new(
            across_m * at.longitude_rad.cos(),
            across_m * at.longitude_rad.sin(),
            (normal_m * (1.0 - e2) + at.height_m) * sin,
        )
    }

    #[test]
    fn places_on_the_whole_earth_return() {
        for latitude in [-90.0, -89.9999, -45.0, 0.0, 1e-9, 33.0, 60.0, 90.0f64] {
            for (longitude, height_m) in [(-179.0f64, -11e3), (0.0, 0.0), (6.9, 95.3), (151.2, 9e3)]
            {
                let at = Geodetic {
                    latitude_rad: latitude.to_radians(),
                    longitude_rad: longitude.to_radians(),
                    height_m,
                };
                let place_m = geocentric_m(&at);
                let found = Geodetic::from_geocentric(&place_m);
                let off_m = (geocentric_m(&found) - place_m).norm();
                assert!(off_m < 1e-8, "{at:?} {off_m}");
                assert!((found.height_m - height_m).abs() < 1e-8, "{found:?}");
                let up = found.local_from_geocentric()
                    * (geocentric_m(&Geodetic {
                        height_m: height_m + 1.0,
                        ..at
                    }) - place_m);
                assert!((up - Vec3::z()).norm() < 1e-8, "{up}");
            }
        }
    }

    #[test]
    fn east_is_the_direction_of_the_longitude() {
        let at = Geodetic {
            latitude_rad: 0.9,
            longitude_rad: 0.3,
            height_m: 100.0,
        };
        let east_of = Geodetic {
            longitude_rad: 0.3 + 1e-7,
            ..at
        };
        let moved = at.local_from_geocentric() * (geocentric_m(&east_of) - geocentric_m(&at));
        assert!(
            moved.x > 0.3 && moved.y.abs() < 1e-6 && moved.z.abs() < 1e-6,
            "{moved}"
        );
    }
}
