//! What the logs of a drive contradict, with the numbers that show it.

use serde::{Deserialize, Serialize};

use super::time_scales::TimeScales;
use crate::format::RecordingClocks;
use crate::geometry::{BodyAxes, Vec3};
use crate::trajectory::{Doubt, PositionStep};

/// The cosine between the mean specific force and the body's upward axis is at least this, or the axes are
/// not those of the project.
pub(super) const LEAST_COSINE: f64 = 0.7;

/// What the logs of a drive contradict, before and in the adjustment of its trajectory.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LogFindings {
    /// Contradictions in the raw logs.
    pub contradictions: Vec<Contradiction>,
    /// Steps of positions, which were estimated.
    pub steps: Vec<PositionStep>,
    /// The clocks of the recording; `None` if the logs were not recorded with the times of their arrival.
    pub clocks: Option<RecordingClocks>,
    /// Constants of the project that the drive contradicts, the gravest first.
    pub doubts: Vec<Doubt>,
}

impl LogFindings {
    /// Whether poses from the raw logs mean nothing, see [`Contradiction::spoils_poses`].
    pub fn spoil_poses(&self) -> bool {
        self.contradictions.iter().any(Contradiction::spoils_poses)
    }
}

/// A contradiction between raw logs, or between them and the project.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Contradiction {
    /// An axis of the IMU was not measured.
    Held(HeldAxis),
    /// Positions lost digits.
    Rounded(RoundedPositions),
    /// The clock of a log is seconds off, which a run corrects.
    Late(LateLog),
    /// Gravity is not where the axes of the body put it.
    Axes(VerticalAxis),
    /// Headings turn against the gyro; a run leaves them out.
    OppositeHeadings {
        /// Whether they count counter-clockwise from east; otherwise from north.
        are_from_east: bool,
    },
    /// The course of these positions turns against the gyro.
    LeftHanded {
        /// Name of the position log.
        position: String,
    },
    /// The body does not drive where its headings point.
    DrivenDirection {
        /// Name of the position log whose course is compared.
        position: String,
        /// Headings less courses, radians.
        off_rad: f64,
    },
    /// Neighbouring fixes scatter far more than stated; a run raises their standard deviations.
    Noise(PositionNoise),
}

impl Contradiction {
    /// Whether poses from these logs mean nothing, and neither do constants and noise that are estimated with them.
    pub fn spoils_poses(&self) -> bool {
        match self {
            Self::Held(_) | Self::Rounded(_) | Self::LeftHanded { .. } => true,
            Self::Axes(axis) => !axis.is_opposite(),
            Self::Late(_)
            | Self::OppositeHeadings { .. }
            | Self::DrivenDirection { .. }
            | Self::Noise(_) => false,
        }
    }
}

/// A sensor of the IMU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ImuSensor {
    /// Angular rates, rad/s.
    Gyro,
    /// Specific forces, m/s².
    Accel,
}

/// An axis of the IMU that stays at one value while the body moves and another axis of its sensor shows noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldAxis {
    /// Name of the log's file.
    pub file: String,
    /// The sensor.
    pub sensor: ImuSensor,
    /// The axis.
    pub axis: usize,
    /// The value at which it stays, in the sensor's unit.
    pub value: f64,
    /// For how many samples in a row it stays there.
    pub held: usize,
    /// Number of samples of the moving body.
    pub samples: usize,
    /// The axis that shows noise.
    pub noisy_axis: usize,
    /// Standard deviation of that noise, in the sensor's unit.
    pub noise: f64,
}

/// Coordinates written in steps that are long compared with their standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoundedPositions {
    /// Name of the log's file.
    pub file: String,
    /// Name of the position log.
    pub position: String,
    /// The coordinate: east, north, up.
    pub axis: usize,
    /// The step, metres.
    pub step_m: f64,
    /// The stated standard deviation, metres.
    pub sigma_m: f64,
    /// From which coordinate on single precision has this step, metres; `None` if it has no such step.
    pub single_from_m: Option<f64>,
}

/// A log of the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Log {
    /// Rates and specific forces.
    Imu,
    /// One of the position logs.
    Position(usize),
    /// Headings.
    Heading,
}

/// A log whose clock is seconds off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LateLog {
    /// The log.
    pub log: Log,
    /// Its name in the project.
    pub name: String,
    /// By how much its stamps are late, seconds.
    pub late_s: f64,
    /// The time scales that differ by that.
    pub scales: Option<TimeScales>,
}

/// The axis that gravity shows to be vertical, where it is not the z axis of the project's body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VerticalAxis {
    /// The axes of the body in the project.
    pub given: BodyAxes,
    /// The axis of the IMU along which the mean specific force mostly points.
    pub axis: usize,
    /// The cosine between the mean specific force and the upward axis of the project's body.
    pub cosine: f64,
}

impl VerticalAxis {
    /// Whether z points the other way, with which only the start values of the trajectory go wrong.
    pub fn is_opposite(&self) -> bool {
        self.cosine < -LEAST_COSINE
    }
}

/// The noise of a position log that states too little.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PositionNoise {
    /// Name of the position log.
    pub position: String,
    /// Factors on its standard deviations, east, north, up.
    pub factors: Vec3,
    /// The standard deviations that it has, metres.
    pub sigma_m: Vec3,
}
