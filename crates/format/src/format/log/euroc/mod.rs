//! Recordings in the layout of the EuRoC MAV data set: one folder per sensor with a `data.csv`,
//! whose header names the columns with their units and whose first column is the time in integer
//! nanoseconds.
//!
//! | file | read by |
//! |---|---|
//! | `imu0/data.csv` | [`read_imu`] |
//! | `state_groundtruth_estimate0/data.csv` | [`read_poses`], with velocities and biases |
//! | `vicon0/data.csv`, `mocap0/data.csv` | [`read_poses`] |
//! | `leica0/data.csv` | [`read_positions`] |
//! | `imu0/sensor.yaml` | [`noise::read_imu_noise`] |
//!
//! `R` is the reference frame (z up), `S` the sensor: `p_RS_R` is the sensor in R, `q_RS` rotates
//! from S to R with the scalar first. Columns may come in any order after the time; unknown columns
//! are ignored.

pub(crate) mod noise;
#[cfg(test)]
mod tests;

use crate::error::Result;
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind;
use crate::format::text::lines::Lines;
use crate::geometry::{Rotation, Vec3, WorldFromBody};
use crate::sensor::{Continued, ImuBias, ImuSample, PoseRecord, PositionFix, Positions};

/// The content of a file of the data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Angular rates and specific forces.
    Imu,
    /// Poses with velocities and biases of the IMU.
    State,
    /// Poses of a motion capture system.
    Pose,
    /// Positions of a laser tracker or total station.
    Position,
}

pub(crate) const IMU_LOG: kind::Kind = kind::Kind {
    signature: Some(|start| kind_of(start) == Some(Kind::Imu)),
    imu: Some(read_imu),
    frame: kind::Frame::Fixed(
        "rad/s and m/s² (named in the header, or the format without one); axes of the sensor S of the data set",
    ),
    ..kind::Kind::new("euroc-imu", "IMU log (EuRoC)")
};

pub(crate) const POSES: kind::Kind = kind::Kind {
    signature: Some(|start| matches!(kind_of(start), Some(Kind::State | Kind::Pose))),
    poses: Some(read_poses),
    frame: kind::Frame::Fixed(
        "metres (named in the header, or the format without one); world: reference frame R, z up; body: the sensor S of the data set",
    ),
    ..kind::Kind::new("euroc-poses", "trajectory (EuRoC)")
};

pub(crate) const POSITIONS: kind::Kind = kind::Kind {
    signature: Some(|start| kind_of(start) == Some(Kind::Position)),
    positions: Some(|path, _| Ok(Positions::of(read_positions(path)?))),
    frame: kind::Frame::Fixed(
        "metres (named in the header, or the format without one); world: reference frame R, z up",
    ),
    ..kind::Kind::new("euroc-positions", "position log (EuRoC)")
};

/// The content of a file according to its first line.
fn kind_of(start: &kind::Start<'_>) -> Option<Kind> {
    let line = start.bytes.split(|byte| *byte == b'\n').next()?;
    let line = std::str::from_utf8(line).ok()?;
    looks_like_header(line).or_else(|| of_numbers(line))
}

/// The content of a file without a header: numbers between commas, the first of them a date in nanoseconds. Their number
/// tells the kind.
fn of_numbers(line: &str) -> Option<Kind> {
    const YEAR_2001_NS: i64 = 1_000_000_000_000_000_000;
    let mut cells = line.trim_ascii().split(',').map(str::trim_ascii);
    let time_ns: i64 = cells.next()?.parse().ok()?;
    let mut count = 0;
    for cell in cells {
        cell.parse::<f64>().ok()?;
        count += 1;
    }
    let kinds = [Kind::Imu, Kind::State, Kind::Pose, Kind::Position];
    let kind = kinds.into_iter().find(|kind| kind.columns().len() == count);
    kind.filter(|_| time_ns >= YEAR_2001_NS)
}

/// A column of the data set and its unit.
type Column = (&'static str, &'static str);

const IMU: [Column; 6] = [
    ("w_RS_S_x", "rad s^-1"),
    ("w_RS_S_y", "rad s^-1"),
    ("w_RS_S_z", "rad s^-1"),
    ("a_RS_S_x", "m s^-2"),
    ("a_RS_S_y", "m s^-2"),
    ("a_RS_S_z", "m s^-2"),
];
/// Positions have the first three columns, poses the first seven, states all.
const STATE: [Column; 16] = [
    ("p_RS_R_x", "m"),
    ("p_RS_R_y", "m"),
    ("p_RS_R_z", "m"),
    ("q_RS_w", ""),
    ("q_RS_x", ""),
    ("q_RS_y", ""),
    ("q_RS_z", ""),
    ("v_RS_R_x", "m s^-1"),
    ("v_RS_R_y", "m s^-1"),
    ("v_RS_R_z", "m s^-1"),
    ("b_w_RS_S_x", "rad s^-1"),
    ("b_w_RS_S_y", "rad s^-1"),
    ("b_w_RS_S_z", "rad s^-1"),
    ("b_a_RS_S_x", "m s^-2"),
    ("b_a_RS_S_y", "m s^-2"),
    ("b_a_RS_S_z", "m s^-2"),
];

/// Tolerance of the length of a quaternion: four decimals stay within it.
const QUATERNION_SLACK: f64 = 1e-3;

impl Kind {
    /// The columns after the time.
    fn columns(self) -> &'static [Column] {
        match self {
            Self::Imu => &IMU,
            Self::State => &STATE,
            Self::Pose => &STATE[..7],
            Self::Position => &STATE[..3],
        }
    }
}

/// The names in a header with their units, without the time; `None` if the first column is not the time
/// in nanoseconds.
fn names(line: &str) -> Option<Vec<(&str, Option<&str>)>> {
    let line = line.trim_start_matches('\u{feff}').trim_ascii();
    let line = line.strip_prefix('#').unwrap_or(line);
    let mut cells = line.split(',').map(|cell| {
        let (name, rest) = cell.split_once('[').unwrap_or((cell, ""));
        let unit = rest.trim_ascii().strip_suffix(']').map(str::trim_ascii);
        (name.trim_ascii(), unit)
    });
    let (time, unit) = cells.next()?;
    (time == "timestamp" && unit.is_none_or(|unit| unit == "ns")).then(|| cells.collect())
}

/// The content of a file with this first line; `None` if the line is not a header of the data set.
pub fn looks_like_header(line: &str) -> Option<Kind> {
    let names = names(line)?;
    let has = |(wanted, _): &Column| names.iter().any(|(name, _)| name == wanted);
    [Kind::Imu, Kind::State, Kind::Pose, Kind::Position]
        .into_iter()
        .find(|kind| kind.columns().iter().all(has))
}

/// Nanoseconds as the nearest number of seconds: a conversion to a double before the division would
/// lose up to 128 ns of a present-day time.
fn seconds(time_ns: i64) -> f64 {
    const NS: i64 = 1_000_000_000;
    (time_ns / NS) as f64 + (time_ns % NS) as f64 / NS as f64
}

/// Reads every row of a file of one of the given kinds. `record` gets the time in seconds and the values
/// of the kind's columns.
fn read<T>(
    input: &Input,
    kinds: &[Kind],
    what: &str,
    mut record: impl FnMut(f64, &[f64], Kind, &Lines) -> Result<T>,
) -> Result<Vec<T>> {
    let mut lines = Lines::open(input)?;
    lines.advance()?;
    let mut header = lines.text().to_owned();
    let headless = of_numbers(&header).filter(|kind| kinds.contains(kind));
    if let Some(kind) = headless {
        let columns = kind.columns().iter().map(|(name, _)| *name);
        let columns: Vec<&str> = columns.collect();
        input.remark(format!(
            "there is no header: the columns are taken for a time in nanoseconds and {}",
            columns.join(", ")
        ));
        header = format!("#timestamp,{}", columns.join(","));
        lines = Lines::open(input)?;
    }
    let kind = looks_like_header(&header).filter(|kind| kinds.contains(kind));
    let (Some(kind), Some(names)) = (kind, names(&header)) else {
        let wanted = kinds.last().map_or(&[][..], |kind| kind.columns());
        let wanted: Vec<&str> = wanted.iter().map(|(name, _)| *name).collect();
        let found: String = header.chars().take(200).collect();
        let expected = format!("the header `#timestamp [ns],{}`", wanted.join(","));
        return Err(lines.error(format!("`{found}`"), expected));
    };
    // For each column of the file after the time: its index among the kind's columns.
    let mut slots = vec![None; names.len()];
    for (index, (wanted, unit)) in kind.columns().iter().enumerate() {
        for (i, (_, file_unit)) in names.iter().enumerate().filter(|(_, n)| n.0 == *wanted) {
            if let Some(file_unit) = file_unit.filter(|file_unit| file_unit != unit) {
                let found = format!("column {wanted} in [{file_unit}]");
                return Err(lines.error(found, format!("[{unit}]")));
            }
            if slots.contains(&Some(index)) {
                return Err(lines.error(format!("column {wanted} twice"), "each column once"));
            }
            slots[i] = Some(index);
        }
    }
    let mut values = vec![0.0; kind.columns().len()];
    let mut records = Vec::new();
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let count = text.split(',').count();
        if count != slots.len() + 1 {
            let expected = format!("{} as in the header", slots.len() + 1);
            return Err(lines.error(format!("{count} values"), expected));
        }
        let mut cells = text.split(',').map(str::trim_ascii);
        let time = cells.next().unwrap_or_default();
        let Ok(time_ns) = time.parse::<i64>() else {
            let time: String = time.chars().take(40).collect();
            return Err(lines.error(format!("time `{time}`"), "an integer of nanoseconds"));
        };
        for ((cell, slot), (name, _)) in cells.zip(&slots).zip(&names) {
            let Some(slot) = slot else { continue };
            match cell.parse::<f64>() {
                Ok(value) if value.is_finite() => values[*slot] = value,
                _ => {
                    let cell: String = cell.chars().take(40).collect();
                    let found = format!("`{cell}` in column {name}");
                    return Err(lines.error(found, "a finite number"));
                }
            }
        }
        records.push(record(seconds(time_ns), &values, kind, &lines)?);
    }
    if records.is_empty() {
        return Err(nothing_in(input.path(), what));
    }
    Ok(records)
}

fn vector(values: &[f64]) -> Vec3 {
    Vec3::new(values[0], values[1], values[2])
}

/// Reads `imu0/data.csv`, rows in the order of the file, in the axes of the IMU.
///
/// # Errors
/// Another header, other units, cells that are not finite numbers, no rows.
pub fn read_imu(input: &Input) -> Result<Vec<ImuSample>> {
    read(input, &[Kind::Imu], "IMU sample", |time_s, values, _, _| {
        Ok(ImuSample {
            time_s,
            gyro_rad_s: vector(values),
            accel_m_s2: vector(&values[3..]),
        })
    })
}

/// Reads poses, with velocities and biases if the file has them: R becomes the world, S the body.
/// S is the IMU in ground truth and the rigid body of markers in a motion capture file.
///
/// # Errors
/// Those of [`read_imu`]; quaternions that are not of unit length; times that run backwards.
pub fn read_poses(input: &Input) -> Result<Vec<PoseRecord>> {
    let kinds = [Kind::State, Kind::Pose];
    let mut times = Continued::default();
    read(input, &kinds, "pose", |time_s, values, kind, lines| {
        if let Err(found) = times.in_order(time_s) {
            return Err(lines.error(found, "times that increase"));
        }
        let q = nalgebra::Quaternion::new(values[3], values[4], values[5], values[6]);
        let length = q.norm();
        if (length - 1.0).abs() > QUATERNION_SLACK {
            let found = format!("a quaternion of length {length}");
            return Err(lines.error(found, "a unit quaternion q_RS_w, q_RS_x, q_RS_y, q_RS_z"));
        }
        let pose = WorldFromBody::new(Rotation::new_normalize(q), vector(values));
        let is_state = kind == Kind::State;
        Ok(PoseRecord {
            velocity_m_s: is_state.then(|| vector(&values[7..])),
            bias: is_state.then(|| ImuBias {
                gyro_rad_s: vector(&values[10..]),
                accel_m_s2: vector(&values[13..]),
            }),
            ..PoseRecord::new(time_s, pose)
        })
    })
}

/// Reads the positions of a prism, `leica0/data.csv`, rows in the order of the file.
///
/// # Errors
/// Those of [`read_imu`].
pub fn read_positions(input: &Input) -> Result<Vec<PositionFix>> {
    let kinds = [Kind::Position];
    read(input, &kinds, "position", |time_s, values, _, _| {
        Ok(PositionFix::with_sigma(time_s, vector(values), None))
    })
}
