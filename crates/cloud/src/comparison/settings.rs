//! Settings of comparisons.

/// How the points of a cloud in a cylinder of M3C2 are summarised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Aggregation {
    /// Mean and standard deviation.
    #[default]
    Mean,
    /// Median and inter-quartile range.
    Median,
}

/// The distribution from which the level of detection of M3C2 takes its 97.5 % quantile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Detection {
    /// The normal distribution, with the quantile rounded to 1.96 as in the literature.
    #[default]
    Normal,
    /// Student's t, which also holds for few points.
    Student,
}

/// Settings of the M3C2 comparison.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ComparisonSettings {
    /// Voxel size to which core points are thinned, metres.
    pub core_spacing_m: f64,
    /// Radii of the neighbourhoods for normals, of which the most planar is used, metres.
    pub normal_radii_m: Vec<f64>,
    /// Radius of the cylinder, metres.
    pub cylinder_radius_m: f64,
    /// Half length of the cylinder, metres.
    pub max_distance_m: f64,
    /// Registration error added to the level of detection, metres.
    pub registration_error_m: f64,
    /// How the points in a cylinder are summarised.
    pub aggregation: Aggregation,
    /// How the level of detection is computed.
    pub detection: Detection,
    /// Cylinders reach only along the normal, not against it, for both clouds.
    pub one_sided: bool,
    /// Fewest points of either cloud in a cylinder for a distance; 1 or more.
    pub min_points: u32,
}

impl Default for ComparisonSettings {
    fn default() -> Self {
        Self {
            core_spacing_m: 0.02,
            normal_radii_m: vec![0.04],
            cylinder_radius_m: 0.02,
            max_distance_m: 0.1,
            registration_error_m: 0.0,
            aggregation: Aggregation::Mean,
            detection: Detection::Normal,
            one_sided: false,
            min_points: 1,
        }
    }
}
