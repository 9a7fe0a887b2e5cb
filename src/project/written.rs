//! The project file as typed: degrees, datasheet units, paths relative to the file.
//!
//! Every table refuses keys it does not know.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::shapes::{Files, Numbers, Tables};
use crate::calibration::Method;
use crate::comparison::{Aggregation, Detection};
use crate::geometry::{BodyAxes, EulerConvention};
use crate::sensor::VerticalAngle;
use crate::trajectory::{Loss, Nodes};

/// The whole file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Written {
    /// Axes, origin, gravity.
    #[serde(default)]
    pub frame: Frame,
    /// With `prism` or `gnss`, and perhaps `heading`: logs to estimate the trajectory from.
    pub imu: Option<Imu>,
    /// Prisms tracked by total stations.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub prism: Tables<Prism>,
    /// GNSS antennas.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub gnss: Tables<Gnss>,
    /// Headings of the antenna baseline.
    pub heading: Option<Heading>,
    /// How the trajectory is estimated, or a file of poses instead of the four above.
    pub trajectory: Option<Trajectory>,
    /// The scanners.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scanner: Vec<Scanner>,
    /// The reference cloud.
    pub reference: Option<Reference>,
    /// How the mountings are found.
    #[serde(default)]
    pub calibration: Calibration,
    /// How clouds are compared.
    #[serde(default)]
    pub comparison: Comparison,
    /// Other drives.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub evaluation: Vec<Evaluation>,
}

/// `[frame]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// `FRD` (default) or `FLU`.
    pub body: Option<BodyAxes>,
    /// Default 0, 0, 0.
    pub origin_m: Option<[f64; 3]>,
    /// Default 0.
    pub grid_convergence_deg: Option<f64>,
    /// Default 9.81.
    pub gravity_m_s2: Option<f64>,
}

/// `[imu]`; the defaults are those of an SBG Ellipse-D.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imu {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Angle random walk, °/√h. Default 0.15.
    pub gyro_noise_deg_sqrt_h: Option<f64>,
    /// Velocity random walk, µg/√Hz. Default 57.
    pub accel_noise_ug_sqrt_hz: Option<f64>,
    /// Bias instability, °/h. Default 7. The bias walks by this in the correlation time.
    pub gyro_bias_instability_deg_h: Option<f64>,
    /// Bias instability, µg. Default 14. The bias walks by this in the correlation time.
    pub accel_bias_instability_ug: Option<f64>,
    /// Instead of the instability.
    pub gyro_bias_walk_rad_s_sqrt_s: Option<f64>,
    /// Instead of the instability.
    pub accel_bias_walk_m_s2_sqrt_s: Option<f64>,
}

/// `[prism]`, or several `[[prism]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prism {
    /// Default `prism`; needed where there are several.
    pub name: Option<String>,
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Of each coordinate, or of east, north, up, where the log gives none. Default 0.005. Of polar
    /// observations: what tracking adds to the instrument's noise.
    pub sigma_m: Option<Numbers>,
    /// Prism in the body frame.
    pub lever_arm_m: [f64; 3],
    /// What large residuals count. Default `truncated`.
    pub loss: Option<Loss>,
    /// `cartesian` or `polar`, where the file holds both.
    pub observations: Option<ObservationKind>,
    /// The total station in the world.
    pub station_m: Option<[f64; 3]>,
    /// Azimuth of its horizontal zero, clockwise from grid north: makes the log a polar one.
    pub station_orientation_deg: Option<f64>,
    /// `zenith` (default) or `elevation`.
    pub vertical_angle: Option<VerticalAngle>,
    /// Added to slope distances. Default 0.
    pub reflector_constant_m: Option<f64>,
    /// Of a slope distance. Default 0.001.
    pub sigma_distance_m: Option<f64>,
    /// Of a slope distance, more with its length. Default 1.
    pub sigma_distance_ppm: Option<f64>,
    /// Of either angle, seconds of arc. Default 1.
    pub sigma_angle_arcsec: Option<f64>,
}

/// What is read of a position log that holds coordinates and polar observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObservationKind {
    /// Coordinates.
    Cartesian,
    /// Distances and angles.
    Polar,
}

/// `[gnss]`, or several `[[gnss]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gnss {
    /// Default `gnss`; needed where there are several.
    pub name: Option<String>,
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Of each coordinate, or of east, north, up, where the log gives none. Default 0.02, 0.02,
    /// 0.04.
    pub sigma_m: Option<Numbers>,
    /// Antenna in the body frame.
    pub lever_arm_m: [f64; 3],
    /// What large residuals count. Default `truncated`.
    pub loss: Option<Loss>,
}

/// `[heading]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heading {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Where the log gives none. Default 0.7.
    pub sigma_deg: Option<f64>,
    /// Of the pitch, where the log has one and gives no sigma. Default: `sigma_deg`.
    pub sigma_pitch_deg: Option<f64>,
    /// From the antenna baseline to the body's x axis, clockwise. Default 0.
    pub mounting_offset_deg: Option<f64>,
    /// What large residuals count. Default `truncated`.
    pub loss: Option<Loss>,
}

/// `[trajectory]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Poses instead of logs, relative to the project file.
    pub file: Option<PathBuf>,
    /// With `file`: common time = time in the file + this.
    pub time_offset_s: Option<f64>,
    /// With `file`: of each coordinate, where the file gives none.
    pub sigma_position_m: Option<f64>,
    /// With `file`: about each axis, where the file gives none.
    pub sigma_rotation_deg: Option<f64>,
    /// Without `file`: `prism` (default) or `imu`.
    pub nodes: Option<Nodes>,
    /// Without `file`: constants to estimate beside the trajectory. Default none.
    pub estimate: Option<Vec<String>>,
    /// Without `file`: hold the velocity at zero where the logs show rest. Default true.
    pub zero_velocity: Option<bool>,
    /// No point is placed where the sigma of a coordinate is larger. Default none.
    pub max_sigma_position_m: Option<f64>,
    /// No point is placed where the sigma about an axis is larger. Default none.
    pub max_sigma_rotation_deg: Option<f64>,
}

/// `[[scanner]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scanner {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// One file or several in time order, relative to the project file.
    pub profiles: Files,
    /// Common time = scanner time + this.
    pub time_offset_s: Option<f64>,
    /// Scanner in the body frame.
    pub translation_m: [f64; 3],
    /// α, β, γ in the convention below.
    pub rotation_deg: Option<[f64; 3]>,
    /// Instead of the angles.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// `zyx` (default) or `bonn`.
    pub rotation_convention: Option<EulerConvention>,
    /// Of tx ty tz rx ry rz.
    pub fixed: Option<Vec<String>>,
}

/// `[reference]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Relative to the project file.
    pub file: PathBuf,
}

/// `[calibration]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Coarse to fine.
    pub voxel_sizes_m: Option<Vec<f64>>,
    /// In each neighbourhood.
    pub neighbours: Option<usize>,
    /// `reweighted` (default) or `paper`.
    pub method: Option<Method>,
    /// A scale.
    pub max_iterations: Option<usize>,
    /// A point of the same scanner and voxel this much later belongs to another pass.
    pub pass_gap_s: Option<f64>,
}

/// `[comparison]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Between core points.
    pub core_spacing_m: Option<f64>,
    /// Of the neighbourhoods for normals.
    pub normal_radii_m: Option<Vec<f64>>,
    /// Of the cylinder.
    pub cylinder_radius_m: Option<f64>,
    /// Half length of the cylinder.
    pub max_distance_m: Option<f64>,
    /// Added to the level of detection.
    pub registration_error_m: Option<f64>,
    /// `mean` (default) or `median`.
    pub aggregation: Option<Aggregation>,
    /// `normal` (default) or `student`.
    pub detection: Option<Detection>,
    /// Cylinders along the normal only.
    pub one_sided: Option<bool>,
    /// Of either cloud, for a distance.
    pub min_points: Option<u32>,
}

/// `[[evaluation]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluation {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// Its project file, relative to this one.
    pub project: PathBuf,
}
