//! Keys of a scenario: the field and what stands on it, the robot's motion, its drives.

use serde::{Deserialize, Serialize};

/// Size of the field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Field {
    /// East and north, metres; one corner is the origin of the world.
    pub size_m: [f64; 2],
    /// Ground beyond the field on each side, for turning, metres.
    pub margin_m: f64,
}

/// Relief of the soil.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SoilSettings {
    /// Spacing of the height grid, metres.
    pub cell_m: f64,
    /// Wavelengths from undulation to crumbs, metres.
    pub wavelengths_m: Vec<f64>,
    /// Standard deviation of the height at each wavelength, metres.
    pub sigmas_m: Vec<f64>,
    /// Mean height of clods, metres; zero for none. They lie on the relief, at random and of random
    /// sizes, and wheels crush them.
    pub clod_height_m: f64,
    /// Mean diameter of clods, metres.
    pub clod_size_m: f64,
    /// Share of the ground that clods cover.
    pub clod_cover: f64,
}

/// A board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardSettings {
    /// Centre: east, north, up, metres.
    pub center_m: [f64; 3],
    /// Tilt against the horizon, degrees.
    pub tilt_deg: f64,
    /// Direction of the inclination of the normal, degrees clockwise from north.
    pub azimuth_deg: f64,
    /// Length along the level and the sloping edge, metres.
    pub size_m: [f64; 2],
    /// East, north, up by which it stands elsewhere during the drives than the reference has seen
    /// it, metres.
    #[serde(default)]
    pub moved_m: [f64; 3],
}

/// Motion of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionSettings {
    /// Speed over boards, m/s.
    pub scan_speed_m_s: f64,
    /// Speed between boards, m/s.
    pub transit_speed_m_s: f64,
    /// Rest before the drive, seconds.
    pub rest_s: f64,
    /// Tightest turn, metres.
    pub turn_radius_m: f64,
    /// Height of the IMU above ground, metres.
    pub imu_height_m: f64,
    /// Distance between the axles and between left and right wheels, metres.
    pub wheelbase_track_m: [f64; 2],
    /// Shortest wavelength of the ground that the wheels follow, metres.
    pub wheel_wavelength_m: f64,
    /// Natural frequency of the suspension, Hz.
    pub suspension_hz: f64,
    /// Damping ratio of the suspension.
    pub suspension_damping: f64,
}

/// A drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSettings {
    /// Passes over boards in order.
    pub passes: Vec<Pass>,
}

/// One straight pass over a board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pass {
    /// Index of the board.
    pub board: usize,
    /// Heading, degrees clockwise from north.
    pub heading_deg: f64,
}
