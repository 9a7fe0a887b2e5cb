//! Records as they arrive.

use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use crate::trajectory::logs::{MotionLogs, Stream};
use crate::trajectory::streams::Numbered;

/// A record that waits for the IMU.
#[derive(Debug, Clone, Copy)]
pub enum Record {
    Position(usize, Numbered<PositionFix>),
    Heading(Numbered<HeadingFix>),
}

impl Record {
    pub fn stream(&self) -> Stream {
        match self {
            Self::Position(sensor, _) => Stream::Position(*sensor),
            Self::Heading(_) => Stream::Heading,
        }
    }

    /// Its number in the log, from 0.
    pub fn number(&self) -> usize {
        match self {
            Self::Position(_, fix) => fix.record,
            Self::Heading(fix) => fix.record,
        }
    }

    pub fn time_s(&self) -> f64 {
        match self {
            Self::Position(_, fix) => fix.value.time_s,
            Self::Heading(fix) => fix.value.time_s,
        }
    }
}

/// The place of a record in the logs.
#[derive(Debug, Clone, Copy)]
pub struct RecordId {
    pub stream: Stream,
    /// Its number in the log, from 0.
    pub record: usize,
    pub time_s: f64,
}

/// All records in the order in which they arrived.
#[derive(Debug, Clone, Default)]
pub struct ReceivedLogs {
    pub imu: Vec<ImuSample>,
    pub positions: Vec<Vec<PositionFix>>,
    pub heading: Vec<HeadingFix>,
}

impl ReceivedLogs {
    /// The logs as the adjustment of a whole drive takes them.
    pub fn logs(&self) -> MotionLogs<'_> {
        MotionLogs {
            imu: &self.imu,
            positions: &self.positions,
            heading: &self.heading,
        }
    }
}
