//! The checked project: SI units, radians, absolute paths.

use std::path::PathBuf;

use super::quality::QualityNoise;
use super::units::ImuUnits;
use crate::calibration::CalibrationSettings;
use crate::comparison::ComparisonSettings;
use crate::format::PointTimes;
use crate::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Projection, Vec3};
use crate::joint::{Compliance, JointSettings};
use crate::report::Imprint;
use crate::sensor::Observations;
use crate::trajectory::{PoseLimits, TrajectorySettings};
use crate::verdict::Acceptance;

/// One drive, its sensors and the settings for processing it.
#[derive(Debug, Clone, PartialEq)]
pub struct Project {
    /// The project file, absolute.
    pub path: PathBuf,
    /// Axes of the body frame.
    pub axes: BodyAxes,
    /// What is subtracted from world coordinates on reading and added on writing, metres; `None` if the project states
    /// none, and a run may choose one.
    pub origin_m: Option<Vec3>,
    /// The projected coordinate reference system of the world, if files have latitudes and longitudes.
    pub crs: Option<Projection>,
    /// The source of the poses.
    pub motion: Motion,
    /// Limits on the uncertainty of poses with which points are georeferenced.
    pub limits: PoseLimits,
    /// The scanners in the order of the file; names are unique.
    pub scanners: Vec<Scanner>,
    /// The reference cloud.
    pub reference: Option<Reference>,
    /// Settings of the calibration in two steps, from which the joint adjustment starts.
    pub calibration: CalibrationSettings,
    /// Whether the scales of the calibration follow from the points (`calibration.voxel_sizes_m = "auto"`). Until
    /// points are read, the scales are those of a close-range scanner.
    pub has_auto_scales: bool,
    /// Whether trajectory and mountings are adjusted jointly (`calibration.method = "joint"`);
    /// [`CalibrationSettings::method`] is then the method of the start and of the fallback.
    pub is_joint: bool,
    /// Settings of the joint adjustment, and uncertainties of the inputs that only it uses.
    pub joint: JointSettings,
    /// The log of further quantities that may bend the frame, besides tilt, acceleration and time.
    pub bending: Option<FrameLogFile>,
    /// Settings of the comparisons.
    pub comparison: ComparisonSettings,
    /// Limits that the results must meet.
    pub acceptance: Acceptance,
    /// Title, author and organisation of the report.
    pub imprint: Imprint,
    /// Other drives, adjusted together with this one.
    pub drives: Vec<OtherDrive>,
    /// Other drives, evaluated with the mountings calibrated here; their names differ from those of
    /// [`Self::drives`].
    pub evaluations: Vec<OtherDrive>,
}

/// The source of the poses.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Logs of IMU, prism or GNSS, and heading, from which the trajectory is estimated.
    Logs(Box<Logs>),
    /// A trajectory estimated elsewhere.
    Poses(PosesFile),
}

/// The logs from which a trajectory is estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Logs {
    /// Rates and specific forces.
    pub imu: LogFile,
    /// Their units.
    pub imu_units: ImuUnits,
    /// Positions of prisms and GNSS antennas, in the order of
    /// [`TrajectorySettings::positions`].
    pub positions: Vec<PositionLog>,
    /// Headings of the antenna baseline.
    pub heading: Option<LogFile>,
    /// Noise, lever arms, offsets; defaults for the heading if there is no heading log.
    pub settings: TrajectorySettings,
    /// Whether constants that the drive contradicts are estimated with the trajectory.
    pub estimates_doubted: bool,
}

/// A file of time-stamped records.
#[derive(Debug, Clone, PartialEq)]
pub struct LogFile {
    /// Absolute.
    pub path: PathBuf,
    /// Common time = sensor time + this, seconds.
    pub time_offset_s: f64,
}

/// A log of quantities that may bend the frame, such as temperatures and loads.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameLogFile {
    /// The file.
    pub log: LogFile,
    /// Names of the columns that are used, 1 to [`MAX_FRAME_COLUMNS`](crate::sensor::MAX_FRAME_COLUMNS).
    pub columns: Vec<String>,
}

/// A file of positions.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionLog {
    /// Absolute.
    pub path: PathBuf,
    /// Common time = sensor time + this, seconds.
    pub time_offset_s: f64,
    /// The kind of its observations. The station of polar observations is in world coordinates, before
    /// the project's origin is subtracted.
    pub observations: Observations,
    /// Standard deviations of GNSS positions whose ambiguities are not fixed.
    pub by_quality: QualityNoise,
}

/// A file of poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PosesFile {
    /// Absolute.
    pub path: PathBuf,
    /// Further files of the same trajectory at other times, such as the times of each scanner's profiles.
    pub others: Vec<PathBuf>,
    /// Common time = time in the file + this, seconds.
    pub time_offset_s: f64,
    /// Standard deviation of each coordinate if the file gives none, metres.
    pub sigma_position_m: Option<f64>,
    /// Standard deviation about each axis if the file gives none, radians.
    pub sigma_rotation_rad: Option<f64>,
}

impl PosesFile {
    /// All files of poses.
    pub fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        std::iter::once(&self.path).chain(&self.others)
    }
}

/// One scanner and its mounting.
#[derive(Debug, Clone, PartialEq)]
pub struct Scanner {
    /// Letters, digits, `-` and `_`, as it becomes part of file names.
    pub name: String,
    /// Files of profiles in time order, absolute.
    pub profiles: Vec<PathBuf>,
    /// Common time = scanner time + this, seconds.
    pub time_offset_s: f64,
    /// What a recording of ROS does not say about the times of points.
    pub point_times: PointTimes,
    /// Whether the joint adjustment estimates a correction of the time offset.
    pub estimate_time_offset: bool,
    /// The initial mounting.
    pub body_from_scanner: BodyFromScanner,
    /// The convention of the angles in the project file.
    pub convention: EulerConvention,
    /// Whether tx, ty, tz, rx, ry, rz are held fixed.
    pub fixed: [bool; 6],
    /// The change of the mounting with the load on the frame, if there is one.
    pub compliance: Option<Compliance>,
}

/// The reference cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Absolute.
    pub path: PathBuf,
}

/// Another drive of the same platform.
#[derive(Debug, Clone, PartialEq)]
pub struct OtherDrive {
    /// Letters, digits, `-` and `_`, as it becomes part of file names.
    pub name: String,
    /// Its project file, absolute.
    pub project: PathBuf,
}
