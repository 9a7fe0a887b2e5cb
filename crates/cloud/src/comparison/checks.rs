//! Checks of the settings and inputs of a comparison.

use super::normals;
use super::settings::ComparisonSettings;
use crate::error::{Error, Problem, Result};
use crate::geometry::{Vec3, is_finite};

/// Where the normals of the core points come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Normals<'a> {
    /// Computed from the reference, in the most planar of the neighbourhoods with `normal_radii_m`,
    /// oriented so that n·`orientation` ≥ 0.
    MostPlanar {
        /// Non-zero, of any length.
        orientation: Vec3,
    },
    /// Computed as for [`Self::MostPlanar`], oriented towards the nearest of these places, from which
    /// the surface was seen (metres, in the frame of the clouds; at least one). Of equally near ones,
    /// the first.
    SeenFrom(&'a [Vec3]),
    /// One direction for all core points, non-zero, of any length.
    Fixed(Vec3),
    /// One for each core point. Core points with a normal that is zero or not finite get no
    /// results.
    Given(&'a [Vec3]),
}

impl Normals<'_> {
    /// Computed from the reference and oriented upwards.
    pub const UPWARDS: Self = Self::MostPlanar {
        orientation: Vec3::new(0.0, 0.0, 1.0),
    };

    /// Whether they are computed from the reference.
    pub(super) fn are_computed(self) -> bool {
        matches!(self, Self::MostPlanar { .. } | Self::SeenFrom(_))
    }
}

/// Refuses a cloud without finite points.
pub(super) fn check_points(cloud: &[Vec3], name: &str) -> Result<()> {
    if cloud.iter().any(is_finite) {
        Ok(())
    } else {
        Err(empty(name))
    }
}

/// The error of a cloud without points.
fn empty(name: &str) -> Error {
    Error::of(
        Problem::TooFew,
        format!("the {name} cloud of the comparison has no points"),
        "check the file, and the filters and time spans that were applied to it",
    )
}

/// Refuses an empty list of core points, and normals that do not match it.
pub(super) fn check_core(core: &[Vec3], normals: Normals<'_>) -> Result<()> {
    if core.is_empty() {
        return Err(empty("core point"));
    }
    match normals {
        Normals::Given(given) if given.len() != core.len() => Err(Error::data(
            format!(
                "{} normals were given for {} core points",
                given.len(),
                core.len()
            ),
            "give one normal for each core point, or no normals",
        )),
        _ => Ok(()),
    }
}

/// Refuses invalid settings.
pub(super) fn check(normals: Normals<'_>, settings: &ComparisonSettings) -> Result<()> {
    let mut lengths = vec![
        ("cylinder_radius_m", settings.cylinder_radius_m),
        ("max_distance_m", settings.max_distance_m),
    ];
    match normals {
        Normals::Given(_) => {}
        Normals::SeenFrom(places) => {
            if places.is_empty() || !places.iter().all(is_finite) {
                return Err(Error::data(
                    "the comparison has no place from which the surface was seen, or one that is not finite",
                    "give at least one place with three finite coordinates, or a direction",
                ));
            }
        }
        Normals::Fixed(direction)
        | Normals::MostPlanar {
            orientation: direction,
        } => {
            if normals::unit(&direction).x.is_nan() {
                return Err(Error::data(
                    format!(
                        "the direction of the comparison is ({}, {}, {})",
                        direction.x, direction.y, direction.z
                    ),
                    "give three finite numbers that are not all zero",
                ));
            }
        }
    }
    if normals.are_computed() {
        if settings.normal_radii_m.is_empty() {
            return Err(Error::data(
                "the comparison has neither normals nor radii to compute them",
                "give at least one radius in normal_radii_m",
            ));
        }
        let radii = settings.normal_radii_m.iter();
        lengths.extend(radii.map(|&radius| ("normal_radii_m", radius)));
    }
    let bad_length = lengths
        .iter()
        .find(|(_, length)| !(*length > 0.0 && length.is_finite()));
    if let Some((name, length)) = bad_length {
        return Err(Error::data(
            format!("{name} of the comparison is {length} m"),
            "give a length above zero",
        ));
    }
    let registration = settings.registration_error_m;
    if !(registration >= 0.0 && registration.is_finite()) {
        return Err(Error::data(
            format!("registration_error_m of the comparison is {registration} m"),
            "give zero or a length above zero",
        ));
    }
    if settings.min_points == 0 {
        return Err(Error::data(
            "min_points of the comparison is 0",
            "give 1 or more: without points there is no distance",
        ));
    }
    Ok(())
}
