//! The content of messages: little-endian numbers at fixed offsets after a time stamp.

use super::clock::{Trust, unix_ns};
use super::frames::Frame;
use super::message::*;
use crate::geometry::Vec3;
use crate::sensor::{FixQuality, GeographicFix, HeadingFix};

/// The payload of a message; numbers beyond the end of the payload are `None`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(self, at: usize) -> Option<[u8; N]> {
        self.0.get(at..)?.first_chunk().copied()
    }

    fn u8(self, at: usize) -> Option<u8> {
        self.bytes(at).map(u8::from_le_bytes)
    }

    pub(super) fn u16(self, at: usize) -> Option<u16> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    pub(super) fn u32(self, at: usize) -> Option<u32> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    /// A finite number of 32 bits.
    fn f32(self, at: usize) -> Option<f64> {
        let value = self.bytes(at).map(f32::from_le_bytes)?;
        value.is_finite().then_some(f64::from(value))
    }

    /// A finite number of 64 bits.
    fn f64(self, at: usize) -> Option<f64> {
        let value = self.bytes(at).map(f64::from_le_bytes)?;
        value.is_finite().then_some(value)
    }

    /// A finite number of 32 bits between `low` and `high`, exclusive.
    fn f32_within(self, at: usize, low: f64, high: f64) -> Option<f64> {
        self.f32(at).filter(|v| low < *v && *v < high)
    }

    fn vector_f32(self, at: usize) -> Option<Vec3> {
        let [x, y, z] = [0, 4, 8].map(|i| self.f32(at + i));
        Some(Vec3::new(x?, y?, z?))
    }

    fn vector_i32(self, at: usize) -> Option<Vec3> {
        let [x, y, z] = [0, 4, 8].map(|i| self.bytes(at + i).map(i32::from_le_bytes));
        Some(Vec3::new(x?.into(), y?.into(), z?.into()))
    }
}

/// Whether the content of a message is read, not only its time.
pub(super) fn is_read(kind: Kind) -> bool {
    let kinds = [
        UTC_TIME, IMU_DATA, IMU_SHORT, GPS1_POS, GPS2_POS, GPS1_HDT, GPS2_HDT,
    ];
    kinds.contains(&kind)
}

/// The time stamp and the content of a frame; `None` if the message is not read or has no usable content.
pub(super) fn content(frame: &Frame<'_>) -> Option<(u32, Content)> {
    let fields = Fields(frame.payload);
    let content = match (frame.class, frame.message) {
        IMU_SHORT => imu_short(fields),
        IMU_DATA => imu_data(fields),
        UTC_TIME => utc_time(fields),
        GPS1_HDT | GPS2_HDT => heading(fields),
        GPS1_POS | GPS2_POS => position(fields),
        STATUS | EKF_EULER | EKF_QUAT | EKF_NAV => Some(Content::TimeOnly),
        _ => None,
    };
    Some((fields.u32(0)?, content?))
}

/// The state of an IMU message if the device has contact to its IMU.
fn imu_state(fields: Fields<'_>) -> Option<u16> {
    const CONTACT: u16 = 1;
    fields.u16(4).filter(|state| state & CONTACT != 0)
}

fn imu_short(fields: Fields<'_>) -> Option<Content> {
    const ACCEL_PER_M_S2: f64 = 1_048_576.0;
    const GYRO_PER_RAD_S: f64 = 67_108_864.0;
    // Scale for rates above 1833°/s.
    const FAST_GYRO_PER_RAD_S: f64 = 12_304_174.0;
    const IS_FAST: u16 = 1 << 10;
    let gyro_scale = match imu_state(fields)? & IS_FAST {
        0 => GYRO_PER_RAD_S,
        _ => FAST_GYRO_PER_RAD_S,
    };
    Some(Content::Imu {
        accel_m_s2: fields.vector_i32(6)? / ACCEL_PER_M_S2,
        gyro_rad_s: fields.vector_i32(18)? / gyro_scale,
    })
}

fn imu_data(fields: Fields<'_>) -> Option<Content> {
    imu_state(fields)?;
    Some(Content::Imu {
        accel_m_s2: fields.vector_f32(34)?,
        gyro_rad_s: fields.vector_f32(46)?,
    })
}

fn utc_time(fields: Fields<'_>) -> Option<Content> {
    let state = fields.u16(4)?;
    // In state 0 the date is the initial date of the firmware.
    let leap_seconds = match (state >> 6) & 0xf {
        1 => false,
        2 => true,
        _ => return None,
    };
    let [month, day, hour, minute, second] = [8, 9, 10, 11, 12].map(|i| fields.u8(i));
    let date = [fields.u16(6)?.into(), month?.into(), day?.into()];
    let time = [hour?.into(), minute?.into(), second?.into()];
    let trust = Trust {
        leap_seconds,
        accurate: state & (1 << 5) != 0,
    };
    Some(Content::Utc {
        unix_ns: unix_ns(date, time, fields.u32(13)?.into())?,
        trust,
    })
}

fn heading(fields: Fields<'_>) -> Option<Content> {
    if fields.u16(4)? & 0x3f != 0 {
        return None;
    }
    let sigma_deg = fields.f32_within(14, 0.0, 180.0)?;
    let pitch_sigma_deg = fields.f32_within(22, 0.0, 90.0);
    let pitch_deg = fields.f32(18).filter(|pitch| pitch.abs() <= 90.0);
    let pitch = pitch_deg.zip(pitch_sigma_deg);
    Some(Content::Heading(HeadingFix {
        time_s: f64::NAN,
        heading_rad: fields.f32(10)?.to_radians(),
        sigma_rad: Some(sigma_deg.to_radians()),
        pitch_rad: pitch.map(|(pitch, _)| pitch.to_radians()),
        pitch_sigma_rad: pitch.map(|(_, sigma)| sigma.to_radians()),
    }))
}

/// The quality of a type of solution; `None` for one that the receiver does not know and for a position that was
/// entered.
fn quality(solution: u32) -> Option<FixQuality> {
    match solution {
        2 => Some(FixQuality::Single),
        3..=5 => Some(FixQuality::Differential),
        6 | 8 => Some(FixQuality::Float),
        7 | 9 => Some(FixQuality::Fixed),
        _ => None,
    }
}

fn position(fields: Fields<'_>) -> Option<Content> {
    const UNKNOWN_SIGMA_M: f64 = 9999.0;
    let state = fields.u32(4)?;
    let (status, solution) = (state & 0x3f, (state >> 6) & 0x3f);
    if status != 0 || solution == 0 {
        return None;
    }
    let sigma_m = |at| fields.f32_within(at, 0.0, UNKNOWN_SIGMA_M);
    let degrees = |at, most| fields.f64(at).filter(|v: &f64| v.abs() <= most);
    Some(Content::Position(GeographicFix {
        time_s: f64::NAN,
        latitude_rad: degrees(12, 90.0)?.to_radians(),
        longitude_rad: degrees(20, 360.0)?.to_radians(),
        height_m: fields.f64(28)? + fields.f32(36)?,
        sigma_m: Some(Vec3::new(sigma_m(44)?, sigma_m(40)?, sigma_m(48)?)),
        quality: quality(solution),
    }))
}
