//! SBET (smoothed best estimate of trajectory) of Applanix: 17 little-endian f64 per record.
//!
//! Positions are latitude and longitude (rad) and ellipsoidal height, so a trajectory needs a projection. Roll, pitch and platform heading rotate the body (x forward, y right, z down)
//! against a level frame that wanders, whose x axis has the azimuth −`wander_angle`: true heading =
//! platform heading − wander angle. Velocities are along the axes of that frame with y to the left
//! of x and z up: v_north = v_x cos α − v_y sin α, v_east = −v_x sin α − v_y cos α.

use std::f64::consts::FRAC_PI_2;

use crate::error::{Error, Location, Result};
use crate::format::binary::{Bytes, Number};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::geometry::Vec3;
use crate::sensor::{Continued, GeographicPose, NavigationAngles};

/// Bytes of a record.
pub(crate) const RECORD: usize = 136;

/// The columns of a record.
pub(crate) const COLUMNS: [&str; 17] = [
    "time_s",
    "latitude_rad",
    "longitude_rad",
    "altitude_m",
    "velocity_x_m_s",
    "velocity_y_m_s",
    "velocity_z_m_s",
    "roll_rad",
    "pitch_rad",
    "platform_heading_rad",
    "wander_angle_rad",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "gyro_x_rad_s",
    "gyro_y_rad_s",
    "gyro_z_rad_s",
];

pub(crate) const SBET: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes, start.size)),
    extensions: &["sbet"],
    geographic_poses: Some(read),
    has_navigation_angles: true,
    note: "geographic positions and a wander azimuth: used with `crs` in [frame] of a project",
    frame: Frame::Fixed(
        "radians and metres (the format); latitude, longitude, height; wander azimuth",
    ),
    ..Kind::new("sbet", "trajectory (SBET, geographic)")
};

fn record(bytes: &[u8]) -> [f64; 17] {
    std::array::from_fn(|i| Number::F64.read(&bytes[8 * i..], false))
}

/// Whether these could be the first bytes of a file of `size` bytes in this format.
pub(crate) fn looks_like(start: &[u8], size: u64) -> bool {
    use std::f64::consts::TAU;
    start.len() >= RECORD && size.is_multiple_of(RECORD as u64) && {
        let r = record(start);
        let normal = |v: f64| v == 0.0 || (1e-12..1e10).contains(&v.abs());
        r.iter().all(|v| normal(*v))
            && r[0] >= 0.0
            && r[1].abs() <= FRAC_PI_2
            && r[2].abs() <= TAU
            && r[7].abs() <= TAU
            && r[8].abs() <= TAU
    }
}

/// Calls `take` with every record.
pub(crate) fn for_each(input: &Input, mut take: impl FnMut(&[f64; 17])) -> Result<()> {
    try_for_each(input, |_, values| {
        take(values);
        Ok(())
    })
}

/// Calls `take` with the byte offset of every record and the record, until it fails.
fn try_for_each(input: &Input, mut take: impl FnMut(u64, &[f64; 17]) -> Result<()>) -> Result<()> {
    let mut bytes = Bytes::open(input)?;
    let mut buffer = [0; RECORD];
    while bytes.at < bytes.total {
        let at = bytes.at;
        bytes.take(&mut buffer, "an SBET record")?;
        let values = record(&buffer);
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            bytes.at = at + 8 * i as u64;
            return Err(bytes.error(format!("{} = {}", COLUMNS[i], values[i]), "a finite number"));
        }
        take(at, &values)?;
    }
    Ok(())
}

/// Reads the poses. Times are as in the file, most often seconds of the GPS week.
///
/// # Errors
/// A file that is cut off, numbers that are not finite, latitudes that are none, times out of order. Errors of a record
/// name its byte.
fn read(input: &Input) -> Result<Vec<GeographicPose>> {
    let mut poses = Vec::new();
    let mut times = Continued::default();
    try_for_each(input, |at, values| {
        let error = |found: String, expected: &str| {
            Error::format(input.path(), Location::Byte(at), found, expected)
        };
        times
            .in_order(values[0])
            .map_err(|found| error(found, "times that increase"))?;
        let pose = pose(values);
        if pose.latitude_rad.abs() > FRAC_PI_2 {
            let found = format!("latitude {}°", pose.latitude_rad.to_degrees());
            return Err(error(found, "-90° to 90°, in radians"));
        }
        poses.push(pose);
        Ok(())
    })?;
    Ok(poses)
}

fn pose(values: &[f64; 17]) -> GeographicPose {
    let [time_s, latitude_rad, longitude_rad, height_m, ..] = *values;
    let [roll, pitch, platform_heading, wander] = [values[7], values[8], values[9], values[10]];
    let (sin, cos) = wander.sin_cos();
    let (along, left, up) = (values[4], values[5], values[6]);
    let velocity_m_s = Vec3::new(-along * sin - left * cos, along * cos - left * sin, up);
    GeographicPose {
        time_s,
        latitude_rad,
        longitude_rad,
        height_m,
        angles: NavigationAngles {
            roll,
            pitch,
            heading: platform_heading - wander,
        },
        velocity_m_s: Some(velocity_m_s),
        sigma: None,
    }
}

#[cfg(test)]
mod tests;
