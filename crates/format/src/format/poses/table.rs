//! Trajectories as text: the native table, lines of numbers, and the writer of TUM.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::left_out::LeftOut;
use crate::format::log::tables::{read_rows, write_rows};
use crate::format::poses::order::Order;
use crate::format::text::lines::Lines;
use crate::format::text::table::{Columns, Table};
use crate::geometry::{Rotation, Vec3, WorldFromBody};
use crate::sensor::{ImuBias, PoseRecord, PoseSigma};

pub(crate) const TRAJECTORY: Columns = Columns {
    needed: &[
        "time_s", "east_m", "north_m", "up_m", "qx", "qy", "qz", "qw",
    ],
    optional: &[
        "velocity_east_m_s",
        "velocity_north_m_s",
        "velocity_up_m_s",
        "gyro_bias_x_rad_s",
        "gyro_bias_y_rad_s",
        "gyro_bias_z_rad_s",
        "accel_bias_x_m_s2",
        "accel_bias_y_m_s2",
        "accel_bias_z_m_s2",
        "sigma_east_m",
        "sigma_north_m",
        "sigma_up_m",
        "sigma_rotation_east_rad",
        "sigma_rotation_north_rad",
        "sigma_rotation_up_rad",
    ],
};

pub(crate) const POSE_TABLE: Kind = Kind {
    columns: Some(TRAJECTORY),
    poses: Some(read_native),
    frame: Frame::Fixed(
        "metres, seconds (named in the header); world: east, north, up (named in the header)",
    ),
    ..Kind::new("trajectory-csv", "trajectory (table)")
};

/// Column names of TUM, as programs write them in a comment.
pub(crate) const TUM_COLUMNS: [&str; 8] = ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"];

/// Tolerance of the length of a quaternion: four decimals stay within it.
const QUATERNION_SLACK: f64 = 1e-3;

/// The rotation of a quaternion, or its length if that is not 1. A quaternion of unit length is kept bit by bit.
pub(super) fn rotation(x: f64, y: f64, z: f64, w: f64) -> std::result::Result<Rotation, f64> {
    let q = nalgebra::Quaternion::new(w, x, y, z);
    let length = q.norm();
    if (length - 1.0).abs() < 1e-14 {
        Ok(Rotation::new_unchecked(q))
    } else if (length - 1.0).abs() <= QUATERNION_SLACK {
        Ok(Rotation::new_normalize(q))
    } else {
        Err(length)
    }
}

pub(super) const UNIT_QUATERNION: &str = "a unit quaternion qx, qy, qz, qw";

/// Reads a native table. Rows with a quaternion of zeros have no pose.
pub(crate) fn read_native(input: &Input) -> Result<Vec<PoseRecord>> {
    let mut order = Order::default();
    let rows = read_rows::<23, _>(input, &TRAJECTORY, "pose", |row, table: &Table| {
        if row[4..8] == [0.0; 4] {
            return Ok(None);
        }
        order.add(row[0], |found, expected| table.error(found, expected));
        let vector = |i: usize| Vec3::new(row[i], row[i + 1], row[i + 2]);
        let present = |i: usize, n: usize| row[i..i + n].iter().all(|v| !v.is_nan());
        let r = rotation(row[4], row[5], row[6], row[7]).map_err(|length| {
            table.error(format!("a quaternion of length {length}"), UNIT_QUATERNION)
        })?;
        Ok(Some(PoseRecord {
            time_s: row[0],
            world_from_body: WorldFromBody::new(r, vector(1)),
            velocity_m_s: present(8, 3).then(|| vector(8)),
            bias: present(11, 6).then(|| ImuBias {
                gyro_rad_s: vector(11),
                accel_m_s2: vector(14),
            }),
            sigma: present(17, 6).then(|| PoseSigma {
                position_m: vector(17),
                rotation_rad: vector(20),
            }),
        }))
    })?;
    order.finish()?;
    let all = rows.len();
    let poses: Vec<PoseRecord> = rows.into_iter().flatten().collect();
    let mut left_out = LeftOut::default();
    left_out.add_all("with a quaternion of zeros", (all - poses.len()) as u64);
    left_out.checked(input, poses, "poses", "rows with a pose")
}

/// Reads lines of `N` numbers with `#` comments; the first number is the time.
pub(crate) fn read_lines<const N: usize>(
    input: &Input,
    mut record: impl FnMut(&[f64; N], &Lines) -> Result<PoseRecord>,
) -> Result<Vec<PoseRecord>> {
    let mut lines = Lines::open(input)?;
    let (mut cells, mut row) = (Vec::with_capacity(N), [0.0; N]);
    let mut order = Order::default();
    let mut records: Vec<PoseRecord> = Vec::new();
    let mut left_out = LeftOut::default();
    let expected = || format!("{N} finite numbers");
    while lines.next_row(&mut cells, |row| row.len() == N, expected)? {
        if cells.iter().any(|value| !value.is_finite()) {
            left_out.add("with values that are no numbers");
            continue;
        }
        row.copy_from_slice(&cells);
        order.add(row[0], |found, expected| lines.error(found, expected));
        records.push(record(&row, &lines)?);
    }
    order.finish()?;
    left_out.checked(input, records, "poses", "lines of finite numbers")
}

/// Writes the native table, which [`read_trajectory`](crate::format::read_trajectory) reads back bit by bit.
/// Velocities, biases and standard deviations get columns if any pose has them.
///
/// # Errors
/// The file cannot be written.
pub fn write_trajectory(path: &Path, poses: &[PoseRecord]) -> Result<()> {
    let absent = Vec3::repeat(f64::NAN);
    write_rows(path, &TRAJECTORY, poses, |pose| {
        let world_from_body = &pose.world_from_body;
        let (t, q) = (&world_from_body.translation_m, &world_from_body.rotation);
        let bias = pose
            .bias
            .map_or([absent; 2], |b| [b.gyro_rad_s, b.accel_m_s2]);
        let sigma = pose
            .sigma
            .map_or([absent; 2], |s| [s.position_m, s.rotation_rad]);
        let velocity = pose.velocity_m_s.unwrap_or(absent);
        let optional = [velocity, bias[0], bias[1], sigma[0], sigma[1]];
        let mut row = [0.0; 23];
        row[..8].copy_from_slice(&[pose.time_s, t.x, t.y, t.z, q.i, q.j, q.k, q.w]);
        for (cells, vector) in row[8..].chunks_exact_mut(3).zip(&optional) {
            cells.copy_from_slice(vector.as_slice());
        }
        row
    })
}

/// Writes `timestamp tx ty tz qx qy qz qw` below a comment that names these columns;
/// [`read_trajectory`](crate::format::read_trajectory) reads it back bit by bit. Velocities, biases and standard
/// deviations are not written.
///
/// # Errors
/// The file cannot be written.
pub fn write_tum(path: &Path, poses: &[PoseRecord]) -> Result<()> {
    let file = File::create(path).map_err(|e| Error::io(path, e))?;
    let mut out = BufWriter::with_capacity(1 << 18, file);
    let mut write = || {
        writeln!(out, "# {}", TUM_COLUMNS.join(" "))?;
        for pose in poses {
            let (t, q) = (
                &pose.world_from_body.translation_m,
                &pose.world_from_body.rotation,
            );
            // Numbers are written in the shortest form that reads back as the same number.
            writeln!(
                out,
                "{} {} {} {} {} {} {} {}",
                pose.time_s, t.x, t.y, t.z, q.i, q.j, q.k, q.w
            )?;
        }
        out.flush()
    };
    write().map_err(|e| Error::io(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{detect, read_trajectory};

    #[test]
    fn tum_is_read_back_bit_by_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.txt");
        let pose = |i: u32| {
            let s = f64::from(i);
            let rotation = Rotation::from_euler_angles(0.1 * s, -0.01 * s, 2.0 - 0.3 * s);
            let position = Vec3::new(364_000.0 + s / 3.0, 5_621_000.0 - s.sqrt(), -1e-9 * s);
            let time_s = 1_700_000_000.0 + 0.005 * s;
            PoseRecord::new(time_s, WorldFromBody::new(rotation, position))
        };
        let mut poses: Vec<_> = (0..500).map(pose).collect();
        write_tum(&path, &poses).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("# timestamp tx ty tz qx qy qz qw\n1700000000 364000 "));
        assert_eq!(detect(&path).unwrap().id(), "tum");
        let found = read_trajectory(&path).unwrap();
        assert_eq!(found, poses);
        let bits = |pose: &PoseRecord| pose.world_from_body.translation_m.map(f64::to_bits);
        assert!(found.iter().map(bits).eq(poses.iter().map(bits)));
        // TUM has no columns for velocities, so they are left out.
        poses[0].velocity_m_s = Some(Vec3::x());
        write_tum(&path, &poses).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
    }
}
