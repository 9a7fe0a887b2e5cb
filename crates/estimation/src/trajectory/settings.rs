//! What the estimation needs besides the logs, in SI units.

pub use super::imu_noise::ImuNoise;
pub use crate::adjustment::Loss;
use serde::{Deserialize, Serialize};

use crate::geometry::{BodyAxes, Vec3};

/// Correlation time of the lasting part of the errors of positions and headings where none is
/// given, seconds.
pub const SENSOR_CORRELATION_S: f64 = 30.0;

/// What measures positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PositionKind {
    /// A prism tracked by a total station.
    Prism,
    /// A GNSS antenna.
    Gnss,
}

/// A prism or a GNSS antenna on the body.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionSettings {
    /// Its name in the project and the log: `prism`, `gnss`, or any other; unique.
    pub name: String,
    /// Prism or GNSS antenna.
    pub kind: PositionKind,
    /// Standard deviations of east, north, up where the log gives none, metres.
    pub sigma_m: Vec3,
    /// Standard deviations of the part of its errors that lasts, east, north, up, metres; 0 without
    /// one. No mean over a pass removes it. Estimated with the trajectory of a whole drive, by its
    /// largest modes; the estimate while driving leaves it out.
    pub sigma_correlated_m: Vec3,
    /// Correlation time of that part, seconds.
    pub correlation_s: f64,
    /// The prism or antenna in the body frame, metres.
    pub lever_arm_m: Vec3,
    /// Standard deviation of each coordinate of the lever arm, metres. The estimate holds the lever arm, and
    /// positions on the body are known no better than this.
    pub sigma_lever_arm_m: f64,
    /// The total station in the world frame where it is known, metres: the incidence-dependent
    /// bias of a 360° prism needs the line of sight.
    pub station_m: Option<Vec3>,
    /// How the cost grows with its residuals.
    pub loss: Loss,
}

impl PositionSettings {
    /// A prism with the same standard deviation for each coordinate, metres, tracked from an
    /// unknown place.
    pub fn prism(sigma_m: f64, lever_arm_m: Vec3) -> Self {
        Self {
            name: "prism".into(),
            kind: PositionKind::Prism,
            sigma_m: Vec3::repeat(sigma_m),
            sigma_correlated_m: Vec3::zeros(),
            correlation_s: SENSOR_CORRELATION_S,
            lever_arm_m,
            sigma_lever_arm_m: 0.0,
            station_m: None,
            loss: Loss::default(),
        }
    }
}

/// The heading antennas on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingSettings {
    /// Standard deviation where the log gives none, radians.
    pub sigma_rad: f64,
    /// Standard deviation of the pitch where the log gives none, radians.
    pub pitch_sigma_rad: f64,
    /// Standard deviation of the part of the heading's errors that lasts, radians; 0 without one.
    /// Estimated as that of positions.
    pub sigma_correlated_rad: f64,
    /// Correlation time of that part, seconds.
    pub correlation_s: f64,
    /// Heading of the body's x axis = heading of the antenna baseline + this, radians, clockwise.
    pub mounting_offset_rad: f64,
    /// Grid convergence: grid heading = true heading − this, radians.
    pub grid_convergence_rad: f64,
    /// How the cost grows with its residuals.
    pub loss: Loss,
}

impl HeadingSettings {
    /// Antennas along the body's x axis with this standard deviation of heading and pitch, radians.
    pub fn aligned(sigma_rad: f64) -> Self {
        Self {
            sigma_rad,
            pitch_sigma_rad: sigma_rad,
            sigma_correlated_rad: 0.0,
            correlation_s: SENSOR_CORRELATION_S,
            mounting_offset_rad: 0.0,
            grid_convergence_rad: 0.0,
            loss: Loss::default(),
        }
    }
}

/// Where the adjustment has its nodes. Poses come out at the IMU's rate in either case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Nodes {
    /// At position fixes, and at least one a second; poses in between follow from the IMU.
    #[default]
    Prism,
    /// At every IMU sample, as in the paper.
    Imu,
}

/// A constant that the adjustment may estimate along with the trajectory. Position sensors count in
/// the order of [`TrajectorySettings::positions`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Constant {
    /// `prism.time_offset`: common time = sensor time + this, on top of the project's, seconds.
    TimeOffset(usize),
    /// `prism.time_drift`: by how much more the last record is corrected than the first, in proportion to time, none in
    /// the middle of the log, seconds.
    TimeDrift(usize),
    /// `prism.lever_arm`, three values, metres in the body frame.
    LeverArm(usize),
    /// `prism.incidence_bias`, two amplitudes of the error of a 360° prism that turns with the
    /// angle of incidence, six periods a turn: along and across the line of sight, metres.
    IncidenceBias(usize),
    /// From this record (from 0) on, the positions of the sensor are off, three values, metres in the world. Found in the
    /// log, not named in a project.
    PositionStep {
        /// The sensor.
        sensor: usize,
        /// The first record that is off.
        record: usize,
    },
    /// `heading.mounting_offset`, radians.
    HeadingOffset,
    /// `heading.time_offset`, seconds.
    HeadingTimeOffset,
    /// `frame.gravity`, m/s².
    Gravity,
    /// `imu.gyro_scale_factor`, three values: by how many times the true rates about the body's axes the gyroscope reads.
    GyroScale,
    /// `imu.noise_scale`, the factor of the datasheet's white noise, one for gyro and
    /// accelerometer together.
    ImuNoiseScale,
}

impl Constant {
    /// Its name in the project; `positions` are the settings of the position sensors.
    pub fn name(self, positions: &[PositionSettings]) -> String {
        let name_of = |index: usize, key: &str| {
            let name = positions.get(index).map_or("?", |p| p.name.as_str());
            format!("{name}.{key}")
        };
        match self {
            Self::TimeOffset(index) => name_of(index, "time_offset"),
            Self::TimeDrift(index) => name_of(index, "time_drift"),
            Self::LeverArm(index) => name_of(index, "lever_arm"),
            Self::IncidenceBias(index) => name_of(index, "incidence_bias"),
            Self::PositionStep { sensor, record } => {
                name_of(sensor, &format!("step at record {}", record + 1))
            }
            Self::HeadingOffset => "heading.mounting_offset".into(),
            Self::HeadingTimeOffset => "heading.time_offset".into(),
            Self::Gravity => "frame.gravity".into(),
            Self::GyroScale => "imu.gyro_scale_factor".into(),
            Self::ImuNoiseScale => "imu.noise_scale".into(),
        }
    }
}

/// All that the trajectory stage needs besides the logs.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectorySettings {
    /// Axes of the body frame.
    pub axes: BodyAxes,
    /// Magnitude of gravity, m/s²; it points along −z of the world.
    pub gravity_m_s2: f64,
    /// IMU noise.
    pub imu: ImuNoise,
    /// Prisms and GNSS antennas, one or more.
    pub positions: Vec<PositionSettings>,
    /// Heading.
    pub heading: HeadingSettings,
    /// Where the nodes are.
    pub nodes: Nodes,
    /// Longest step between nodes where they are at position fixes, seconds. Poses do not depend on
    /// it, but what corrects them between nodes does.
    pub max_step_s: f64,
    /// What is estimated along with the trajectory.
    pub estimate: Vec<Constant>,
    /// Whether velocity is held at zero where the logs show that the body rests.
    pub zero_velocity: bool,
}

impl TrajectorySettings {
    /// Default of [`TrajectorySettings::max_step_s`].
    pub const MAX_STEP_S: f64 = 1.0;

    /// An IMU, one prism and headings, with nothing but the trajectory estimated.
    pub fn new(
        axes: BodyAxes,
        imu: ImuNoise,
        position: PositionSettings,
        heading: HeadingSettings,
    ) -> Self {
        Self {
            axes,
            gravity_m_s2: 9.81,
            imu,
            positions: vec![position],
            heading,
            nodes: Nodes::default(),
            max_step_s: Self::MAX_STEP_S,
            estimate: Vec::new(),
            zero_velocity: true,
        }
    }
}

/// How well a pose must be known for points to be placed with it. The standard deviation of a pose
/// is that of its worst axis; each bound is above 0.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseLimits {
    /// Largest standard deviation of a coordinate, metres.
    pub position_m: Option<f64>,
    /// Largest standard deviation about an axis, radians.
    pub rotation_rad: Option<f64>,
}

impl PoseLimits {
    /// Whether there is no bound at all.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// These bounds, and those of `other` where there are none.
    pub fn or(self, other: Self) -> Self {
        Self {
            position_m: self.position_m.or(other.position_m),
            rotation_rad: self.rotation_rad.or(other.rotation_rad),
        }
    }
}
