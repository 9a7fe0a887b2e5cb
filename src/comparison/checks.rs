//! What a comparison is asked for, and what is refused because it has no meaning.

use super::normals;
use super::settings::ComparisonSettings;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;

/// Where the normals of the core points come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Normals<'a> {
    /// The reference, in the most planar of the neighbourhoods with `normal_radii_m`, turned to
    /// n·`orientation` ≥ 0.
    MostPlanar {
        /// Of any length above zero.
        orientation: Vec3,
    },
    /// One direction for all, of any length above zero.
    Fixed(Vec3),
    /// One for each core point. Those without a direction, zero or not finite, leave their core
    /// points without results.
    Given(&'a [Vec3]),
}

impl Normals<'_> {
    /// Found from the reference and turned upwards.
    pub const UPWARDS: Self = Self::MostPlanar {
        orientation: Vec3::new(0.0, 0.0, 1.0),
    };
}

/// The error of a cloud without points.
pub(super) fn empty(name: &str) -> Error {
    Error::of(
        Problem::TooFew,
        format!("the {name} cloud of the comparison holds no points"),
        "check the file, and the filters and time spans that were applied to it",
    )
}

/// Refuses core points without normals and none at all.
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
            "give one normal for each core point, or none",
        )),
        _ => Ok(()),
    }
}

/// Refuses settings without meaning.
pub(super) fn check(normals: Normals<'_>, settings: &ComparisonSettings) -> Result<()> {
    let mut lengths = vec![
        ("cylinder_radius_m", settings.cylinder_radius_m),
        ("max_distance_m", settings.max_distance_m),
    ];
    match normals {
        Normals::Given(_) => {}
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
    if let Normals::MostPlanar { .. } = normals {
        if settings.normal_radii_m.is_empty() {
            return Err(Error::data(
                "the comparison has neither radii for normals nor normals",
                "give normal_radii_m at least one radius",
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
            "give 1 or more: no points have no distance",
        ));
    }
    Ok(())
}
