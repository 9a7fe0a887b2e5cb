//! Projected coordinate reference systems: from latitude and longitude to east and north, and the
//! meridian convergence by which headings and attitudes turn.
//!
//! Only the projection is applied, no datum shift: coordinates stay in the datum of the file, and
//! ellipsoidal heights stay as they are. The realisations of WGS 84, ITRF, ETRS89, NAD83 and so on
//! differ by up to two metres, and by less than 1 µrad in direction.
//!
//! A projection is not to scale: on the central meridian of UTM, distances between its coordinates
//! are 0.9996 of true ones, and scanner points 10 m from a projected pose are 4 mm too far out.
//! [`GridPoint::scale`] is this factor.

use std::fmt;

use proj4rs::Proj;
use proj4rs::adaptors::transform_xy;

use super::grid::{GridPoint, Misfit};
use crate::error::{Error, Result};

/// Parameters that a `+proj` string may have.
const PARAMETERS: [&str; 42] = [
    "proj", "zone", "south", "datum", "ellps", "a", "b", "rf", "f", "es", "e", "R", "lat_0",
    "lat_1", "lat_2", "lat_ts", "lon_0", "lon_1", "lon_2", "lonc", "alpha", "gamma", "azi", "k",
    "k_0", "k0", "x_0", "y_0", "units", "to_meter", "towgs84", "nadgrids", "pm", "no_defs", "type",
    "wktext", "approx", "no_uoff", "no_off", "no_rot", "axis", "vunits",
];
/// Semi-major axis of WGS 84 and GRS 80, metres.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Semi-minor axis of WGS 84, metres; that of GRS 80 is 0.1 mm shorter.
const SEMI_MINOR_M: f64 = 6_356_752.314_2;
/// Tolerance for the axes, metres: WGS 84 and GRS 80 are treated as the same ellipsoid.
const AXIS_SLACK_M: f64 = 1e-3;
/// Step of the central differences, radians: 64 m on the ground. Their errors are near 1e-10.
const STEP_RAD: f64 = 1e-5;
/// Largest distortion of a conformal projection; the central differences are a thousand times more accurate.
const CONFORMAL: f64 = 1e-6;
/// The scale of a system in the region for which it is meant.
const SCALE: std::ops::RangeInclusive<f64> = 0.99..=1.01;
/// Closer to a pole, the direction of a meridian changes too fast for differences.
const MOST_LATITUDE_DEG: f64 = 89.9;
/// Largest error of an inverse projection, metres.
const INVERSE_M: f64 = 1e-5;

/// A projected coordinate reference system in metres on the ellipsoid WGS 84 or GRS 80.
#[derive(Debug, Clone)]
pub struct Projection {
    name: String,
    geographic: Proj,
    projected: Proj,
}

impl PartialEq for Projection {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Projection {
    /// The system of an EPSG code such as `EPSG:25832`, or of a string such as
    /// `+proj=utm +zone=32 +ellps=GRS80`.
    ///
    /// # Errors
    /// An unknown code, parameter or value; a system that is not projected, not in metres, with
    /// axes other than east and north, with a vertical system of its own, or with a datum shift. The error
    /// names the cause.
    pub fn new(name: &str) -> Result<Self> {
        let name = name.trim();
        let definition = match name.get(..5) {
            Some(start) if start.eq_ignore_ascii_case("EPSG:") => {
                definition_of_code(name, &name[5..])?
            }
            _ if name.starts_with('+') => name,
            _ => {
                return Err(Error::data(
                    format!("the coordinate reference system `{name}` is not understood"),
                    "write an EPSG code such as EPSG:25832, or a string that begins with +proj=",
                ));
            }
        };
        check_parameters(name, definition)?;
        let refused = |why: &dyn fmt::Display| not_usable(name, &format!("{why} ({definition})"));
        let projected = Proj::from_proj_string(definition).map_err(|e| refused(&e))?;
        if projected.is_latlong() || projected.is_geocent() {
            return Err(refused(&"it is not projected"));
        }
        let (a, b) = projected.ellipse_parameters();
        if !((a - SEMI_MAJOR_M).abs() < AXIS_SLACK_M && (b - SEMI_MINOR_M).abs() < AXIS_SLACK_M) {
            return Err(refused(
                &"its ellipsoid is not that of satellite positioning, and no datum shift is applied",
            ));
        }
        if projected.to_meter() != 1.0 || projected.vto_meter() != 1.0 {
            return Err(refused(&"its coordinates are not in metres"));
        }
        if !(projected.has_forward() && projected.has_inverse()) {
            return Err(refused(&"its projection has no inverse"));
        }
        // Without a datum, nothing is shifted.
        let geographic =
            Proj::from_proj_string("+proj=longlat +ellps=WGS84").map_err(|e| refused(&e))?;
        Ok(Self {
            name: name.to_owned(),
            geographic,
            projected,
        })
    }

    /// The name as given to [`Projection::new`].
    pub fn name(&self) -> &str {
        &self.name
    }

    /// East and north of a position in geographic coordinates, radians, with the convergence and
    /// the scale there by central differences.
    ///
    /// # Errors
    /// Coordinates that are out of range; a place too far from where the system is meant to be
    /// used: not conformal, more than 1 % from true scale, or next to a pole.
    pub fn project(&self, latitude_rad: f64, longitude_rad: f64) -> Result<GridPoint> {
        Ok(self.try_project(latitude_rad, longitude_rad)?)
    }

    /// Latitude and longitude of projected coordinates, radians.
    ///
    /// # Errors
    /// Coordinates outside the system.
    pub fn unproject(&self, east_m: f64, north_m: f64) -> Result<(f64, f64)> {
        let refused = || Misfit {
            found: format!(
                "east {east_m} m, north {north_m} m is outside {}",
                self.name
            ),
            expected: "coordinates of the system".to_owned(),
        };
        let (longitude, latitude) =
            transform_xy(&self.projected, &self.geographic, east_m, north_m)
                .map_err(|_| refused())?;
        let (east, north) = self.forward(latitude, longitude).ok_or_else(refused)?;
        let off_m = (east - east_m).hypot(north - north_m);
        // Not a number must fail.
        if !(..=INVERSE_M).contains(&off_m) {
            return Err(refused().into());
        }
        Ok((latitude, longitude))
    }

    /// As [`Self::project`], for readers that add file and line to the error.
    ///
    /// # Errors
    /// A position outside the system.
    pub fn try_project(
        &self,
        latitude_rad: f64,
        longitude_rad: f64,
    ) -> std::result::Result<GridPoint, Misfit> {
        let name = &self.name;
        let (latitude_deg, longitude_deg) = (latitude_rad.to_degrees(), longitude_rad.to_degrees());
        let misfit = |why: &str, expected: &str| Misfit {
            found: format!("latitude {latitude_deg}°, longitude {longitude_deg}°{why}"),
            expected: expected.to_owned(),
        };
        // Not a number must fail.
        if !(latitude_deg.abs() <= MOST_LATITUDE_DEG && longitude_deg.abs() <= 360.0) {
            let expected = "a latitude within ±89.9° and a longitude within ±360°";
            return Err(misfit("", expected));
        }
        let elsewhere = || misfit(&format!(" is outside {name}"), "a system of that region");
        let place = |north: f64, east: f64| {
            let longitude = longitude_rad + east / latitude_rad.cos();
            self.forward(latitude_rad + north, longitude)
                .ok_or_else(elsewhere)
        };
        let (east_m, north_m) = place(0.0, 0.0)?;
        let (to_north, to_south) = (place(STEP_RAD, 0.0)?, place(-STEP_RAD, 0.0)?);
        let (to_east, to_west) = (place(0.0, STEP_RAD)?, place(0.0, -STEP_RAD)?);
        let (meridian_m, normal_m) = radii_m(latitude_rad);
        let slope = |plus: (f64, f64), minus: (f64, f64), radius_m: f64| {
            let length_m = 2.0 * STEP_RAD * radius_m;
            [(plus.0 - minus.0) / length_m, (plus.1 - minus.1) / length_m]
        };
        let north = slope(to_north, to_south, meridian_m);
        let east = slope(to_east, to_west, normal_m);
        let scale = north[0].hypot(north[1]);
        if !SCALE.contains(&scale) {
            let why = format!(", where distances in {name} are {scale:.4} of true ones");
            return Err(misfit(&why, "a system of that region"));
        }
        let distortion = (north[1] - east[0]).hypot(north[0] + east[1]);
        if !(..=CONFORMAL).contains(&distortion) {
            let why = format!(", where {name} is not conformal: {distortion:.1e} rad");
            return Err(misfit(&why, "a conformal system such as UTM"));
        }
        Ok(GridPoint {
            east_m,
            north_m,
            convergence_rad: (-north[0]).atan2(north[1]),
            scale,
        })
    }

    fn forward(&self, latitude_rad: f64, longitude_rad: f64) -> Option<(f64, f64)> {
        transform_xy(
            &self.geographic,
            &self.projected,
            longitude_rad,
            latitude_rad,
        )
        .ok()
        .filter(|(east, north)| east.is_finite() && north.is_finite())
    }
}

/// Radii of curvature of the ellipsoid along the meridian and across it, metres.
fn radii_m(latitude_rad: f64) -> (f64, f64) {
    let e2 = 1.0 - (SEMI_MINOR_M / SEMI_MAJOR_M).powi(2);
    let w2 = 1.0 - e2 * latitude_rad.sin().powi(2);
    let normal_m = SEMI_MAJOR_M / w2.sqrt();
    (normal_m * (1.0 - e2) / w2, normal_m)
}

/// The `+proj` string of an EPSG code.
fn definition_of_code(name: &str, code: &str) -> Result<&'static str> {
    let definition = code.parse().ok().and_then(crs_definitions::from_code);
    definition
        .map(|definition| definition.proj4)
        .ok_or_else(|| {
            Error::data(
                format!("{name} is not a known code"),
                "check the number, or write the system as a string that begins with +proj=",
            )
        })
}

fn not_usable(name: &str, why: &str) -> Error {
    Error::data(
        format!("the coordinate reference system {name} cannot be used: {why}"),
        "use a projected system in metres on WGS 84 or GRS 80, such as UTM in WGS 84 (EPSG:326xx, \
         EPSG:327xx) or in ETRS89 (EPSG:258xx)",
    )
}

/// Refuses parameters that the library would silently ignore, and datum shifts that it would apply.
fn check_parameters(name: &str, definition: &str) -> Result<()> {
    let mut seen: Vec<&str> = Vec::new();
    for word in definition.split_ascii_whitespace() {
        let refused = |why: &str| not_usable(name, &format!("`{word}`: {why}"));
        let Some(parameter) = word.strip_prefix('+') else {
            return Err(refused("a parameter begins with + and has no spaces"));
        };
        if !word
            .bytes()
            .all(|byte| byte.is_ascii_graphic() && byte != b'"')
        {
            return Err(refused("unexpected characters"));
        }
        let (key, value) = parameter.split_once('=').unwrap_or((parameter, ""));
        if !PARAMETERS.contains(&key) {
            return Err(refused("an unknown parameter"));
        }
        if seen.contains(&key) {
            return Err(refused("given twice"));
        }
        seen.push(key);
        let is_null = |number: &str| number.parse() == Ok(0.0);
        match key {
            "towgs84" if !value.split(',').all(is_null) => {
                return Err(refused("a datum shift, which is not supported"));
            }
            "nadgrids" if value != "@null" => {
                return Err(refused("a datum shift, which is not supported"));
            }
            "vunits" => {
                return Err(refused(
                    "a vertical system, but only ellipsoidal heights are supported; name the horizontal part alone",
                ));
            }
            "axis" if value != "enu" => return Err(refused("the axes must be east, north, up")),
            _ => {}
        }
    }
    let is_utm = |word: &str| word == "+proj=utm";
    if definition.split_ascii_whitespace().any(is_utm) && !seen.contains(&"zone") {
        return Err(not_usable(name, "+proj=utm without +zone"));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
