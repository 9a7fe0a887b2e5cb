//! SBET (smoothed best estimate of trajectory) of Applanix: 17 little-endian f64 per record.
//!
//! Positions are latitude and longitude (rad) and ellipsoidal height, so a trajectory needs a
//! [`Projection`]. Roll, pitch and platform heading rotate the body (x forward, y right, z down)
//! against a level frame that wanders, whose x axis has the azimuth −`wander_angle`: true heading =
//! platform heading − wander angle. Velocities are along the axes of that frame with y to the left
//! of x and z up: v_north = v_x cos α − v_y sin α, v_east = −v_x sin α − v_y cos α.

use crate::error::{Error, Location, Result};
use crate::format::binary::{Bytes, Number};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::poses::order::in_time_order;
use crate::geometry::{Projection, Vec3};
use crate::sensor::{Continued, GeographicPose, NavigationAngles, PoseRecord, project_pose};

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
    poses: Some(refuse),
    has_navigation_angles: true,
    note: "geographic positions and a wander azimuth: used with `crs` in [frame] of a project",
    frame: Frame::Fixed(
        "radians and metres (the format); latitude, longitude, height; wander azimuth",
    ),
    ..Kind::new("sbet", "trajectory (SBET, geographic)")
};

/// Refuses geographic poses and names the remedy; damage to the file is reported first.
fn refuse(input: &Input) -> Result<Vec<PoseRecord>> {
    for_each(input, |_| ())?;
    Err(Error::data(
        format!(
            "{}: SBET contains latitude, longitude and a wander azimuth, not a local frame",
            input.path().display()
        ),
        "name the projected system as `crs` in [frame] of the project",
    ))
}

fn record(bytes: &[u8]) -> [f64; 17] {
    std::array::from_fn(|i| Number::F64.read(&bytes[8 * i..], false))
}

/// Whether these could be the first bytes of a file of `size` bytes in this format.
pub(crate) fn looks_like(start: &[u8], size: u64) -> bool {
    use std::f64::consts::{FRAC_PI_2, TAU};
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

/// Reads poses in the projected coordinates of `system`: east, north and ellipsoidal height, and
/// the attitude of a **body with x forward, y left, z up** against grid north. Velocities are the
/// derivatives of these positions, so they have the scale of the projection. Times are as in the
/// file, most often seconds of the GPS week; no datum shift is applied.
///
/// # Errors
/// A file that is cut off or has numbers that are not finite, times out of order, positions
/// outside `system`, no records. Errors of a record name its byte.
pub fn read_sbet(input: impl Into<Input>, system: &Projection) -> Result<Vec<PoseRecord>> {
    let input = &input.into();
    let mut records: Vec<PoseRecord> = Vec::new();
    let mut times = Continued::default();
    try_for_each(input, |at, values| {
        let error = |found: String, expected: String| {
            Err(Error::format(
                input.path(),
                Location::Byte(at),
                found,
                expected,
            ))
        };
        if let Err(found) = times.in_order(values[0]) {
            return error(found, "times that increase".to_owned());
        }
        match project_pose(&pose(values), system) {
            Ok(pose) => records.push(pose),
            Err(misfit) => return error(misfit.found, misfit.expected),
        }
        Ok(())
    })?;
    in_time_order(input, records)
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
