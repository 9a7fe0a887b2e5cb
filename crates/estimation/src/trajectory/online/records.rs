//! Records as they come.

use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use crate::trajectory::streams::{MotionLogs, Numbered, Stream};

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

/// All records as they came.
#[derive(Debug, Clone, Default)]
pub struct Given {
    pub imu: Vec<ImuSample>,
    pub positions: Vec<Vec<PositionFix>>,
    pub heading: Vec<HeadingFix>,
}

impl Given {
    /// As the batch takes them.
    pub fn logs(&self) -> MotionLogs<'_> {
        MotionLogs {
            imu: &self.imu,
            positions: &self.positions,
            heading: &self.heading,
        }
    }
}
