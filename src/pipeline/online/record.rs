//! Records of all sensors in one order.

use crate::pipeline::logs::DriveLogs;
use crate::sensor::{HeadingFix, ImuSample, PositionFix};

/// A record of any sensor, in common time, the project's origin subtracted.
#[derive(Debug, Clone, Copy)]
pub(super) enum Record {
    Imu(ImuSample),
    Position(usize, PositionFix),
    Heading(HeadingFix),
}

impl Record {
    fn time_s(&self) -> f64 {
        match self {
            Self::Imu(sample) => sample.time_s,
            Self::Position(_, fix) => fix.time_s,
            Self::Heading(fix) => fix.time_s,
        }
    }

    /// The IMU first where times are equal: what it has reached needs no wait.
    fn order(&self) -> usize {
        match self {
            Self::Imu(_) => 0,
            Self::Heading(_) => 1,
            Self::Position(sensor, _) => 2 + sensor,
        }
    }
}

/// All records in time order.
pub(super) fn merged(mut records: Vec<Record>) -> Vec<Record> {
    records.sort_by(|a, b| (a.time_s().total_cmp(&b.time_s())).then(a.order().cmp(&b.order())));
    records
}

/// The records of logs that have been read.
pub(super) fn in_order(logs: &DriveLogs) -> Vec<Record> {
    let mut records: Vec<Record> = logs.imu.iter().map(|s| Record::Imu(*s)).collect();
    records.extend(logs.heading.iter().map(|h| Record::Heading(*h)));
    for (sensor, fixes) in logs.positions.iter().enumerate() {
        records.extend(fixes.iter().map(|f| Record::Position(sensor, *f)));
    }
    merged(records)
}
