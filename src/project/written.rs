//! The project file as written: degrees, datasheet units, paths relative to the file.
//!
//! Every table refuses unknown keys.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::shapes::{Files, Numbers, Tables};
use crate::calibration;
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
    /// With `prism` or `gnss`, and optionally `heading`: logs from which the trajectory is
    /// estimated.
    pub imu: Option<Imu>,
    /// Prisms tracked by total stations.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub prism: Tables<Prism>,
    /// GNSS antennas.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub gnss: Tables<Gnss>,
    /// Headings of the antenna baseline.
    pub heading: Option<Heading>,
    /// What mountings may follow beside tilt, acceleration and time.
    pub bending: Option<Bending>,
    /// Settings of the trajectory estimation, or a file of poses instead of the four above.
    pub trajectory: Option<Trajectory>,
    /// The scanners.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scanner: Vec<Scanner>,
    /// The reference cloud.
    pub reference: Option<Reference>,
    /// Settings of the calibration.
    #[serde(default)]
    pub calibration: Calibration,
    /// Settings of the joint adjustment.
    #[serde(default)]
    pub joint: Joint,
    /// Settings of the comparisons.
    #[serde(default)]
    pub comparison: Comparison,
    /// What results are held against.
    #[serde(default)]
    pub acceptance: Acceptance,
    /// Who made the report.
    #[serde(default, skip_serializing_if = "Report::is_empty")]
    pub report: Report,
    /// Other drives, adjusted together with this one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub drive: Vec<OtherDrive>,
    /// Other drives, evaluated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub evaluation: Vec<OtherDrive>,
}

/// The scanners alone, as a calibration prints them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mountings {
    /// The scanners.
    #[serde(default)]
    pub scanner: Vec<Scanner>,
}

/// `[frame]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// `FRD` (default) or `FLU`.
    pub body: Option<BodyAxes>,
    /// Default 0, 0, 0.
    pub origin_m: Option<[f64; 3]>,
    /// The projected coordinate reference system of the world, in which latitudes and longitudes are
    /// projected: `EPSG:25832`, or `+proj=…`.
    pub crs: Option<String>,
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
    /// Bias instability, °/h. Default 7. The bias random walk reaches it in the correlation time.
    pub gyro_bias_instability_deg_h: Option<f64>,
    /// Bias instability, µg. Default 14. The bias random walk reaches it in the correlation time.
    pub accel_bias_instability_ug: Option<f64>,
    /// Bias random walk, rad/s/√s, instead of the instability.
    pub gyro_bias_walk_rad_s_sqrt_s: Option<f64>,
    /// Bias random walk, m/s²/√s, instead of the instability.
    pub accel_bias_walk_m_s2_sqrt_s: Option<f64>,
}

/// `[prism]`, or several `[[prism]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prism {
    /// Default `prism`; required if there are several.
    pub name: Option<String>,
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Standard deviation of each coordinate, or of east, north, up, if the log gives none. Default
    /// 0.005. For polar observations: the contribution of tracking to the instrument's noise.
    pub sigma_m: Option<Numbers>,
    /// Standard deviation of the lasting part of its errors, of each coordinate, or of east, north,
    /// up. Default 0.
    pub sigma_correlated_m: Option<Numbers>,
    /// With `sigma_correlated_m`: the correlation time of that part. Default 30.
    pub correlation_s: Option<f64>,
    /// Prism in the body frame.
    pub lever_arm_m: [f64; 3],
    /// Standard deviation of each coordinate of the lever arm. Default 0.002.
    pub sigma_lever_arm_m: Option<f64>,
    /// Loss function for large residuals. Default `truncated`.
    pub loss: Option<Loss>,
    /// `cartesian` or `polar`, if the file contains both.
    pub observations: Option<ObservationKind>,
    /// The total station's position in the world.
    pub station_m: Option<[f64; 3]>,
    /// Azimuth of its horizontal zero, clockwise from grid north; makes the log a polar one.
    pub station_orientation_deg: Option<f64>,
    /// `zenith` (default) or `elevation`.
    pub vertical_angle: Option<VerticalAngle>,
    /// Added to slope distances. Default 0.
    pub reflector_constant_m: Option<f64>,
    /// Standard deviation of a slope distance, constant part. Default 0.001.
    pub sigma_distance_m: Option<f64>,
    /// Standard deviation of a slope distance, proportional part. Default 1.
    pub sigma_distance_ppm: Option<f64>,
    /// Standard deviation of either angle, seconds of arc. Default 1.
    pub sigma_angle_arcsec: Option<f64>,
}

/// What to read from a position log that contains coordinates and polar observations.
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
    /// Default `gnss`; required if there are several.
    pub name: Option<String>,
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Standard deviation of each coordinate, or of east, north, up, if the log gives none. Default
    /// 0.02, 0.02, 0.04.
    pub sigma_m: Option<Numbers>,
    /// Standard deviation of the lasting part of its errors, of each coordinate, or of east, north,
    /// up. Default 0.
    pub sigma_correlated_m: Option<Numbers>,
    /// With `sigma_correlated_m`: the correlation time of that part. Default 30.
    pub correlation_s: Option<f64>,
    /// Antenna in the body frame.
    pub lever_arm_m: [f64; 3],
    /// Standard deviation of each coordinate of the lever arm. Default 0.002.
    pub sigma_lever_arm_m: Option<f64>,
    /// Loss function for large residuals. Default `truncated`.
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
    /// Standard deviation if the log gives none. Default 0.7.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of the pitch if the log has a pitch without one. Default: `sigma_deg`.
    pub sigma_pitch_deg: Option<f64>,
    /// Standard deviation of the lasting part of the heading's errors. Default 0.
    pub sigma_correlated_deg: Option<f64>,
    /// With `sigma_correlated_deg`: the correlation time of that part. Default 30.
    pub correlation_s: Option<f64>,
    /// From the antenna baseline to the body's x axis, clockwise. Default 0.
    pub mounting_offset_deg: Option<f64>,
    /// Loss function for large residuals. Default `truncated`.
    pub loss: Option<Loss>,
}

/// `[trajectory]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Poses instead of logs, relative to the project file; several files are poses of one drive at different
    /// times, as those of each scanner's profiles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<Files>,
    /// With `file`: common time = time in the file + this.
    pub time_offset_s: Option<f64>,
    /// With `file`: standard deviation of each coordinate if the file gives none.
    pub sigma_position_m: Option<f64>,
    /// With `file`: standard deviation about each axis if the file gives none.
    pub sigma_rotation_deg: Option<f64>,
    /// With `file`: correlation time of the errors of the poses. Default 5.
    pub correlation_s: Option<f64>,
    /// Without `file`: `prism` (default) or `imu`.
    pub nodes: Option<Nodes>,
    /// Without `file`: constants to estimate together with the trajectory, or `"auto"`: those that
    /// the drive contradicts. Default `"auto"`.
    pub estimate: Option<toml::Value>,
    /// Without `file`: constrain the velocity to zero where the logs show rest. Default true.
    pub zero_velocity: Option<bool>,
    /// Largest standard deviation of a coordinate for points to be georeferenced. Default none.
    pub max_sigma_position_m: Option<f64>,
    /// Largest standard deviation about an axis for points to be georeferenced. Default none.
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
    /// Position of the scanner in the body frame.
    pub translation_m: [f64; 3],
    /// α, β, γ in `rotation_convention`.
    pub rotation_deg: Option<[f64; 3]>,
    /// Instead of the angles.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// `zyx` (default) or `bonn`.
    pub rotation_convention: Option<EulerConvention>,
    /// Fixed parameters, of tx ty tz rx ry rz.
    pub fixed: Option<Vec<String>>,
    /// With the joint adjustment: `time_offset`, to estimate a correction of it. Default none.
    pub estimate: Option<Vec<String>>,
    /// How the mounting follows the load on the frame. Default: not at all.
    pub compliance: Option<Compliance>,
}

/// `[scanner.compliance]`: the mounting under another load than that at which it is the given one. Loads
/// are the direction up along the body's x and y axes, and its acceleration along them in units of gravity.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compliance {
    /// The load at which the mounting is the given one.
    pub reference_load_g: [f64; 4],
    /// Shift along x, y, z of the body by each load.
    pub shift_m_per_g: [[f64; 4]; 3],
    /// Rotation about x, y, z of the body by each load.
    pub turn_deg_per_g: [[f64; 4]; 3],
    /// Standard deviations.
    pub sigma_shift_m_per_g: [[f64; 4]; 3],
    /// Standard deviations.
    pub sigma_turn_deg_per_g: [[f64; 4]; 3],
}

/// `[reference]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Standard deviation of a shift of the whole reference, along each axis. Default 0.002.
    pub sigma_m: Option<f64>,
    /// Standard deviation of a tilt of the whole reference, about each horizontal axis. Default
    /// 0.005.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of errors of its surface that span decimetres. Default: assumed by the
    /// joint adjustment.
    pub sigma_surface_m: Option<f64>,
}

/// `[calibration]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Voxel sizes from coarse to fine, or `"auto"` (default): from the misfit to the spacing of points.
    pub voxel_sizes_m: Option<toml::Value>,
    /// Number of points in each neighbourhood.
    pub neighbours: Option<usize>,
    /// `joint` (default), `two-step` or `paper`.
    pub method: Option<Method>,
    /// Largest number of iterations per scale.
    pub max_iterations: Option<usize>,
    /// A point of the same scanner and voxel belongs to another pass if it is this much later.
    pub pass_gap_s: Option<f64>,
}

/// How trajectory and mountings are estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// In one adjustment.
    #[default]
    Joint,
    /// The trajectory first, then the mountings.
    #[serde(alias = "reweighted")]
    TwoStep,
    /// The trajectory first, then the mountings as in the paper.
    Paper,
}

impl Method {
    /// The method of the second step; that of the start if there is one adjustment.
    pub fn of_second_step(self) -> calibration::Method {
        match self {
            Self::Joint | Self::TwoStep => calibration::Method::TwoStep,
            Self::Paper => calibration::Method::Paper,
        }
    }
}

/// `[joint]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Size of the surfels. Default ten times the finest voxel.
    pub surfel_m: Option<f64>,
    /// Largest number of iterations. Default 50.
    pub max_iterations: Option<usize>,
    /// How much mountings may move. Default `auto`.
    pub mounting: Option<MountingMotion>,
}

/// `[bending]`: what mountings may follow beside tilt, acceleration and time
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bending {
    /// A text table with `time_s`, relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// One or two of its columns, in any units: a temperature, a load.
    pub columns: Vec<String>,
}

/// How much mountings may move.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MountingMotion {
    /// As much as the tests of the adjustment ask for.
    #[default]
    Auto,
    /// Not at all.
    Rigid,
    /// Linearly with the load, and with time.
    Compliance,
    /// And slowly, in any way.
    SlowKnots,
    /// And as fast as the trajectory is known.
    DenseKnots,
}

/// `[comparison]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Spacing of core points.
    pub core_spacing_m: Option<f64>,
    /// Radii of the neighbourhoods for normals.
    pub normal_radii_m: Option<Vec<f64>>,
    /// Radius of the cylinder.
    pub cylinder_radius_m: Option<f64>,
    /// Half length of the cylinder.
    pub max_distance_m: Option<f64>,
    /// Added to the level of detection.
    pub registration_error_m: Option<f64>,
    /// `mean` (default) or `median`.
    pub aggregation: Option<Aggregation>,
    /// `normal` (default) or `student`.
    pub detection: Option<Detection>,
    /// Cylinders along the normal only, not against it.
    pub one_sided: Option<bool>,
    /// Fewest points of either cloud for a distance.
    pub min_points: Option<u32>,
}

/// `[acceptance]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acceptance {
    /// Largest standard deviation of a mounting's position. Default 0.005.
    pub sigma_translation_m: Option<f64>,
    /// Largest standard deviation of a mounting's rotation. Default 0.1.
    pub sigma_rotation_deg: Option<f64>,
    /// Largest median and NMAD of distances between clouds. Default 0.005.
    pub distance_m: Option<f64>,
    /// Least share of the common field that distances rest on. Default 0.5.
    pub coverage: Option<f64>,
}

/// `[report]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Heading of the page. Default: the calibration of the drive.
    pub title: Option<String>,
    /// Who answers for it.
    pub author: Option<String>,
    /// Where they work.
    pub organisation: Option<String>,
    /// A PNG, JPEG, WebP or SVG file.
    pub logo: Option<PathBuf>,
}

impl Report {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// `[[drive]]` and `[[evaluation]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OtherDrive {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// Its project file, relative to this one.
    pub project: PathBuf,
}
