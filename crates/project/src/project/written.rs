//! The project file as written: degrees, datasheet units, paths relative to the file.
//!
//! Every table refuses unknown keys.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::shapes::{Files, Numbers, Tables};
use super::units::{AccelUnit, GyroUnit, TimeUnit};
use crate::calibration;
use crate::comparison::{Aggregation, Detection};
use crate::geometry::{BodyAxes, EulerConvention};
use crate::sensor::VerticalAngle;
use crate::trajectory::{Loss, Nodes};

/// The whole file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Written {
    /// Axes of the body, the world, gravity.
    #[serde(default)]
    pub frame: Frame,
    /// The IMU. With `[prism]` or `[gnss]`, and optionally `[heading]`, the trajectory is estimated from its log. The
    /// defaults of its noise are those of an SBG Ellipse-D. A sample is the mean over the interval from its time to that of
    /// the next one; if the times are those of the ends, subtract an interval with `time_offset_s`.
    pub imu: Option<Imu>,
    /// A prism that a total station tracks.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub prism: Tables<Prism>,
    /// A GNSS antenna.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub gnss: Tables<Gnss>,
    /// Headings of the baseline between two antennas.
    pub heading: Option<Heading>,
    /// A log of further quantities that may bend the frame, besides tilt, acceleration and time.
    pub bending: Option<Bending>,
    /// Settings of the estimation of the trajectory, or poses instead of the logs.
    pub trajectory: Option<Trajectory>,
    /// A scanner.
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
    /// M3C2; radii, not diameters.
    #[serde(default)]
    pub comparison: Comparison,
    /// Limits that the results must meet.
    #[serde(default)]
    pub acceptance: Acceptance,
    /// Title, author, organisation and logo of the report.
    #[serde(default, skip_serializing_if = "Report::is_empty")]
    pub report: Report,
    /// Another drive, adjusted together with this one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub drive: Vec<OtherDrive>,
    /// Another drive, evaluated with the calibrated mountings.
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
    /// Axes of the IMU and thereby of the body: `"FRD"`, x forward, y right, z down, or `"FLU"`, x forward, y left,
    /// z up.
    pub body: Option<BodyAxes>,
    /// Subtracted from world coordinates on reading, added on writing; without it, whole kilometres near the first
    /// position, and the run says which
    pub origin_m: Option<[f64; 3]>,
    /// The projected coordinate reference system of the world, `"EPSG:25832"` or `"+proj=…"`: latitudes and
    /// longitudes of logs and SBET files are projected into it, without a datum shift.
    pub crs: Option<String>,
    /// Grid heading = true heading − this.
    pub grid_convergence_deg: Option<f64>,
    /// Gravity at the place of the drive.
    pub gravity_m_s2: Option<f64>,
}

/// `[imu]`; the defaults are those of an SBG Ellipse-D.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imu {
    /// The log.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Unit of the specific forces if the file cannot name it, as a recording of ROS: `"m_s2"`, `"g"`, `"mg"`.
    pub accel_unit: Option<AccelUnit>,
    /// Unit of the angular rates if the file cannot name it: `"rad_s"`, `"deg_s"`.
    pub gyro_unit: Option<GyroUnit>,
    /// Angle random walk, °/√h, as datasheets give it.
    pub gyro_noise_deg_sqrt_h: Option<f64>,
    /// Velocity random walk, µg/√Hz, as datasheets give it.
    pub accel_noise_ug_sqrt_hz: Option<f64>,
    /// Bias instability, °/h: a random walk of the bias reaches it in 100 s.
    pub gyro_bias_instability_deg_h: Option<f64>,
    /// Bias instability, µg: a random walk of the bias reaches it in 100 s.
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
    /// Required if there are several.
    pub name: Option<String>,
    /// The log.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Standard deviation of each coordinate, or of east, north, up, if the log gives none. For polar observations, it
    /// is the standard deviation of tracking, which is added to the instrument's noise in quadrature; it is 0 if it is
    /// not given but any of `sigma_distance_m`, `sigma_distance_ppm`, `sigma_angle_arcsec` is.
    pub sigma_m: Option<Numbers>,
    /// Standard deviation of time-correlated errors, in addition to `sigma_m`: of each coordinate, or of east, north,
    /// up.
    pub sigma_correlated_m: Option<Numbers>,
    /// With `sigma_correlated_m`: correlation time of these errors.
    pub correlation_s: Option<f64>,
    /// Position of the prism in the body frame, from the IMU.
    pub lever_arm_m: [f64; 3],
    /// Standard deviation of each coordinate of the lever arm. It also limits the accuracy of mounting positions.
    pub sigma_lever_arm_m: Option<f64>,
    /// Loss of large residuals: `"none"`, `"huber"`, `"cauchy"`, `"truncated"`.
    pub loss: Option<Loss>,
    /// `"cartesian"` or `"polar"`, if the file has both.
    pub observations: Option<ObservationKind>,
    /// Position of the total station in the world, for the line of sight and for polar observations.
    pub station_m: Option<[f64; 3]>,
    /// Azimuth of the total station's horizontal zero, clockwise from grid north; if given, the log is polar.
    pub station_orientation_deg: Option<f64>,
    /// `"zenith"`: 0 upwards; `"elevation"`: 0 at the horizon.
    pub vertical_angle: Option<VerticalAngle>,
    /// Added to slope distances.
    pub reflector_constant_m: Option<f64>,
    /// Standard deviation of a slope distance, constant part.
    pub sigma_distance_m: Option<f64>,
    /// Standard deviation of a slope distance, proportional part.
    pub sigma_distance_ppm: Option<f64>,
    /// Standard deviation of either angle, seconds of arc.
    pub sigma_angle_arcsec: Option<f64>,
}

/// The observations to read from a position log that contains coordinates and polar observations.
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
    /// Required if there are several.
    pub name: Option<String>,
    /// The log.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Standard deviation of each coordinate, or of east, north, up, if the log gives none.
    /// Positions are in projected or local coordinates.
    pub sigma_m: Option<Numbers>,
    /// Standard deviation where the receiver reports a float solution and gives no standard deviation itself.
    pub sigma_float_m: Option<Numbers>,
    /// The same for a differential solution (DGPS, SBAS).
    pub sigma_differential_m: Option<Numbers>,
    /// The same for a single solution. Errors of float, differential and single solutions last `correlation_s`.
    pub sigma_single_m: Option<Numbers>,
    /// Standard deviation of time-correlated errors, in addition to `sigma_m`: of each coordinate, or of east, north,
    /// up.
    pub sigma_correlated_m: Option<Numbers>,
    /// With `sigma_correlated_m`: correlation time of these errors.
    pub correlation_s: Option<f64>,
    /// Position of the antenna in the body frame, from the IMU.
    pub lever_arm_m: [f64; 3],
    /// Standard deviation of each coordinate of the lever arm. It also limits the accuracy of mounting positions.
    pub sigma_lever_arm_m: Option<f64>,
    /// Loss of large residuals: `"none"`, `"huber"`, `"cauchy"`, `"truncated"`.
    pub loss: Option<Loss>,
}

/// `[heading]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heading {
    /// The log.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Standard deviation if the log gives none.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of the pitch if the log has a pitch without one. Default: as `sigma_deg`.
    pub sigma_pitch_deg: Option<f64>,
    /// Standard deviation of time-correlated errors, in addition to `sigma_deg`.
    pub sigma_correlated_deg: Option<f64>,
    /// With `sigma_correlated_deg`: correlation time of these errors.
    pub correlation_s: Option<f64>,
    /// Angle from the antenna baseline to the body's x axis, clockwise.
    pub mounting_offset_deg: Option<f64>,
    /// Loss of large residuals: `"none"`, `"huber"`, `"cauchy"`, `"truncated"`.
    pub loss: Option<Loss>,
}

/// `[trajectory]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Poses instead of `[imu]`, `[prism]`, `[gnss]`, `[heading]`. Several files are poses of one drive at different
    /// times, such as the times of each scanner's profiles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<Files>,
    /// With `file`: common time = time in the file + this.
    pub time_offset_s: Option<f64>,
    /// With `file`: standard deviation of each coordinate if the file gives none.
    pub sigma_position_m: Option<f64>,
    /// With `file`: standard deviation about each axis if the file gives none.
    pub sigma_rotation_deg: Option<f64>,
    /// With `file`: correlation time of the errors of the poses; the joint adjustment starts from it and from their
    /// standard deviations, and estimates both.
    pub correlation_s: Option<f64>,
    /// Without `file`: `"prism"`, a node at each position and at least one per second; `"imu"`, a node at every IMU
    /// sample.
    pub nodes: Option<Nodes>,
    /// Without `file`: `"auto"`, the constants that the drive contradicts, each of which is reported; or a list of
    /// `<prism or gnss>.time_offset`, `<prism or gnss>.time_drift`, `<prism or gnss>.lever_arm`,
    /// `<prism>.incidence_bias` (needs `station_m`), `heading.mounting_offset`, `heading.time_offset`, `frame.gravity`,
    /// `imu.gyro_scale_factor`, `imu.noise_scale`; `[]` for none.
    pub estimate: Option<toml::Value>,
    /// Without `file`: whether the velocity is held at zero while the logs show rest.
    pub zero_velocity: Option<bool>,
    /// Points are left out if the standard deviation of a coordinate of their pose exceeds this. Default: no limit.
    pub max_sigma_position_m: Option<f64>,
    /// Points are left out if the standard deviation of their pose about an axis exceeds this. Default: no limit.
    pub max_sigma_rotation_deg: Option<f64>,
}

/// `[[scanner]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scanner {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// One recording, or a list of them in time order.
    pub profiles: Files,
    /// Common time = scanner time + this.
    pub time_offset_s: Option<f64>,
    /// With a recording of ROS: the field of the points of a cloud that holds their times, if its name is not known; `""` if
    /// they have none.
    pub point_time_field: Option<String>,
    /// With a recording of ROS: the unit of these times if it is not that of their type: `"s"`, `"ms"`, `"us"`, `"ns"`.
    pub point_time_unit: Option<TimeUnit>,
    /// Position of the scanner in the body frame, from the IMU, to some centimetres.
    pub translation_m: [f64; 3],
    /// α, β, γ in `rotation_convention`, to some degrees; this or `quaternion_xyzw` is required.
    pub rotation_deg: Option<[f64; 3]>,
    /// Instead of the angles: the quaternion that turns scanner axes into body axes.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// `"zyx"`: R = Rz(γ) Ry(β) Rx(α); `"bonn"`: its transpose, as in the paper. R turns the scanner's axes into the
    /// body's.
    pub rotation_convention: Option<EulerConvention>,
    /// Parameters held at their values, from `tx ty tz rx ry rz`. Default: none.
    pub fixed: Option<Vec<String>>,
    /// `["time_offset"]`: the joint adjustment corrects the time offset. Default: none.
    pub estimate: Option<Vec<String>>,
    /// A table as in `calibration.toml`: the change of the mounting with the load on the frame. Default: no change.
    pub compliance: Option<Compliance>,
}

/// `[scanner.compliance]`: the change of the mounting with the load. The given mounting is valid at the reference load.
/// The four loads are the x and y components, in body axes, of the upward direction and of the acceleration in units
/// of gravity.
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
    /// The cloud.
    pub file: PathBuf,
    /// Standard deviation of a shift of the whole reference, along each axis. Default 0.002.
    pub sigma_m: Option<f64>,
    /// Standard deviation of a tilt of the whole reference, about each axis. This and `sigma_m` are marked as assumed
    /// if neither is given. Default 0.005.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of errors of the reference surface that extend over decimetres. Default: assumed by the
    /// joint adjustment.
    pub sigma_surface_m: Option<f64>,
}

/// `[calibration]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Voxel sizes from coarse to fine. `"auto"`: 10, 8, 6, 4, 2 times and once the spacing of the points of the densest
    /// scanner, which counts as at least 5 mm, or 1/150 of the ranges if that is less; without sizes that are coarser than
    /// initial values with errors of 0.1 m and 3.4° require; coarser sizes come first if the clouds lie farther apart.
    pub voxel_sizes_m: Option<toml::Value>,
    /// Number of points in each neighbourhood.
    pub neighbours: Option<usize>,
    /// `"joint"`: one adjustment of trajectory and mountings; `"two-step"`: the mountings after the trajectory;
    /// `"paper"`: as in the paper.
    pub method: Option<Method>,
    /// Largest number of iterations per scale.
    pub max_iterations: Option<usize>,
    /// A point in the same voxel from the same scanner belongs to another pass if it is later by this much.
    pub pass_gap_s: Option<f64>,
}

/// Method of estimating trajectory and mountings.
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
    /// The method of the second step; for the joint adjustment, the method of its start.
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
    /// Size of the surface patches (surfels). Default: ten times the finest voxel, or less where the points of a profile
    /// are closer than profiles are; half of that where the ground is rougher.
    pub surfel_m: Option<f64>,
    /// Largest number of iterations.
    pub max_iterations: Option<usize>,
    /// Model of moving mountings: `"rigid"`, `"compliance"` (with the load), `"slow-knots"`, `"dense-knots"` (also with
    /// time); `"auto"`: rigid, or the least motion that the drive requires.
    pub mounting: Option<MountingMotion>,
}

/// `[bending]`: a log of further quantities that may bend the frame, besides tilt, acceleration and time
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bending {
    /// A text table with `time_s`.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// One or two columns of the table, in any units: a temperature, a load.
    pub columns: Vec<String>,
}

/// Model of moving mountings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MountingMotion {
    /// The model that the tests of the adjustment require.
    #[default]
    Auto,
    /// No motion.
    Rigid,
    /// Motion that is linear in the load and in time.
    Compliance,
    /// Compliance, and slow motion of any form.
    SlowKnots,
    /// Compliance, and motion as fast as the trajectory can resolve.
    DenseKnots,
}

/// `[comparison]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Spacing of core points.
    pub core_spacing_m: Option<f64>,
    /// Radii of the neighbourhoods for normals; the most planar neighbourhood is used.
    pub normal_radii_m: Option<Vec<f64>>,
    /// Radius of the cylinder.
    pub cylinder_radius_m: Option<f64>,
    /// Half length of the cylinder.
    pub max_distance_m: Option<f64>,
    /// Registration error, added to the level of detection.
    pub registration_error_m: Option<f64>,
    /// `"mean"` and standard deviation, or `"median"` and inter-quartile range.
    pub aggregation: Option<Aggregation>,
    /// Distribution for the level of detection: `"normal"`, or `"student"`, which is also valid for few points.
    pub detection: Option<Detection>,
    /// Whether cylinders extend only along the normal, not against it.
    pub one_sided: Option<bool>,
    /// Least number of points of each cloud for a distance.
    pub min_points: Option<u32>,
}

/// `[acceptance]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acceptance {
    /// Largest accepted standard deviation of a mounting's position.
    pub sigma_translation_m: Option<f64>,
    /// Largest accepted standard deviation of a mounting's rotation.
    pub sigma_rotation_deg: Option<f64>,
    /// Largest accepted median and NMAD of distances between clouds.
    pub distance_m: Option<f64>,
    /// Least accepted share of the common field that the distances cover.
    pub coverage: Option<f64>,
}

/// `[report]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Heading of the page. Default: the calibration of the drive.
    pub title: Option<String>,
    /// Person responsible for the report.
    pub author: Option<String>,
    /// Organisation of the author.
    pub organisation: Option<String>,
    /// Logo: a PNG, JPEG, WebP or SVG file.
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
    /// Its project file, relative to this project file.
    pub project: PathBuf,
}
