//! Keys of a scenario: the sensors on the robot and the reference.

use serde::{Deserialize, Serialize};

/// The IMU: datasheet of the SBG Ellipse-D.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuSettings {
    /// Samples per second.
    pub rate_hz: f64,
    /// Angle random walk, °/√h.
    pub gyro_noise_deg_sqrt_h: f64,
    /// Velocity random walk, µg/√Hz.
    pub accel_noise_ug_sqrt_hz: f64,
    /// Gyro bias instability, °/h.
    pub gyro_bias_instability_deg_h: f64,
    /// Accelerometer bias instability, µg.
    pub accel_bias_instability_ug: f64,
    /// Time in which a bias random walk reaches the instability, seconds.
    pub bias_time_s: f64,
    /// Standard deviation of each axis's initial bias, rad/s.
    pub gyro_bias_sigma_rad_s: f64,
    /// Standard deviation of each axis's initial bias, m/s².
    pub accel_bias_sigma_m_s2: f64,
    /// Specific force of a vibration of each axis, r.m.s., m/s²; zero for none. The motion itself, some micrometres, is
    /// left out.
    pub vibration_m_s2: f64,
    /// Frequency of the vibration, hertz.
    pub vibration_hz: f64,
    /// False for an ideal IMU.
    pub noise: bool,
    /// What a gyro reads beyond the true rate, as a share of it.
    pub gyro_scale: f64,
}

/// Prism and total station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PrismSettings {
    /// Positions per second.
    pub rate_hz: f64,
    /// White noise of each coordinate, metres.
    pub sigma_m: f64,
    /// The prism in the body (FRD), metres.
    pub lever_arm_m: [f64; 3],
    /// Delay of the time stamps of positions, seconds.
    pub latency_s: f64,
    /// Amplitude of an error that depends on the direction in which the line of sight enters the
    /// prism, metres.
    pub incidence_bias_m: f64,
    /// Position of the total station, metres.
    pub station_m: [f64; 3],
    /// Standard deviation of an error of each coordinate that fades within `correlation_s`, metres;
    /// zero for none. It adds to the white noise.
    pub sigma_correlated_m: f64,
    /// Time after which the autocovariance of this error (a first-order Gauss-Markov process) has
    /// fallen to 1/e, seconds.
    pub correlation_s: f64,
    /// Spans of the drive without positions, because the total station has lost the prism: from and
    /// to, seconds from the drive's start.
    pub lost_s: Vec<[f64; 2]>,
    /// Share of positions that are outliers.
    pub outlier_share: f64,
    /// Displacement of an outlier, in a random direction, metres.
    pub outlier_m: f64,
    /// Displacement of all positions within `displaced_s`, as after a knock on the total station, metres.
    pub displaced_m: [f64; 3],
    /// From and to, seconds from the drive's start.
    pub displaced_s: [f64; 2],
    /// Rate of the clock of the time stamps beyond that of the other sensors, parts per million, from the drive's start.
    pub clock_ppm: f64,
}

/// Heading antennas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HeadingSettings {
    /// Whether there are antennas.
    pub enabled: bool,
    /// Headings per second.
    pub rate_hz: f64,
    /// White noise, degrees.
    pub sigma_deg: f64,
    /// Heading of the body minus that of the antennas, degrees.
    pub mounting_offset_deg: f64,
    /// Delay of the time stamps of headings, seconds.
    pub latency_s: f64,
    /// Standard deviation of an error that fades within `correlation_s`, degrees; zero for none. It
    /// adds to the white noise.
    pub sigma_correlated_deg: f64,
    /// Time after which the autocovariance of this error (a first-order Gauss-Markov process) has
    /// fallen to 1/e, seconds.
    pub correlation_s: f64,
}

/// The profile scanners: datasheet of the Gocator 2490.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProfileSettings {
    /// Profiles per second.
    pub rate_hz: f64,
    /// Rays per profile.
    pub width: usize,
    /// Opening of the fan, degrees.
    pub fan_deg: f64,
    /// Nearest and farthest distance along the fan's axis, metres.
    pub range_m: [f64; 2],
    /// Noise at the nearest and farthest distance, linear between, metres.
    pub sigma_m: [f64; 2],
    /// Steps to which recorded coordinates are rounded, metres; zero for those of the file format.
    pub step_m: f64,
    /// Angle of incidence beyond which there is no return, degrees.
    pub grazing_deg: f64,
    /// Share of points lost at random.
    pub dropout: f64,
    /// Difference of neighbouring ranges above which they form an edge, metres, if a surface through both would be seen
    /// beyond the grazing angle.
    pub edge_m: f64,
    /// Share of points at edges that are lost, and share that lie between both sides.
    pub edge_lost_flying: [f64; 2],
}

/// Spinning lidars: all scanners of the kind `lidar`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarSettings {
    /// Revolutions per second about the z axis of the scanner.
    pub rate_hz: f64,
    /// Rays above one another.
    pub rings: usize,
    /// Opening of their fan, half of it above the x y plane of the scanner, degrees.
    pub fan_deg: f64,
    /// Directions per revolution, each at its own time.
    pub columns: usize,
    /// Nearest and farthest range, metres.
    pub range_m: [f64; 2],
    /// Noise of a range, metres.
    pub sigma_m: f64,
    /// Share of points lost at random.
    pub dropout: f64,
}

/// The kind of measurements of a scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScannerKind {
    /// Profiles, with the settings of `[profiles]`.
    #[default]
    Profile,
    /// Revolutions, with the settings of `[lidar]`.
    Lidar,
}

/// A scanner and its mounting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScannerSettings {
    /// Name.
    pub name: String,
    /// The kind of its measurements: `"profile"` or `"lidar"`.
    #[serde(default)]
    pub kind: ScannerKind,
    /// True position in the body (FRD), metres.
    pub translation_m: [f64; 3],
    /// True rotation body_from_scanner, degrees, `bonn`.
    pub rotation_deg: [f64; 3],
    /// Initial position for the calibration.
    pub initial_translation_m: [f64; 3],
    /// Initial rotation for the calibration, `bonn`.
    pub initial_rotation_deg: [f64; 3],
    /// Delay of the time stamps of its points, seconds.
    #[serde(default)]
    pub latency_s: f64,
    /// What a measured range is too long, metres.
    #[serde(default)]
    pub range_offset_m: f64,
}

/// The reference cloud of a terrestrial laser scanner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReferenceSettings {
    /// Whether there is a reference.
    pub enabled: bool,
    /// Spacing on the boards, metres.
    pub board_spacing_m: f64,
    /// Spacing on the soil, metres.
    pub soil_spacing_m: f64,
    /// Noise of each coordinate, metres.
    pub sigma_m: f64,
    /// Error of the registration, added to all points, metres.
    pub offset_m: [f64; 3],
    /// Standard deviation of an error along the surface's normal that is smooth over
    /// `surface_error_scale_m`, metres; zero for none.
    pub surface_error_m: f64,
    /// Wavelength of this error in plan view, metres.
    pub surface_error_scale_m: f64,
}

/// What the project files state about the drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProjectSettings {
    /// Voxel sizes of the calibration, metres; empty for those that the calibration chooses itself.
    pub voxel_sizes_m: Vec<f64>,
    /// Whether the time-correlated errors and the latencies of prism and heading are stated.
    pub states_errors: bool,
    /// Standard deviation of a shift of the reference, which then has no tilt, metres; not stated if zero.
    pub sigma_reference_m: f64,
}

/// Deformation of the mountings by gravity, by acceleration and with time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeformationSettings {
    /// Whether the mountings deform; they are rigid otherwise.
    pub enabled: bool,
    /// Rotation of a scanner per degree of roll or pitch, degrees.
    pub rotation_deg_per_deg: f64,
    /// Shift of a scanner per degree of roll or pitch, metres.
    pub shift_m_per_deg: f64,
    /// Shift of a scanner per 1 m/s² of acceleration, metres.
    pub shift_m_per_m_s2: f64,
    /// Rotation accumulated over a drive, degrees.
    pub drift_deg: f64,
    /// Shift accumulated over a drive, metres.
    pub drift_m: f64,
    /// Rotation as the frame warms up by 12 K, degrees.
    pub warming_deg: f64,
    /// Shift as the frame warms up by 12 K, metres.
    pub warming_m: f64,
    /// Half the width of the play with which roll and pitch act, as a share of their amplitude.
    pub hysteresis: f64,
    /// Standard deviation of a Gauss-Markov process of each rotation, degrees.
    pub walk_deg: f64,
    /// Standard deviation of the process of each coordinate, metres.
    pub walk_m: f64,
    /// Correlation time of these processes, seconds.
    pub walk_correlation_s: f64,
    /// Whether the same process moves all scanners.
    pub walk_together: bool,
    /// Length of a sudden shift of the first scanner in the middle of a drive, equally upwards and forwards,
    /// metres.
    pub jump_m: f64,
}

impl DeformationSettings {
    /// Whether the mountings depend on the temperature of the frame, which is then logged.
    pub fn warms(&self) -> bool {
        self.enabled && (self.warming_deg != 0.0 || self.warming_m != 0.0)
    }
}
