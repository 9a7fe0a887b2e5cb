//! SBET of Applanix, for inspection only: 17 little-endian f64 per record. Its positions are
//! latitude and longitude (rad) and ellipsoidal height, its attitude refers to a wander azimuth.
//! They cannot be converted to a local frame without a projection chosen by the user, so SBET is
//! not read as a trajectory.

use std::path::Path;

use super::binary::{Bytes, Number};
use super::kind::Kind;
use crate::error::{Error, Result};
use crate::sensor::PoseRecord;

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
    note: "geographic positions and a wander azimuth: export projected coordinates to use it",
    ..Kind::new("sbet", "trajectory (SBET, geographic)")
};

/// Says what to do instead; damage is reported first.
fn refuse(path: &Path) -> Result<Vec<PoseRecord>> {
    for_each(path, |_| ())?;
    Err(Error::data(
        format!(
            "{}: SBET contains latitude, longitude and a wander azimuth, not a local frame",
            path.display()
        ),
        "export the trajectory in projected coordinates as time_s, east_m, north_m, up_m, qx, qy, qz, qw, \
         with the grid convergence in its attitude",
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
pub(crate) fn for_each(path: &Path, mut take: impl FnMut(&[f64; 17])) -> Result<()> {
    let mut bytes = Bytes::open(path)?;
    let mut buffer = [0; RECORD];
    while bytes.at < bytes.total {
        bytes.take(&mut buffer, "an SBET record")?;
        let values = record(&buffer);
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            bytes.at -= (RECORD - 8 * i) as u64;
            return Err(bytes.error(format!("{} = {}", COLUMNS[i], values[i]), "a finite number"));
        }
        take(&values);
    }
    Ok(())
}
