//! Polar observations of a total station, and their positions with covariances.

use super::PositionFix;
use crate::geometry::{Mat3, Vec3};

/// Where a total station's vertical angle is zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VerticalAngle {
    /// 0 at the zenith, 90° at the horizon: the convention of instruments and surveyors.
    #[default]
    Zenith,
    /// 0 at the horizon, 90° at the zenith.
    Elevation,
}

/// The observations in a position log.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Observations {
    /// Coordinates, unless the file also holds polar observations.
    #[default]
    AsFound,
    /// Coordinates, even if the file also holds polar observations.
    Cartesian,
    /// Slope distance, horizontal and vertical angle from this instrument.
    Polar(TotalStation),
}

/// A total station: its pose and its noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TotalStation {
    /// The intersection of its axes in the world frame, metres.
    pub station_m: Vec3,
    /// Azimuth of its horizontal zero, clockwise from grid north, radians.
    pub orientation_rad: f64,
    /// Where its vertical angle is zero.
    pub vertical: VerticalAngle,
    /// Added to every slope distance, metres.
    pub reflector_constant_m: f64,
    /// Standard deviation of a distance, constant part, metres.
    pub sigma_distance_m: f64,
    /// Standard deviation of a distance, proportional part, ppm; datasheets write `0.6 mm + 1 ppm`.
    pub sigma_distance_ppm: f64,
    /// Standard deviation of the horizontal and of the vertical angle, radians.
    pub sigma_angle_rad: f64,
    /// Standard deviation that tracking a moving 360° prism adds to each coordinate, metres.
    pub sigma_prism_m: f64,
}

/// One observation of the prism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolarObservation {
    /// Seconds.
    pub time_s: f64,
    /// From the instrument's axes to the prism, metres, without the reflector constant.
    pub slope_distance_m: f64,
    /// Clockwise from the instrument's horizontal zero, radians.
    pub horizontal_rad: f64,
    /// As defined by [`TotalStation::vertical`], radians.
    pub vertical_rad: f64,
}

/// Least cosine of the elevation in the covariance. At the zenith a horizontal angle moves no
/// coordinate, and propagation would give a standard deviation of 0, which no instrument achieves.
const LEAST_COS_ELEVATION: f64 = 0.02;

impl TotalStation {
    /// The position of the prism: with distance d (reflector constant added), azimuth a =
    /// horizontal angle + orientation and elevation e, position = station + d u with the line of
    /// sight u = (cos e sin a, cos e cos a, sin e) in east, north, up.
    ///
    /// The covariance follows by propagation. With h = (cos a, −sin a, 0) and
    /// w = (−sin e sin a, −sin e cos a, cos e) across the line of sight,
    /// C = (σ_d + ppm·1e-6 d)² u uᵀ + (σ_angle d cos e)² h hᵀ + (σ_angle d)² w wᵀ + σ_prism² I.
    /// Observations in both faces of the instrument are valid.
    pub fn position_fix(&self, observed: &PolarObservation) -> PositionFix {
        let distance_m = observed.slope_distance_m + self.reflector_constant_m;
        let azimuth = observed.horizontal_rad + self.orientation_rad;
        let elevation = match self.vertical {
            VerticalAngle::Zenith => std::f64::consts::FRAC_PI_2 - observed.vertical_rad,
            VerticalAngle::Elevation => observed.vertical_rad,
        };
        let ((sa, ca), (se, ce)) = (azimuth.sin_cos(), elevation.sin_cos());
        let sight = Vec3::new(ce * sa, ce * ca, se);
        let sideways = Vec3::new(ca, -sa, 0.0);
        let upwards = Vec3::new(-se * sa, -se * ca, ce);
        let along = self.sigma_distance_m + self.sigma_distance_ppm * 1e-6 * distance_m;
        let across = self.sigma_angle_rad * distance_m;
        let part = |sigma: f64, axis: &Vec3| axis * axis.transpose() * (sigma * sigma);
        let covariance = part(along, &sight)
            + part(across * ce.abs().max(LEAST_COS_ELEVATION), &sideways)
            + part(across, &upwards)
            + Mat3::identity() * self.sigma_prism_m.powi(2);
        PositionFix {
            time_s: observed.time_s,
            position_m: self.station_m + sight * distance_m,
            covariance_m2: Some(covariance),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instrument() -> TotalStation {
        TotalStation {
            station_m: Vec3::new(100.0, 200.0, 50.0),
            orientation_rad: 0.3,
            vertical: VerticalAngle::Zenith,
            reflector_constant_m: 0.0344,
            sigma_distance_m: 0.0006,
            sigma_distance_ppm: 1.0,
            sigma_angle_rad: 1e-4,
            sigma_prism_m: 0.0,
        }
    }

    fn observed(distance: f64, horizontal_deg: f64, vertical_deg: f64) -> PolarObservation {
        PolarObservation {
            time_s: 7.0,
            slope_distance_m: distance,
            horizontal_rad: horizontal_deg.to_radians(),
            vertical_rad: vertical_deg.to_radians(),
        }
    }

    #[test]
    fn directions_by_hand() {
        let plain = TotalStation {
            orientation_rad: 0.0,
            reflector_constant_m: 0.0,
            ..instrument()
        };
        for (horizontal, zenith, expected) in [
            (0.0, 90.0, Vec3::new(100.0, 210.0, 50.0)),
            (90.0, 90.0, Vec3::new(110.0, 200.0, 50.0)),
            (123.0, 0.0, Vec3::new(100.0, 200.0, 60.0)),
            // The second face: both angles reversed, the same point.
            (180.0, 270.0, Vec3::new(100.0, 210.0, 50.0)),
        ] {
            let found = plain
                .position_fix(&observed(10.0, horizontal, zenith))
                .position_m;
            assert!((found - expected).norm() < 1e-12, "{found}");
        }
        let turned = TotalStation {
            orientation_rad: 90_f64.to_radians(),
            reflector_constant_m: 0.5,
            vertical: VerticalAngle::Elevation,
            ..plain
        };
        let found = turned.position_fix(&observed(9.5, 0.0, 30.0)).position_m;
        let expected = Vec3::new(100.0 + 10.0 * 0.75_f64.sqrt(), 200.0, 55.0);
        assert!((found - expected).norm() < 1e-12, "{found}");
    }

    /// C = J diag(σ²) Jᵀ with J by central differences.
    #[test]
    fn the_covariance_is_the_propagated_one() {
        for (vertical, angle) in [
            (VerticalAngle::Zenith, 70.0),
            (VerticalAngle::Zenith, 290.0),
            (VerticalAngle::Elevation, -35.0),
        ] {
            let instrument = TotalStation {
                vertical,
                ..instrument()
            };
            let at = observed(80.0, 211.0, angle);
            let place = |d: f64, h: f64, v: f64| {
                instrument
                    .position_fix(&PolarObservation {
                        slope_distance_m: at.slope_distance_m + d,
                        horizontal_rad: at.horizontal_rad + h,
                        vertical_rad: at.vertical_rad + v,
                        ..at
                    })
                    .position_m
            };
            let step = 1e-5;
            let sigma_d = 0.0006 + 1e-6 * 80.0344;
            let columns = [
                (place(step, 0.0, 0.0) - place(-step, 0.0, 0.0)) / (2.0 * step) * sigma_d,
                (place(0.0, step, 0.0) - place(0.0, -step, 0.0)) / (2.0 * step) * 1e-4,
                (place(0.0, 0.0, step) - place(0.0, 0.0, -step)) / (2.0 * step) * 1e-4,
            ];
            let expected: Mat3 = columns.iter().map(|c| c * c.transpose()).sum();
            let found = instrument.position_fix(&at).covariance_m2.unwrap();
            // Variances are 5e-7 to 6e-5 m²; differences of 1e-5 leave 1e-10 of them.
            assert!((found - expected).abs().max() < 1e-13, "{found}{expected}");
            let prism = TotalStation {
                sigma_prism_m: 0.003,
                ..instrument
            };
            let more = prism.position_fix(&at).covariance_m2.unwrap() - found;
            assert!((more - Mat3::identity() * 9e-6).abs().max() < 1e-18);
        }
    }

    #[test]
    fn the_zenith_has_no_perfect_direction() {
        let fix = instrument().position_fix(&observed(50.0, 20.0, 0.0));
        let least = fix.covariance_m2.unwrap().symmetric_eigenvalues().min();
        assert!(least.sqrt() > 5e-5, "{least}");
    }
}
