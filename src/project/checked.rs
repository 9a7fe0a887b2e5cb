//! The project with every value checked: SI units, radians, absolute paths.

use std::path::PathBuf;

use crate::calibration::CalibrationSettings;
use crate::comparison::ComparisonSettings;
use crate::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Vec3};
use crate::sensor::Observations;
use crate::trajectory::{PoseLimits, TrajectorySettings};

/// One drive, its sensors and what is to be done with them.
#[derive(Debug, Clone, PartialEq)]
pub struct Project {
    /// The project file, absolute.
    pub path: PathBuf,
    /// Axes of the body frame.
    pub axes: BodyAxes,
    /// Subtracted from world coordinates on reading and added on writing, metres.
    pub origin_m: Vec3,
    /// Where the poses come from.
    pub motion: Motion,
    /// How well a pose must be known for points to be placed with it.
    pub limits: PoseLimits,
    /// The scanners in the order of the file; names are unique.
    pub scanners: Vec<Scanner>,
    /// The reference cloud.
    pub reference: Option<Reference>,
    /// How the mountings are found.
    pub calibration: CalibrationSettings,
    /// How clouds are compared.
    pub comparison: ComparisonSettings,
    /// Other drives, judged with the mountings found here.
    pub evaluations: Vec<Evaluation>,
}

/// Where the poses come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Logs of IMU, prism or GNSS, and heading, from which the trajectory is estimated.
    Logs(Box<Logs>),
    /// A trajectory estimated elsewhere.
    Poses(PosesFile),
}

/// The logs behind a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Logs {
    /// Rates and specific forces.
    pub imu: LogFile,
    /// Positions of prisms and GNSS antennas, in the order of
    /// [`TrajectorySettings::positions`].
    pub positions: Vec<PositionLog>,
    /// Headings of the antenna baseline.
    pub heading: Option<LogFile>,
    /// Noise, lever arms, offsets; those of the heading are defaults where there is no log of it.
    pub settings: TrajectorySettings,
}

/// A file of time-stamped records.
#[derive(Debug, Clone, PartialEq)]
pub struct LogFile {
    /// Absolute.
    pub path: PathBuf,
    /// Common time = sensor time + this, seconds.
    pub time_offset_s: f64,
}

/// A file of positions.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionLog {
    /// Absolute.
    pub path: PathBuf,
    /// Common time = sensor time + this, seconds.
    pub time_offset_s: f64,
    /// What its numbers are; the station of polar ones in world coordinates, the project's origin
    /// not subtracted.
    pub observations: Observations,
}

/// A file of poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PosesFile {
    /// Absolute.
    pub path: PathBuf,
    /// Common time = time in the file + this, seconds.
    pub time_offset_s: f64,
    /// Standard deviation of each coordinate where the file gives none, metres.
    pub sigma_position_m: Option<f64>,
    /// Standard deviation about each axis where the file gives none, radians.
    pub sigma_rotation_rad: Option<f64>,
}

/// One scanner and its mounting.
#[derive(Debug, Clone, PartialEq)]
pub struct Scanner {
    /// Letters, digits, `-` and `_`: fit for a file name.
    pub name: String,
    /// Files of profiles in time order, absolute.
    pub profiles: Vec<PathBuf>,
    /// Common time = scanner time + this, seconds.
    pub time_offset_s: f64,
    /// The mounting to start from.
    pub body_from_scanner: BodyFromScanner,
    /// How the user writes the angles of this mounting.
    pub convention: EulerConvention,
    /// Which of tx ty tz rx ry rz stay at their values.
    pub fixed: [bool; 6],
}

/// The reference cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Absolute.
    pub path: PathBuf,
}

/// Another drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Letters, digits, `-` and `_`: fit for a file name.
    pub name: String,
    /// Its project file, absolute.
    pub project: PathBuf,
}
