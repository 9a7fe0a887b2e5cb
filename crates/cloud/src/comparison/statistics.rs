//! Statistics of a comparison.

use serde::{Deserialize, Serialize};

use super::result::M3c2;
use crate::error::{Error, Problem, Result};
use crate::statistics::{SIGMAS_PER_MAD, mean, quantile, rms};

/// Statistics of the finite distances of a comparison, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Number of core points with a distance.
    pub n: usize,
    /// Number of core points.
    pub core_points: usize,
    /// Mean distance.
    pub mean_m: f64,
    /// Standard deviation about the mean, divided by n − 1; NaN for a single distance.
    pub std_m: f64,
    /// √(Σ d² / n).
    #[serde(rename = "m3c2_rmse_m")]
    pub rmse_m: f64,
    /// Median distance.
    pub median_m: f64,
    /// Normalised median absolute deviation, 1.4826 median |d − median|: a standard deviation that
    /// outliers at edges and gaps do not dominate.
    pub nmad_m: f64,
    /// Share of distances beyond their level of detection, among those that have one; NaN if none
    /// has.
    pub significant_share: f64,
}

impl Statistics {
    /// Statistics of `comparison`.
    ///
    /// # Errors
    /// [`Error::Data`] if no core point has a distance because the clouds do not overlap. The error
    /// states which points were missing.
    pub fn of(comparison: &M3c2) -> Result<Self> {
        let mut sorted_m: Vec<f64> = comparison.distances_m().collect();
        if sorted_m.is_empty() {
            return Err(no_overlap(comparison));
        }
        let n = sorted_m.len();
        let count = n as f64;
        let (mean_m, rmse_m) = (mean(&sorted_m), rms(sorted_m.iter().copied()));
        let about_mean = sorted_m.iter().map(|d| (d - mean_m).powi(2)).sum::<f64>();
        sorted_m.sort_unstable_by(f64::total_cmp);
        let median_m = quantile(&sorted_m, 0.5);
        let mut off_m: Vec<f64> = sorted_m.iter().map(|d| (d - median_m).abs()).collect();
        off_m.sort_unstable_by(f64::total_cmp);
        let judged: Vec<bool> = comparison
            .core
            .iter()
            .filter_map(|core| core.significant())
            .collect();
        let significant = judged.iter().filter(|significant| **significant).count();
        Ok(Self {
            n,
            core_points: comparison.core.len(),
            mean_m,
            std_m: (about_mean / (count - 1.0)).sqrt(),
            rmse_m,
            median_m,
            nmad_m: SIGMAS_PER_MAD * quantile(&off_m, 0.5),
            significant_share: significant as f64 / judged.len() as f64,
        })
    }
}

fn no_overlap(comparison: &M3c2) -> Error {
    let core = &comparison.core;
    let without_normal = core.iter().filter(|core| core.normal.x.is_nan()).count();
    let reference = core.iter().filter(|core| core.reference_count > 0).count();
    let compared = core.iter().filter(|core| core.compared_count > 0).count();
    if without_normal == core.len() {
        return Error::of(
            Problem::TooFew,
            format!(
                "none of {} core points has a normal: too few points of the reference lie within the normal radii around \
                 them",
                core.len()
            ),
            "raise normal_radii_m, or give a reference with more points",
        );
    }
    Error::of(
        Problem::NoOverlap,
        format!(
            "the clouds do not overlap: none of {} core points has points of both clouds in its \
             cylinder ({reference} have points of the reference, {compared} of the compared cloud, \
             {without_normal} have no normal)",
            core.len()
        ),
        "check that both clouds are in the same frame and overlap, or raise max_distance_m, \
         cylinder_radius_m or normal_radii_m",
    )
}
