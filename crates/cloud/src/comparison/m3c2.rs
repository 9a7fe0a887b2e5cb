//! Signed distances between two clouds along local normals: M3C2 (Lague, Brodu, Leroux, *Accurate
//! 3D comparison of complex topography with terrestrial laser scanner*, ISPRS Journal 82, 2013).
//!
//! At every core point c:
//!
//! 1. The normal n is that of the reference's points within a radius of c. Of several radii, the
//!    one with the largest planarity (λ₂ − λ₃) / λ₁ is used, of equal ones the first. It is
//!    oriented along a direction, or towards the nearest of the places from which the surface was
//!    seen. Alternatively the normal is given: one direction for all core points, or one for each.
//! 2. A cylinder of radius R runs through c along n, with half length L on both sides. It contains
//!    the points x of a cloud with |n·(x − c)| < L and |(x − c) − n n·(x − c)| ≤ R. A one-sided
//!    cylinder contains only those with n·(x − c) ≥ 0, for both clouds (like CloudCompare's search
//!    on the positive side): the reference then counts only beyond the core point.
//! 3. With mean, standard deviation (divided by n − 1) and number n·(x − c), sᵢ, nᵢ of the points
//!    of cloud i in the cylinder, the distance is the mean of the compared cloud minus that of the
//!    reference, and the level of detection at 95 % is
//!
//!    LoD = 1.96 (√(s₁²/n₁ + s₂²/n₂) + registration error).
//!
//! Robust aggregation uses the median instead of the mean and the inter-quartile range, without a
//! factor, instead of sᵢ. The quartiles are those of definition 2 of Hyndman and Fan (*Sample
//! quantiles in statistical packages*, 1996): the value at position ⌈n p⌉ in ascending order, or
//! its mean with the next if n p is an integer. For a normal distribution, the range is 1.35
//! standard deviations, and the level of detection is larger by this factor.
//!
//! The factor 1.96 requires 30 points or more. For fewer there is
//!
//! LoD = t(ν) √(s₁²/n₁ + s₂²/n₂) + 1.95996… · registration error,
//!
//! with the 97.5 % quantile t of Student's distribution with the degrees of freedom of Welch and
//! Satterthwaite ν = (s₁²/n₁ + s₂²/n₂)² / ((s₁²/n₁)² / (n₁ − 1) + (s₂²/n₂)² / (n₂ − 1)). The
//! registration error is not estimated from the points and keeps the factor of the normal
//! distribution. With the inter-quartile range, ν is a rule of thumb.
//!
//! The conventions are those of py4dgeo, so that results can be compared one by one, with three
//! exceptions: points exactly at a radius around a core point are included here; points exactly on
//! the borders between the pieces of py4dgeo's cylinders may be lost or counted twice there; the
//! spread of a single point is unknown here, and an inter-quartile range of 0 there. CloudCompare's
//! quartiles are the medians of the two halves, its standard deviations are divided by n.

use super::checks::Normals;
use super::result::M3c2;
use super::settings::ComparisonSettings;
use super::surface::IndexedClouds;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Compares `compared` with `reference` at the points `core` (all metres, in one frame):
/// [`IndexedClouds::new`] and [`IndexedClouds::distances`] in one. To compare several clouds with one
/// reference, see [`ReferenceSurface`](super::ReferenceSurface).
///
/// # Errors
/// Those of both functions.
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
