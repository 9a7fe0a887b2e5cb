//! Signed distances between two clouds along local normals: M3C2 (Lague, Brodu, Leroux, *Accurate
//! 3D comparison of complex topography with terrestrial laser scanner*, ISPRS Journal 82, 2013).
//!
//! At every core point c:
//!
//! 1. The normal n is that of the reference's points within a radius of c. Of several radii the one
//!    with the largest planarity (λ₂ − λ₃) / λ₁ counts, of equals the first. Or it is given: one
//!    direction for all core points, or one for each.
//! 2. A cylinder of radius R runs through c along n, to its half length L on both sides. It holds
//!    the points x of a cloud with |n·(x − c)| < L and |(x − c) − n n·(x − c)| ≤ R. A one-sided
//!    cylinder holds only those with n·(x − c) ≥ 0, for both clouds (as CloudCompare's search on the
//!    positive side): the reference then counts only where it lies beyond the core point.
//! 3. With mean, standard deviation (divided by n − 1) and number n·(x − c), sᵢ, nᵢ of the points of
//!    cloud i in the cylinder, the distance is the mean of the compared cloud less that of the
//!    reference, and the level of detection at 95 %
//!
//!    LoD = 1.96 (√(s₁²/n₁ + s₂²/n₂) + registration error).
//!
//! Robust aggregation puts the median in the place of the mean and the inter-quartile range, as it
//! is, in that of sᵢ. The quartiles are those of definition 2 of Hyndman and Fan (*Sample quantiles
//! in statistical packages*, 1996): the value at the place ⌈n p⌉ in ascending order, or its mean with
//! the next where n p is whole. The range is 1.35 standard deviations of a normal distribution, and
//! the level of detection is that much larger.
//!
//! The factor 1.96 asks for 30 points and more. For fewer there is
//!
//! LoD = t(ν) √(s₁²/n₁ + s₂²/n₂) + 1.95996… · registration error,
//!
//! with the 97.5 % quantile t of Student's distribution with Welch's and Satterthwaite's degrees of
//! freedom ν = (s₁²/n₁ + s₂²/n₂)² / ((s₁²/n₁)² / (n₁ − 1) + (s₂²/n₂)² / (n₂ − 1)). The registration
//! error is not estimated from the points and keeps the factor of the normal distribution. With
//! the inter-quartile range ν is a rule of thumb.
//!
//! Conventions are those of py4dgeo, so that numbers can be compared one by one; apart from points
//! exactly at a radius around a core point, which count here, and exactly on the borders between
//! the pieces it cuts its cylinders into, which it may lose or count twice, and from the spread of
//! a single point, which is unknown here and an inter-quartile range of 0 there. CloudCompare's
//! quartiles are the medians of the two halves, its standard deviations are divided by n.

use super::normals;
use super::search::IndexedClouds;
use crate::cloud::voxel;
use crate::comparison::ComparisonSettings;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// What was found at one core point.
///
/// NaN stands for what too few points leave open: the distance needs one point of each cloud in
/// the cylinder (or more, see [`ComparisonSettings::min_points`]), a spread two of its cloud, and the
/// level of detection as many of each as distance and spread. The normal needs three points that are
/// not on one line; without it, or at a core point that is not finite, all is NaN and the counts are
/// 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoreDistance {
    /// The core point, metres.
    pub point: Vec3,
    /// Unit normal: the direction in which distances are positive.
    pub normal: Vec3,
    /// Radius of the neighbourhood the normal comes from, metres; NaN where it was given.
    pub normal_radius_m: f64,
    /// Mean (or median) of the compared cloud less that of the reference, along the normal, metres.
    pub distance_m: f64,
    /// Level of detection at 95 %, metres: a smaller distance cannot be told from none.
    pub level_of_detection_m: f64,
    /// Standard deviation (or inter-quartile range) along the normal of the reference's points in
    /// the cylinder, metres.
    pub reference_spread_m: f64,
    /// Standard deviation (or inter-quartile range) along the normal of the compared points in the
    /// cylinder, metres.
    pub compared_spread_m: f64,
    /// Points of the reference in the cylinder.
    pub reference_count: u32,
    /// Compared points in the cylinder.
    pub compared_count: u32,
}

impl CoreDistance {
    /// Nothing found at a place that is not known either.
    pub(super) fn unknown() -> Self {
        Self {
            point: Vec3::repeat(f64::NAN),
            normal: Vec3::repeat(f64::NAN),
            normal_radius_m: f64::NAN,
            distance_m: f64::NAN,
            level_of_detection_m: f64::NAN,
            reference_spread_m: f64::NAN,
            compared_spread_m: f64::NAN,
            reference_count: 0,
            compared_count: 0,
        }
    }

    /// Whether the distance exceeds the level of detection; `None` where either is unknown.
    pub fn significant(&self) -> Option<bool> {
        let known = self.distance_m.is_finite() && self.level_of_detection_m.is_finite();
        known.then(|| self.distance_m.abs() > self.level_of_detection_m)
    }
}

/// A comparison: one entry for each core point, in their order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct M3c2 {
    /// What was found at each core point.
    pub core: Vec<CoreDistance>,
}

impl M3c2 {
    /// The finite distances in the order of the core points, metres.
    pub fn distances_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.core
            .iter()
            .map(|core| core.distance_m)
            .filter(|distance| distance.is_finite())
    }
}

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

/// Core points for comparing with `reference`: its points thinned to `core_spacing_m`.
pub fn core_points(reference: &[Vec3], settings: &ComparisonSettings) -> Vec<Vec3> {
    core_indices(reference, settings)
        .into_iter()
        .map(|index| reference[index as usize])
        .collect()
}

/// As [`core_points`], the places of the points in `reference`, ascending.
pub fn core_indices(reference: &[Vec3], settings: &ComparisonSettings) -> Vec<u32> {
    voxel::thin(reference, settings.core_spacing_m)
}

/// Compares `compared` with `reference` at the points `core` (all metres, in one frame):
/// [`IndexedClouds::new`] and [`IndexedClouds::distances`] in one.
///
/// # Errors
/// Those of the two.
pub fn m3c2(
    reference: &[Vec3],
    compared: &[Vec3],
    core: &[Vec3],
    normals: Normals<'_>,
    settings: &ComparisonSettings,
    progress: &dyn Progress,
) -> Result<M3c2> {
    let clouds = IndexedClouds::new(reference, compared, normals, settings)?;
    clouds.distances(core, normals, progress)
}

pub(super) fn empty(name: &str) -> Error {
    Error::data(
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
