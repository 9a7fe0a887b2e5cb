//! The result of a comparison.

use crate::geometry::Vec3;

/// The result at one core point.
///
/// Values are NaN if there are too few points: the distance needs one point of each cloud in the
/// cylinder (or more, see [`min_points`](crate::comparison::ComparisonSettings::min_points)), a
/// spread two points of its cloud, and the level of detection as many of each as distance and
/// spread. The normal needs three points that are not collinear; without it, or at a core point
/// that is not finite, all values are NaN and the counts are 0.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CoreDistance {
    /// The core point, metres.
    pub point: Vec3,
    /// Unit normal: the direction in which distances are positive.
    pub normal: Vec3,
    /// Radius of the neighbourhood of the normal, metres; NaN if the normal was given.
    pub normal_radius_m: f64,
    /// Mean (or median) of the compared cloud minus that of the reference, along the normal,
    /// metres.
    pub distance_m: f64,
    /// Level of detection at 95 %, metres: smaller distances are not significant.
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
    /// No result, at an unknown position.
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

    /// Whether the distance exceeds the level of detection; `None` if either is unknown.
    pub fn significant(&self) -> Option<bool> {
        let known = self.distance_m.is_finite() && self.level_of_detection_m.is_finite();
        known.then(|| self.distance_m.abs() > self.level_of_detection_m)
    }
}

/// A comparison: one entry for each core point, in order.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct M3c2 {
    /// The result at each core point.
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
