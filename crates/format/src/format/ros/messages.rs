//! The message types that are read, and their conversion to records.
//!
//! All times are the stamps in the headers of the messages, not the times of recording.

use super::wire::{Decoded, Fault, Message, Wire};
use crate::geometry::{Rotation, Vec3, WorldFromBody, is_finite};
use crate::sensor::{GeographicFix, ImuSample, PoseRecord, PoseSigma};

/// Largest accepted number of fields of a cloud; a larger one is damage.
const MOST_FIELDS: u32 = 1000;
/// Tolerance of the length of a quaternion: four decimals stay within it.
const QUATERNION_SLACK: f64 = 1e-3;

/// `sensor_msgs/Imu`: angular rate (rad/s) and specific force (m/s², upwards at rest) in the axes of
/// the IMU (REP 145). Its orientation is not used.
pub(super) struct Imu(ImuSample);

impl Imu {
    /// The names of the type.
    pub(super) const TYPES: [&str; 1] = ["sensor_msgs/Imu"];

    /// The sample.
    pub(super) fn sample(self) -> ImuSample {
        self.0
    }
}

impl<'a> Message<'a> for Imu {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        wire.f64s::<13>()?; // orientation and its covariance
        let gyro_rad_s = Vec3::from(wire.f64s()?);
        let gyro_covariance: [f64; 9] = wire.f64s()?;
        let accel_m_s2 = Vec3::from(wire.f64s()?);
        let accel_covariance: [f64; 9] = wire.f64s()?;
        for (what, values, covariance) in [
            ("angular velocity", gyro_rad_s, gyro_covariance),
            ("linear acceleration", accel_m_s2, accel_covariance),
        ] {
            if covariance[0] == -1.0 {
                return Err(Fault::new(
                    format!("a covariance of the {what} that begins with -1: not measured"),
                    "angular velocity and linear acceleration",
                ));
            }
            finite(what, &values)?;
        }
        Ok(Self(ImuSample {
            time_s,
            gyro_rad_s,
            accel_m_s2,
        }))
    }
}

/// A message with one pose of a body: `nav_msgs/Odometry`, `geometry_msgs/PoseStamped`,
/// `geometry_msgs/PoseWithCovarianceStamped` or `geometry_msgs/TransformStamped`.
///
/// The world is the frame of the header (it drifts in an odometry), the body is the child frame or the
/// frame whose pose the message gives. The twist of an odometry is not used: the definition gives it in
/// body axes, but many programs leave it at zero or write it in the world frame.
pub(super) struct PoseMessage {
    time_s: f64,
    position_m: Vec3,
    /// x, y, z, w.
    quaternion: [f64; 4],
    /// Covariance of x, y, z (m²) and of the rotation about x, y, z (rad²), row by row.
    covariance: Option<[f64; 36]>,
}

impl PoseMessage {
    /// The pose, with standard deviations if the message gives all six.
    ///
    /// The covariance of ROS refers to the fixed axes of the frame of the header. These are the world
    /// axes of [`PoseSigma`], so its diagonal is used as it is. If a number on the diagonal is zero,
    /// negative or not finite, the standard deviations are unknown.
    pub(super) fn pose(&self) -> Decoded<PoseRecord> {
        finite("position", &self.position_m)?;
        let [x, y, z, w] = self.quaternion;
        let q = nalgebra::Quaternion::new(w, x, y, z);
        let length = q.norm();
        if !length.is_finite() || (length - 1.0).abs() > QUATERNION_SLACK {
            return Err(Fault::new(
                format!("a quaternion of length {length}"),
                "a unit quaternion",
            ));
        }
        let rotation = Rotation::new_normalize(q);
        let mut record =
            PoseRecord::new(self.time_s, WorldFromBody::new(rotation, self.position_m));
        record.sigma = self.covariance.and_then(|covariance| {
            let sigma: [f64; 6] = std::array::from_fn(|i| covariance[7 * i].sqrt());
            let is_known = sigma.iter().all(|s| s.is_finite() && *s > 0.0);
            is_known.then(|| PoseSigma {
                position_m: Vec3::new(sigma[0], sigma[1], sigma[2]),
                rotation_rad: Vec3::new(sigma[3], sigma[4], sigma[5]),
            })
        });
        Ok(record)
    }

    /// Reads position, orientation and, on request, the covariance after a header.
    fn take<'a>(wire: &mut impl Wire<'a>, time_s: f64, with_covariance: bool) -> Decoded<Self> {
        Ok(Self {
            time_s,
            position_m: Vec3::from(wire.f64s()?),
            quaternion: wire.f64s()?,
            covariance: with_covariance.then(|| wire.f64s()).transpose()?,
        })
    }
}

/// `nav_msgs/Odometry`.
pub(super) struct Odometry(pub(super) PoseMessage);
/// `geometry_msgs/PoseStamped`.
pub(super) struct PoseStamped(pub(super) PoseMessage);
/// `geometry_msgs/PoseWithCovarianceStamped`.
pub(super) struct PoseWithCovarianceStamped(pub(super) PoseMessage);
/// `geometry_msgs/TransformStamped`.
pub(super) struct TransformStamped(pub(super) PoseMessage);

/// The names of the types with one pose.
pub(super) const ODOMETRY: &str = "nav_msgs/Odometry";
/// See [`PoseStamped`].
pub(super) const POSE: &str = "geometry_msgs/PoseStamped";
/// See [`PoseWithCovarianceStamped`].
pub(super) const POSE_WITH_COVARIANCE: &str = "geometry_msgs/PoseWithCovarianceStamped";
/// See [`TransformStamped`].
pub(super) const TRANSFORM: &str = "geometry_msgs/TransformStamped";

impl<'a> Message<'a> for Odometry {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        wire.text()?; // child frame
        PoseMessage::take(wire, time_s, true).map(Self)
    }
}

impl<'a> Message<'a> for PoseStamped {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        PoseMessage::take(wire, time_s, false).map(Self)
    }
}

impl<'a> Message<'a> for PoseWithCovarianceStamped {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        PoseMessage::take(wire, time_s, true).map(Self)
    }
}

impl<'a> Message<'a> for TransformStamped {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        wire.text()?; // child frame
        PoseMessage::take(wire, time_s, false).map(Self)
    }
}

/// `sensor_msgs/NavSatFix`; `None` if the receiver had no fix.
pub(super) struct NavSatFix(pub(super) Option<GeographicFix>);

impl NavSatFix {
    /// The names of the type.
    pub(super) const TYPES: [&str; 1] = ["sensor_msgs/NavSatFix"];
}

impl<'a> Message<'a> for NavSatFix {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        let status = wire.u8()? as i8;
        let _service = wire.u16()?;
        let [latitude_deg, longitude_deg, altitude_m] = wire.f64s()?;
        let covariance: [f64; 9] = wire.f64s()?;
        let is_covariance_known = wire.u8()? != 0;
        // A negative status means no fix. The coordinates are then not set, or those of the last fix.
        if status < 0 {
            return Ok(Self(None));
        }
        let position = Vec3::new(latitude_deg, longitude_deg, altitude_m);
        finite("latitude, longitude and altitude", &position)?;
        if latitude_deg.abs() > 90.0 || longitude_deg.abs() > 360.0 {
            return Err(Fault::new(
                format!("latitude {latitude_deg} and longitude {longitude_deg}"),
                "degrees",
            ));
        }
        let variances = Vec3::new(covariance[0], covariance[4], covariance[8]);
        let is_positive = variances.iter().all(|v| v.is_finite() && *v > 0.0);
        let sigma_m = (is_covariance_known && is_positive).then(|| variances.map(f64::sqrt));
        Ok(Self(Some(GeographicFix {
            time_s,
            latitude_rad: latitude_deg.to_radians(),
            longitude_rad: longitude_deg.to_radians(),
            height_m: altitude_m,
            sigma_m,
            // Many drivers write the status of an unaugmented fix for every solution.
            quality: None,
        })))
    }
}

/// `sensor_msgs/LaserScan`: ranges in one plane. Angles in radians, ranges in metres, times in
/// seconds.
pub(super) struct LaserScan {
    /// Time of the first ray.
    pub(super) time_s: f64,
    /// Angle of the first ray about z, from x.
    pub(super) angle_min_rad: f64,
    /// Angle from one ray to the next.
    pub(super) angle_increment_rad: f64,
    /// Time from one ray to the next.
    pub(super) time_increment_s: f64,
    /// Lower limit of valid ranges.
    pub(super) range_min_m: f64,
    /// Upper limit of valid ranges.
    pub(super) range_max_m: f64,
    /// Ranges of all rays.
    pub(super) ranges_m: Vec<f64>,
    /// Intensities of all rays, or empty.
    pub(super) intensities: Vec<f64>,
}

impl LaserScan {
    /// The name of the type.
    pub(super) const TYPE: &str = "sensor_msgs/LaserScan";
}

impl<'a> Message<'a> for LaserScan {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        let angle_min_rad = wire.f32()?;
        let _angle_max_rad = wire.f32()?;
        let (angle_increment_rad, time_increment_s) = (wire.f32()?, wire.f32()?);
        let _scan_time_s = wire.f32()?;
        Ok(Self {
            time_s,
            angle_min_rad,
            angle_increment_rad,
            time_increment_s,
            range_min_m: wire.f32()?,
            range_max_m: wire.f32()?,
            ranges_m: wire.f32s()?,
            intensities: wire.f32s()?,
        })
    }
}

/// A field of the points of a cloud.
pub(super) struct Field<'a> {
    /// Its name.
    pub(super) name: &'a [u8],
    /// Offset in a point, bytes.
    pub(super) offset: u32,
    /// The number of its type, 1 (INT8) to 8 (FLOAT64).
    pub(super) datatype: u8,
}

/// `sensor_msgs/PointCloud2`: points as records with a layout described in the message.
pub(super) struct PointCloud2<'a> {
    /// Stamp of the header, seconds.
    pub(super) time_s: f64,
    /// Number of rows.
    pub(super) height: u32,
    /// Points of a row.
    pub(super) width: u32,
    /// The layout of a point.
    pub(super) fields: Vec<Field<'a>>,
    /// Byte order of the numbers in `data`.
    pub(super) is_big_endian: bool,
    /// Bytes of a point.
    pub(super) point_step: u32,
    /// Bytes of a row.
    pub(super) row_step: u32,
    /// All rows.
    pub(super) data: &'a [u8],
}

impl PointCloud2<'_> {
    /// The name of the type.
    pub(super) const TYPE: &'static str = "sensor_msgs/PointCloud2";
}

impl<'a> Message<'a> for PointCloud2<'a> {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let time_s = wire.header_stamp_s()?;
        let (height, width) = (wire.u32()?, wire.u32()?);
        let count = wire.u32()?;
        if count > MOST_FIELDS {
            let found = format!("a cloud with {count} fields");
            return Err(Fault::new(found, format!("at most {MOST_FIELDS}")));
        }
        let mut fields = Vec::new();
        for _ in 0..count {
            let field = Field {
                name: wire.text()?,
                offset: wire.u32()?,
                datatype: wire.u8()?,
            };
            let _count = wire.u32()?;
            fields.push(field);
        }
        Ok(Self {
            time_s,
            height,
            width,
            fields,
            is_big_endian: wire.u8()? != 0,
            point_step: wire.u32()?,
            row_step: wire.u32()?,
            data: wire.bytes()?,
        })
    }
}

/// Checks that all components of a vector are finite.
fn finite(what: &str, values: &Vec3) -> Decoded<()> {
    if is_finite(values) {
        return Ok(());
    }
    Err(Fault::new(
        format!("{what} {:?}", values.as_slice()),
        "finite numbers",
    ))
}
