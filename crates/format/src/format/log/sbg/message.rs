//! The kinds of messages that are read, and their content.

use super::clock::Trust;
use crate::geometry::Vec3;
use crate::sensor::{GeographicFix, HeadingFix};

/// A class and the number of a message within it.
pub(super) type Kind = (u8, u8);

// The manufacturer's names have the prefix SBG_ECOM_LOG_.
pub(super) const STATUS: Kind = (0, 1);
pub(super) const UTC_TIME: Kind = (0, 2);
pub(super) const IMU_DATA: Kind = (0, 3);
pub(super) const EKF_EULER: Kind = (0, 6);
pub(super) const EKF_QUAT: Kind = (0, 7);
pub(super) const EKF_NAV: Kind = (0, 8);
pub(super) const GPS1_POS: Kind = (0, 14);
pub(super) const GPS1_HDT: Kind = (0, 15);
pub(super) const GPS2_POS: Kind = (0, 17);
pub(super) const GPS2_HDT: Kind = (0, 18);
pub(super) const IMU_SHORT: Kind = (0, 44);

/// The content of a message.
#[derive(Debug, Clone, Copy)]
pub(super) enum Content {
    Imu {
        gyro_rad_s: Vec3,
        accel_m_s2: Vec3,
    },
    /// The time is filled in by the reader.
    Heading(HeadingFix),
    /// The time is filled in by the reader.
    Position(GeographicFix),
    Utc {
        unix_ns: i64,
        trust: Trust,
    },
    /// A message with a time that is only counted.
    TimeOnly,
}
