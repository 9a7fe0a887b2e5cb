//! The measurements of each sensor as plain records, and checks of their streams.

mod continued;
mod frame_log;
mod navigation;
mod order;
mod projected;
mod quality;
mod record;
mod total_station;

pub mod allan;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Problem, Result};
use crate::geometry::{Mat3, Vec3, WorldFromBody};
pub use continued::{Continued, on_both_sides, start_between_s};
pub use frame_log::{FrameLog, MAX_FRAME_COLUMNS};
pub use navigation::{GeographicPose, NavigationAngles, NavigationSigma};
pub use order::longest_increasing;
pub use projected::{project_fixes, project_poses};
pub use quality::FixQuality;
pub use record::Record;
pub use total_station::{Observations, PolarObservation, TotalStation, VerticalAngle};

/// Standard gravity, the g of datasheets, m/s².
pub const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;

/// One IMU sample: the mean over the interval from its time to the next sample's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Start of the interval, seconds.
    pub time_s: f64,
    /// Angular rate in body axes, rad/s.
    pub gyro_rad_s: Vec3,
    /// Specific force in body axes, m/s²; at rest it points upwards.
    pub accel_m_s2: Vec3,
}

/// One position of a prism tracked by a total station, or of a GNSS antenna.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionFix {
    /// Seconds.
    pub time_s: f64,
    /// East, north, up in the world frame, metres.
    pub position_m: Vec3,
    /// Covariance of east, north, up if the file gives one, m².
    pub covariance_m2: Option<Mat3>,
}

impl PositionFix {
    /// A fix whose coordinates each have this standard deviation, metres.
    pub fn with_sigma(time_s: f64, position_m: Vec3, sigma_m: Option<f64>) -> Self {
        Self {
            time_s,
            position_m,
            covariance_m2: sigma_m.map(|sigma| Mat3::identity() * (sigma * sigma)),
        }
    }
}

/// One position of a GNSS antenna on an ellipsoid, usually WGS 84.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeographicFix {
    /// Seconds.
    pub time_s: f64,
    /// Positive to the north, radians.
    pub latitude_rad: f64,
    /// Positive to the east, radians.
    pub longitude_rad: f64,
    /// Above the ellipsoid, metres.
    pub height_m: f64,
    /// Standard deviations to the east, to the north and upwards if the file gives them, metres.
    pub sigma_m: Option<Vec3>,
    /// How the receiver computed it, if the file says so.
    pub quality: Option<FixQuality>,
}

/// One heading of the antenna baseline, with its pitch if the receiver gives one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingFix {
    /// Seconds.
    pub time_s: f64,
    /// Clockwise from north, radians.
    pub heading_rad: f64,
    /// Standard deviation if the file gives one, radians.
    pub sigma_rad: Option<f64>,
    /// Elevation of the baseline above the horizon, radians.
    pub pitch_rad: Option<f64>,
    /// Standard deviation of the pitch if the file gives one, radians.
    pub pitch_sigma_rad: Option<f64>,
}

impl HeadingFix {
    /// A heading without pitch.
    pub fn new(time_s: f64, heading_rad: f64, sigma_rad: Option<f64>) -> Self {
        Self {
            time_s,
            heading_rad,
            sigma_rad,
            pitch_rad: None,
            pitch_sigma_rad: None,
        }
    }
}

/// A row of a log that holds no measurement, and the reason.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectedRow {
    /// The file.
    pub source: String,
    /// Its line, counted from 1.
    pub line: u64,
    /// The time in this row, seconds on the sensor's own clock.
    pub time_s: f64,
    /// The reason.
    pub reason: String,
}

impl std::fmt::Display for RejectedRow {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            source,
            line,
            time_s,
            reason,
        } = self;
        write!(f, "{source}, line {line}, {time_s} s: {reason}")
    }
}

/// The content of a position log.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Positions {
    /// In the order of the file.
    pub fixes: Vec<PositionFix>,
    /// Rows without a measurement: the instrument did not see the prism.
    pub rejected: Vec<RejectedRow>,
    /// How a GNSS receiver computed each fix; empty if the log does not say so.
    pub qualities: Vec<FixQuality>,
}

/// One laser point in the frame of its scanner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanPoint {
    /// Seconds.
    pub time_s: f64,
    /// Scanner frame, metres; a profile scanner has y = 0.
    pub position_m: Vec3,
    /// As recorded, 0 if absent.
    pub intensity: f32,
}

/// One pose of a trajectory, measured elsewhere or estimated here.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseRecord {
    /// Seconds.
    pub time_s: f64,
    /// The pose of the body.
    pub world_from_body: WorldFromBody,
    /// Velocity in the world frame, m/s.
    pub velocity_m_s: Option<Vec3>,
    /// Biases of the IMU.
    pub bias: Option<ImuBias>,
    /// Standard deviations.
    pub sigma: Option<PoseSigma>,
}

impl PoseRecord {
    /// A pose without velocity, biases and standard deviations.
    pub fn new(time_s: f64, world_from_body: WorldFromBody) -> Self {
        Self {
            time_s,
            world_from_body,
            velocity_m_s: None,
            bias: None,
            sigma: None,
        }
    }
}

/// Biases of the IMU in body axes: measured = true + bias.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ImuBias {
    /// rad/s.
    pub gyro_rad_s: Vec3,
    /// m/s².
    pub accel_m_s2: Vec3,
}

/// Standard deviations of a pose, along and about the world axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseSigma {
    /// Position: east, north, up, metres.
    pub position_m: Vec3,
    /// Rotation about east, north, up, radians: the last is the heading's.
    pub rotation_rad: Vec3,
}

/// A record with a time stamp.
pub trait Timed {
    /// Seconds.
    fn time_s(&self) -> f64;

    /// Seconds, to be changed.
    fn time_s_mut(&mut self) -> &mut f64;
}

macro_rules! timed {
    ($($record:ty),*) => {$(
        impl Timed for $record {
            fn time_s(&self) -> f64 {
                self.time_s
            }

            fn time_s_mut(&mut self) -> &mut f64 {
                &mut self.time_s
            }
        }
    )*};
}
timed!(
    ImuSample,
    PositionFix,
    GeographicFix,
    HeadingFix,
    ScanPoint,
    PoseRecord
);

/// First and last time of a stream in time order, seconds; `None` if it is empty.
pub fn span_s<T: Timed>(stream: &[T]) -> Option<(f64, f64)> {
    Some((stream.first()?.time_s(), stream.last()?.time_s()))
}

/// An IMU with a longer interval between samples, seconds, does not resolve the motion of a body.
pub const MAX_IMU_INTERVAL_S: f64 = 0.2;

/// The likely time unit of an IMU log whose samples are `interval_s` apart if its times are seconds.
pub fn imu_time_unit(interval_s: f64) -> Option<&'static str> {
    const COMMON_S: f64 = 5e-3;
    time_unit(interval_s / COMMON_S)
}

/// The unit of times that are `factor` times what they would be in seconds; `None` if no unit comes
/// close.
fn time_unit(factor: f64) -> Option<&'static str> {
    match (factor.log10() / 3.0).round() {
        1.0 => Some("milliseconds"),
        2.0 => Some("microseconds"),
        3.0 => Some("nanoseconds"),
        _ => None,
    }
}

/// As `time_unit`, but `None` if `factor` differs from a power of 1000 by a ratio of more than `up_to`.
pub fn time_unit_within(factor: f64, up_to: f64) -> Option<&'static str> {
    let off = (factor.log10() / 3.0).fract();
    let off_decades = 3.0 * off.min(1.0 - off);
    time_unit(factor).filter(|_| off_decades <= up_to.log10())
}

/// Checks that the streams `a` and `b` overlap in time.
///
/// # Errors
/// Names both spans and the gap between them.
pub fn check_overlap(a: (&str, (f64, f64)), b: (&str, (f64, f64))) -> Result<()> {
    let ((name_a, (a0, a1)), (name_b, (b0, b1))) = (a, b);
    let gap = (b0 - a1).max(a0 - b1);
    if gap < 0.0 {
        return Ok(());
    }
    Err(Error::of(
        Problem::NoOverlap,
        format!(
            "{name_a} ({a0:.3} s to {a1:.3} s) and {name_b} ({b0:.3} s to {b1:.3} s) do not \
             overlap: the gap is {gap:.3} s{}",
            unit_hint(a, b).unwrap_or_else(|| clock_hint(gap).to_owned())
        ),
        "check that both logs come from the same drive and use the same clock; `time_offset_s` shifts a \
         stream (common time = sensor time + offset)",
    ))
}

/// Asks for the unit of one stream if its times are a power of 1000 times the other's.
fn unit_hint(a: (&str, (f64, f64)), b: (&str, (f64, f64))) -> Option<String> {
    const ALIKE: f64 = 1.25;
    let middle = |(_, (first, last)): (&str, (f64, f64))| 0.5 * (first + last);
    let unit = |large, small| time_unit_within(middle(large) / middle(small), ALIKE);
    let (name, unit) = match unit(a, b) {
        Some(unit) => (a.0, unit),
        None => (b.0, unit(b, a)?),
    };
    Some(format!(
        " (are the times of {name} {unit}? they must be seconds)"
    ))
}

/// Names the mix of clocks that a gap of this size suggests.
fn clock_hint(gap_s: f64) -> &'static str {
    const GPS_EPOCH_UNIX_S: f64 = 315_964_800.0;
    /// Adjusted GPS time, of LAS files, counts seconds since 1980 less this.
    const ADJUSTED_S: f64 = 1e9;
    let is_about = |clocks_s: f64| (gap_s - clocks_s).abs() < 86_400.0;
    if is_about(GPS_EPOCH_UNIX_S) {
        " (close to the 315964800 s between the Unix and the GPS epoch: are the clocks mixed?)"
    } else if is_about(GPS_EPOCH_UNIX_S + ADJUSTED_S) {
        " (close to the 1315964782 s between Unix time and adjusted GPS time: are the clocks mixed?)"
    } else if is_about(ADJUSTED_S) {
        " (close to the 1000000000 s between GPS time and adjusted GPS time: are the clocks mixed?)"
    } else if gap_s > 1e8 {
        " (is one clock absolute and the other relative?)"
    } else {
        ""
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_named_with_its_size() {
        let error = check_overlap(("imu", (0.0, 10.0)), ("prism", (12.5, 20.0))).unwrap_err();
        assert!(error.to_string().contains("the gap is 2.500 s"), "{error}");
        assert!(check_overlap(("imu", (0.0, 10.0)), ("prism", (9.0, 20.0))).is_ok());
    }

    #[test]
    fn gaps_between_epochs_are_named() {
        for (other_s, expected) in [
            (
                1.7e9 - 315_964_782.0,
                "315964800 s between the Unix and the GPS epoch",
            ),
            (
                1.7e9 - 1_315_964_782.0,
                "1315964782 s between Unix time and adjusted GPS time",
            ),
            (
                1.7e9 - 1e9,
                "1000000000 s between GPS time and adjusted GPS time",
            ),
            (5.0, "is one clock absolute and the other relative?"),
        ] {
            let unix_s = (1.7e9, 1.7e9 + 300.0);
            let error = check_overlap(("imu", unix_s), ("prism", (other_s, other_s + 300.0)));
            let error = error.unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn units_follow_from_the_size_of_times() {
        let near = |factor| time_unit_within(factor, 3.0);
        assert_eq!([near(700.0), near(2000.0)], [Some("milliseconds"); 2]);
        assert_eq!([near(4e5), near(2e6)], [Some("microseconds"); 2]);
        assert_eq!(near(1e9), Some("nanoseconds"));
        for none in [0.0, -1e3, 1.0, 100.0, 1e4, 1e5, 1e12, f64::NAN] {
            assert_eq!(near(none), None, "{none}");
        }
        let day = (36_000.0, 36_600.0);
        let in_ms = (36_000_500.0, 36_599_000.0);
        for (a, b) in [
            (("imu", day), ("prism", in_ms)),
            (("prism", in_ms), ("imu", day)),
        ] {
            let error = check_overlap(a, b).unwrap_err().to_string();
            assert!(
                error.contains("are the times of prism milliseconds?"),
                "{error}"
            );
        }
    }
}
