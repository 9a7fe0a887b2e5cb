//! What each stage needs to know, checked and in SI units.

use crate::geometry::{BodyAxes, Vec3};

/// Noise of the IMU as continuous-time densities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuNoise {
    /// Gyro white noise (angle random walk), rad/s/√Hz.
    pub gyro_density: f64,
    /// Accelerometer white noise (velocity random walk), m/s²/√Hz.
    pub accel_density: f64,
    /// Gyro bias random walk, rad/s/√s.
    pub gyro_bias_walk: f64,
    /// Accelerometer bias random walk, m/s²/√s.
    pub accel_bias_walk: f64,
}

/// The prism on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrismSettings {
    /// Standard deviation of each coordinate where the log gives none, metres.
    pub sigma_m: f64,
    /// The prism in the body frame, metres.
    pub lever_arm_m: Vec3,
}

/// The heading antennas on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingSettings {
    /// Standard deviation where the log gives none, radians.
    pub sigma_rad: f64,
    /// Heading of the body's x axis = heading of the antenna baseline + this, radians, clockwise.
    pub mounting_offset_rad: f64,
    /// Grid convergence: grid heading = true heading − this, radians.
    pub grid_convergence_rad: f64,
}

/// All that the trajectory stage needs beside the logs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectorySettings {
    /// Axes of the body frame.
    pub axes: BodyAxes,
    /// Magnitude of gravity, m/s²; it points along −z of the world.
    pub gravity_m_s2: f64,
    /// IMU noise.
    pub imu: ImuNoise,
    /// Prism.
    pub prism: PrismSettings,
    /// Heading.
    pub heading: HeadingSettings,
}

/// How the mounting is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Reweighted least squares with analytic derivatives, one point a voxel, scanner and pass.
    #[default]
    Reweighted,
    /// As the paper: numeric Jacobian of the omnivariances, one point a voxel, Gauss-Newton.
    Paper,
}

/// Settings of the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationSettings {
    /// Coarse to fine, metres.
    pub voxel_sizes_m: Vec<f64>,
    /// Neighbours in each neighbourhood (k).
    pub neighbours: usize,
    /// How.
    pub method: Method,
    /// Most iterations a scale.
    pub max_iterations: usize,
    /// A point of the same scanner and voxel this much later belongs to another pass, seconds.
    pub pass_gap_s: f64,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self {
            voxel_sizes_m: vec![0.05, 0.04, 0.03, 0.02, 0.01, 0.005],
            neighbours: 50,
            method: Method::Reweighted,
            max_iterations: 50,
            pass_gap_s: 3.0,
        }
    }
}

/// Settings of the M3C2 comparison. Radii are radii.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparisonSettings {
    /// Core points are thinned to this spacing, metres.
    pub core_spacing_m: f64,
    /// Radii of the neighbourhoods for normals; the most planar one counts, metres.
    pub normal_radii_m: Vec<f64>,
    /// Radius of the cylinder, metres.
    pub cylinder_radius_m: f64,
    /// Half length of the cylinder, metres.
    pub max_distance_m: f64,
    /// Registration error added to the level of detection, metres.
    pub registration_error_m: f64,
}

impl Default for ComparisonSettings {
    fn default() -> Self {
        Self {
            core_spacing_m: 0.02,
            normal_radii_m: vec![0.04],
            cylinder_radius_m: 0.02,
            max_distance_m: 0.1,
            registration_error_m: 0.0,
        }
    }
}
