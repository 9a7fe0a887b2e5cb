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
    /// Axes of the body, the world, gravity.
    #[serde(default)]
    pub frame: Frame,
    /// The IMU. With `[prism]` or `[gnss]`, and optionally `[heading]`, the trajectory is estimated from its log. The
    /// defaults of its noise are those of an SBG Ellipse-D.
    pub imu: Option<Imu>,
    /// A prism that a total station tracks.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub prism: Tables<Prism>,
    /// A GNSS antenna.
    #[serde(default, skip_serializing_if = "Tables::is_empty")]
    pub gnss: Tables<Gnss>,
    /// Headings of the baseline between two antennas.
    pub heading: Option<Heading>,
    /// What mountings may follow beside tilt, acceleration and time.
    pub bending: Option<Bending>,
    /// How the trajectory is estimated, or poses instead of the logs.
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
    /// What results are held against.
    #[serde(default)]
    pub acceptance: Acceptance,
    /// Who made the report.
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
    /// Subtracted from world coordinates on reading, added on writing.
    pub origin_m: Option<[f64; 3]>,
    /// The projected coordinate reference system of the world, `"EPSG:25832"` or `"+proj=…"`: latitudes and
    /// longitudes of logs and SBET files are projected into it, without a datum shift.
    pub crs: Option<String>,
    /// Grid heading = true heading − this.
    pub grid_convergence_deg: Option<f64>,
    /// Gravity where the drive was.
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
    /// Standard deviation of each coordinate, or of east, north, up, if the log gives none. For polar observations
    /// that of tracking, added to the instrument's noise in quadrature, and 0 unless given if any of
    /// `sigma_distance_m`, `sigma_distance_ppm`, `sigma_angle_arcsec` is.
    pub sigma_m: Option<Numbers>,
    /// Standard deviation of errors that last, besides `sigma_m`: of each coordinate, or of east, north, up.
    pub sigma_correlated_m: Option<Numbers>,
    /// With `sigma_correlated_m`: how long they last.
    pub correlation_s: Option<f64>,
    /// Prism in the body frame, from the IMU.
    pub lever_arm_m: [f64; 3],
    /// Standard deviation of each coordinate of the lever arm; positions of mountings are no better known.
    pub sigma_lever_arm_m: Option<f64>,
    /// Loss of large residuals: `"none"`, `"huber"`, `"cauchy"`, `"truncated"`.
    pub loss: Option<Loss>,
    /// `"cartesian"` or `"polar"`, if the file has both.
    pub observations: Option<ObservationKind>,
    /// Position of the total station in the world, for the line of sight and for polar observations.
    pub station_m: Option<[f64; 3]>,
    /// Azimuth of its horizontal zero, clockwise from grid north: the log is then polar.
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
    /// Required if there are several.
    pub name: Option<String>,
    /// The log.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Standard deviation of each coordinate, or of east, north, up, if the log gives none.
    /// Positions are in projected or local coordinates.
    pub sigma_m: Option<Numbers>,
    /// Standard deviation of errors that last, besides `sigma_m`: of each coordinate, or of east, north, up.
    pub sigma_correlated_m: Option<Numbers>,
    /// With `sigma_correlated_m`: how long they last.
    pub correlation_s: Option<f64>,
    /// Antenna in the body frame, from the IMU.
    pub lever_arm_m: [f64; 3],
    /// Standard deviation of each coordinate of the lever arm; positions of mountings are no better known.
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
    /// Standard deviation of errors that last, besides `sigma_deg`.
    pub sigma_correlated_deg: Option<f64>,
    /// With `sigma_correlated_deg`: how long they last.
    pub correlation_s: Option<f64>,
    /// From the antenna baseline to the body's x axis, clockwise.
    pub mounting_offset_deg: Option<f64>,
    /// Loss of large residuals: `"none"`, `"huber"`, `"cauchy"`, `"truncated"`.
    pub loss: Option<Loss>,
}

/// `[trajectory]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Poses instead of `[imu]`, `[prism]`, `[gnss]`, `[heading]`; several files are poses of one drive at different
    /// times, as those of each scanner's profiles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<Files>,
    /// With `file`: common time = time in the file + this.
    pub time_offset_s: Option<f64>,
    /// With `file`: standard deviation of each coordinate if the file gives none.
    pub sigma_position_m: Option<f64>,
    /// With `file`: standard deviation about each axis if the file gives none.
    pub sigma_rotation_deg: Option<f64>,
    /// With `file`: how long errors of the poses last.
    pub correlation_s: Option<f64>,
    /// Without `file`: `"prism"`, a node at each position and at least one per second; `"imu"`, at every IMU sample.
    pub nodes: Option<Nodes>,
    /// Without `file`: `"auto"`, the constants that the drive contradicts, each of them said; or a list of `<prism or
    /// gnss>.time_offset`, `<prism or gnss>.lever_arm`, `<prism>.incidence_bias` (needs `station_m`),
    /// `heading.mounting_offset`, `heading.time_offset`, `frame.gravity`, `imu.noise_scale`; `[]` for none.
    pub estimate: Option<toml::Value>,
    /// Without `file`: the velocity is held at zero where the logs show rest.
    pub zero_velocity: Option<bool>,
    /// Points are left out if the standard deviation of a coordinate of their pose is larger. Default: no limit.
    pub max_sigma_position_m: Option<f64>,
    /// Points are left out if the standard deviation of their pose about an axis is larger. Default: no limit.
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
    /// Position of the scanner in the body frame, from the IMU, to some centimetres.
    pub translation_m: [f64; 3],
    /// α, β, γ in `rotation_convention`, to some degrees; this or `quaternion_xyzw` is required.
    pub rotation_deg: Option<[f64; 3]>,
    /// Instead of the angles: body from scanner.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// `"zyx"`: R = Rz(γ) Ry(β) Rx(α); `"bonn"`: its transpose, as in the paper. R turns the scanner's axes into the
    /// body's.
    pub rotation_convention: Option<EulerConvention>,
    /// Parameters held at their values, of `tx ty tz rx ry rz`. Default: none.
    pub fixed: Option<Vec<String>>,
    /// `["time_offset"]`: the joint adjustment corrects it. Default: none.
    pub estimate: Option<Vec<String>>,
    /// A table as in `calibration.toml`: how the mounting follows the load on the frame. Default: not at all.
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
    /// The cloud.
    pub file: PathBuf,
    /// Standard deviation of a shift of the whole reference, along each axis. Default 0.002.
    pub sigma_m: Option<f64>,
    /// Standard deviation of a tilt of the whole reference, about each axis; it and `sigma_m` are marked as assumed if
    /// neither is given. Default 0.005.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of errors of its surface that span decimetres. Default: assumed by the
    /// joint adjustment.
    pub sigma_surface_m: Option<f64>,
}

/// `[calibration]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// From coarse to fine. `"auto"`: 10, 8, 6, 4, 2 times and once the spacing of the points, which counts as at least
    /// 5 mm, or 1/150 of the ranges if that is less; coarser ones come first where the clouds lie farther apart.
    pub voxel_sizes_m: Option<toml::Value>,
    /// Number of points in each neighbourhood.
    pub neighbours: Option<usize>,
    /// `"joint"`: one adjustment of trajectory and mountings; `"two-step"`: the mountings after the trajectory;
    /// `"paper"`: as the paper.
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
    /// Size of the patches of the surface. Default: ten times the finest voxel.
    pub surfel_m: Option<f64>,
    /// Largest number of iterations.
    pub max_iterations: Option<usize>,
    /// How much mountings may move: `"rigid"`, `"compliance"` (with the load), `"slow-knots"`, `"dense-knots"` (also with
    /// time); `"auto"`: rigid, and as much more as the drive asks for.
    pub mounting: Option<MountingMotion>,
}

/// `[bending]`: what mountings may follow beside tilt, acceleration and time
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bending {
    /// A text table with `time_s`.
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
    /// Radii of the neighbourhoods for normals; the most planar one is used.
    pub normal_radii_m: Option<Vec<f64>>,
    /// Radius of the cylinder.
    pub cylinder_radius_m: Option<f64>,
    /// Half length of the cylinder.
    pub max_distance_m: Option<f64>,
    /// Added to the level of detection.
    pub registration_error_m: Option<f64>,
    /// `"mean"` and standard deviation, or `"median"` and inter-quartile range.
    pub aggregation: Option<Aggregation>,
    /// Distribution behind the level of detection: `"normal"`, or `"student"`, valid for few points too.
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
    /// Largest standard deviation of a mounting's position that is accepted.
    pub sigma_translation_m: Option<f64>,
    /// Largest standard deviation of a mounting's rotation that is accepted.
    pub sigma_rotation_deg: Option<f64>,
    /// Largest median and NMAD of distances between clouds that are accepted.
    pub distance_m: Option<f64>,
    /// Least share of the common field that distances rest on.
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
