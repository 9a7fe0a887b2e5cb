//! What the sensors recorded, corrections of its times, and the constants that are such corrections.

use super::settings::Constant;
use crate::sensor::{HeadingFix, ImuSample, PositionFix};

/// What the sensors of one drive recorded.
#[derive(Debug, Clone, Copy)]
pub struct MotionLogs<'a> {
    /// Rates and specific forces.
    pub imu: &'a [ImuSample],
    /// Positions, one stream for each of [`TrajectorySettings::positions`](super::TrajectorySettings::positions).
    pub positions: &'a [Vec<PositionFix>],
    /// Headings; may be empty.
    pub heading: &'a [HeadingFix],
}

/// One of the streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stream {
    Imu,
    Position(usize),
    Heading,
}

/// From `record` (from 0) on, the times of a stream are corrected by `shift_s`: for its latency or the rate of its clock
/// where the record is the first, else for a clock that was set while the log ran.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockCorrection {
    pub stream: Stream,
    pub record: usize,
    /// The record's time as logged.
    pub time_s: f64,
    pub shift_s: f64,
    pub course: Course,
    /// Whether the correction is taken as it is, not estimated further.
    pub held: bool,
}

/// How a correction depends on the time of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Course {
    /// Not at all.
    Constant,
    /// From minus one half of it to one half of it between these times, in proportion.
    Linear { from_s: f64, to_s: f64 },
}

impl Course {
    /// In proportion to time over a log. The times are those that the middle half of its records spans, extended: wild
    /// stamps do not count. `None` if they have one time.
    fn over(records: &[PositionFix]) -> Option<Self> {
        let mut times: Vec<f64> = records.iter().map(|fix| fix.time_s).collect();
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times.get((share * times.len() as f64) as usize);
        let (low_s, high_s) = (at(0.25)?, at(0.75)?);
        let quarter_s = 0.5 * (high_s - low_s);
        (quarter_s > 0.0).then_some(Self::Linear {
            from_s: low_s - quarter_s,
            to_s: high_s + quarter_s,
        })
    }

    /// The share of a correction that a record at this time has.
    pub fn share(self, time_s: f64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Linear { from_s, to_s } => (time_s - from_s) / (to_s - from_s) - 0.5,
        }
    }
}

impl ClockCorrection {
    /// The correction that a constant is, none yet; `None` for constants that are none, and for the rate of a clock over a
    /// log at one time.
    pub fn of(constant: Constant, logs: &MotionLogs<'_>) -> Option<Self> {
        let stream = latency_of(constant)?;
        let course = match constant {
            Constant::TimeDrift(sensor) => Course::over(&logs.positions[sensor])?,
            _ => Course::Constant,
        };
        Some(Self::none(stream, course))
    }

    /// A correction from the first record on, none yet.
    pub fn none(stream: Stream, course: Course) -> Self {
        Self {
            stream,
            record: 0,
            time_s: 0.0,
            shift_s: 0.0,
            course,
            held: false,
        }
    }
}

/// The stream whose times a constant corrects; `None` for other constants.
pub fn latency_of(constant: Constant) -> Option<Stream> {
    match constant {
        Constant::TimeOffset(sensor) | Constant::TimeDrift(sensor) => {
            Some(Stream::Position(sensor))
        }
        Constant::HeadingTimeOffset => Some(Stream::Heading),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;

    fn rate_over(times_s: &[f64]) -> Option<Course> {
        let fix = |time_s: &f64| PositionFix::with_sigma(*time_s, Vec3::zeros(), None);
        let logs = MotionLogs {
            imu: &[],
            positions: &[times_s.iter().map(fix).collect()],
            heading: &[],
        };
        ClockCorrection::of(Constant::TimeDrift(0), &logs).map(|correction| correction.course)
    }

    #[test]
    fn the_rate_of_a_clock_grows_over_its_log_and_ignores_wild_stamps() {
        let mut times_s: Vec<f64> = (0..101).map(f64::from).collect();
        times_s[7] = 1e9;
        let course = rate_over(&times_s).unwrap();
        let shares = [0.0, 50.0, 100.0].map(|time_s| course.share(time_s));
        // A wild stamp moves the quartiles by one record of a hundred.
        for (share, expected) in shares.iter().zip([-0.5, 0.0, 0.5]) {
            assert!((share - expected).abs() < 0.03, "{shares:?}");
        }
    }

    #[test]
    fn a_log_at_one_time_has_no_rate() {
        assert_eq!(rate_over(&[5.0; 9]), None);
        assert_eq!(rate_over(&[]), None);
    }
}
