//! Records of all sensors of a drive in one order.

use super::{HeadingFix, ImuSample, PositionFix, Timed};

/// A record of any sensor of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Record {
    /// Angular rate and specific force.
    Imu(ImuSample),
    /// A position, and the index of its sensor.
    Position(usize, PositionFix),
    /// A heading.
    Heading(HeadingFix),
}

impl Record {
    /// Seconds.
    pub fn time_s(&self) -> f64 {
        match self {
            Self::Imu(sample) => sample.time_s(),
            Self::Position(_, fix) => fix.time_s(),
            Self::Heading(fix) => fix.time_s(),
        }
    }

    /// Seconds, to be changed.
    pub fn time_s_mut(&mut self) -> &mut f64 {
        match self {
            Self::Imu(sample) => sample.time_s_mut(),
            Self::Position(_, fix) => fix.time_s_mut(),
            Self::Heading(fix) => fix.time_s_mut(),
        }
    }

    /// Order of records with equal times: the IMU first, so that the others need not wait for it.
    fn order(&self) -> usize {
        match self {
            Self::Imu(_) => 0,
            Self::Heading(_) => 1,
            Self::Position(sensor, _) => 2 + sensor,
        }
    }

    /// Sorts records by time; those of a sensor with equal times stay in their order.
    pub fn sort(records: &mut [Self]) {
        records.sort_by(|a, b| (a.time_s().total_cmp(&b.time_s())).then(a.order().cmp(&b.order())));
    }
}
