//! Files of the KITTI data set: poses of the odometry benchmark and IMU records of the raw drives.

use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::civil::{DAY_S, days_since_1970, second_of_day};
use crate::format::text::lines::Lines;
use crate::geometry::{Mat3, Rotation, Vec3, WorldFromBody};
use crate::sensor::{ImuSample, PoseRecord};

/// Numbers in a line of a pose file: a row-major 3 × 4 matrix.
const POSE: usize = 12;
/// Numbers in an OXTS record.
const OXTS: usize = 30;
/// Index in an OXTS record of the acceleration ax, ay, az along the axes of the body, m/s².
const ACCEL: usize = 11;
/// Index in an OXTS record of the angular rate wx, wy, wz about the axes of the body, rad/s.
const GYRO: usize = 17;

pub(crate) const POSES: Kind = Kind {
    numbers: Some(looks_like_poses),
    poses: Some(read_poses),
    beside: Some(|path| candidate_times_paths(path).into()),
    note: "poses of a camera: x of the body is to the right, y down, z ahead",
    frame: Frame::Fixed(
        "metres (the format); world: the first camera, turned to z up; body: the camera, x right, y down, z forward",
    ),
    ..Kind::new("kitti-poses", "trajectory (KITTI)")
};

pub(crate) const OXTS_TIMES: Kind = Kind {
    signature: Some(|start| is_time_stamp(start.bytes)),
    imu: Some(|input| read_imu(input.path().parent().unwrap_or(Path::new("")))),
    beside: Some(record_files),
    frame: Frame::Fixed("rad/s and m/s² (the format); body frame x forward, y left, z up"),
    ..Kind::new(
        "kitti-oxts",
        "IMU log (timestamps.txt of a KITTI oxts folder)",
    )
};

/// Whether a file begins with a time stamp such as `2011-09-26 13:02:25.594360375`.
fn is_time_stamp(start: &[u8]) -> bool {
    let pattern = b"0000-00-00 00:00:00.";
    let fits = |(byte, like): (&u8, &u8)| match like {
        b'0' => byte.is_ascii_digit(),
        other => byte == other,
    };
    start.len() > pattern.len() && start.iter().zip(pattern).all(fits)
}

/// Tolerance of the columns of a rotation matrix: four decimals stay within it.
const ROTATION_SLACK: f64 = 1e-3;

/// Whether these could be the numbers of the first line of a pose file: 12 numbers with a rotation.
fn looks_like_poses(line: &[f64]) -> bool {
    line.len() == POSE && pose(line).is_some()
}

/// The pose of a line, if its matrix is a rotation.
fn pose(cells: &[f64]) -> Option<WorldFromBody> {
    let matrix = Mat3::from_fn(|row, column| cells[4 * row + column]);
    let off = (matrix.transpose() * matrix - Mat3::identity()).abs().max();
    // NaN must fail.
    if !(off <= ROTATION_SLACK && matrix.determinant() > 0.0) {
        return None;
    }
    // The nearest rotation: Newton's method for the polar decomposition doubles the number of valid
    // digits in every step.
    let mut nearest = matrix;
    for _ in 0..3 {
        nearest = (nearest + nearest.try_inverse()?.transpose()) * 0.5;
    }
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(nearest);
    let rotation = Rotation::new_normalize(Rotation::from(rotation).into_inner());
    let translation_m = Vec3::from_fn(|row, _| cells[4 * row + 3]);
    Some(WorldFromBody::new(rotation, translation_m))
}

/// The pose in a world with level x and y axes and z up. The world of the file is the first camera with y down
/// and z ahead; these axes become −z and y.
fn upright(pose: WorldFromBody) -> WorldFromBody {
    let about_x = Rotation::from_axis_angle(&Vec3::x_axis(), -std::f64::consts::FRAC_PI_2);
    let t = pose.translation_m;
    WorldFromBody::new(about_x * pose.rotation, Vec3::new(t.x, t.z, -t.y))
}

/// Reads a pose file: 12 numbers per line, the row-major 3 × 4 matrix from the left camera at that
/// frame to the left camera at the first frame. **Cameras have x right, y down and z forward**: the
/// world of the file has z forward, not up, and the body is the camera.
///
/// Pose files have no times. They come from a `times.txt` with one time in seconds per line, which is
/// searched for beside the pose file, in the folder above, and where the odometry benchmark has it:
/// `sequences/00/times.txt` for `poses/00.txt`.
///
/// # Errors
/// No `times.txt`; a `times.txt` of another length or with times that do not increase; lines without 12
/// finite numbers, matrices that are not rotations, no poses.
pub fn read_poses(input: &Input) -> Result<Vec<PoseRecord>> {
    let mut lines = Lines::open(input)?;
    let (times_path, times_s) = times(input.path())?;
    let mut times = times_s.iter();
    let mut cells = Vec::with_capacity(POSE);
    let mut records = Vec::new();
    let expected = || "12 finite numbers: a row-major 3 by 4 matrix".to_owned();
    while lines.next_numbers(&mut cells, |n| n == POSE, expected)? {
        let Some(pose) = pose(&cells) else {
            return Err(lines.error(
                "columns that are not perpendicular and of unit length",
                "a rotation matrix in columns 1 to 3, 5 to 7 and 9 to 11",
            ));
        };
        let Some(time_s) = times.next() else {
            return Err(lines.error(
                format!("pose {}", records.len() + 1),
                format!(
                    "{} poses, one per time of {}",
                    times_s.len(),
                    times_path.display()
                ),
            ));
        };
        records.push(PoseRecord::new(*time_s, upright(pose)));
    }
    if records.is_empty() {
        return Err(nothing_in(input.path(), "pose"));
    }
    if times.next().is_some() {
        let found = format!("{} poses", records.len());
        let expected = format!(
            "{}, one per time of {}",
            times_s.len(),
            times_path.display()
        );
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    }
    Ok(records)
}

/// Possible paths of the times of a pose file, in the order of the search.
fn candidate_times_paths(poses: &Path) -> [PathBuf; 3] {
    let folder = poses.parent().unwrap_or(Path::new(""));
    let above = folder.join("..");
    let sequence = poses.file_stem().unwrap_or_default();
    [
        folder.join("times.txt"),
        above.join("times.txt"),
        above.join("sequences").join(sequence).join("times.txt"),
    ]
}

/// The record files beside a `timestamps.txt`.
fn record_files(times: &Path) -> Vec<PathBuf> {
    let folder = times.parent().unwrap_or(Path::new("")).join("data");
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut records: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    records.sort();
    records
}

/// The file of times of a pose file, and its times in seconds.
fn times(poses: &Path) -> Result<(PathBuf, Vec<f64>)> {
    let candidates = candidate_times_paths(poses);
    let Some(path) = candidates.iter().find(|candidate| candidate.is_file()) else {
        let candidates = candidates
            .map(|candidate| candidate.display().to_string())
            .join(" or ");
        return Err(Error::format(
            poses,
            Location::Whole,
            "poses without times",
            format!("a file with one time in seconds per pose: {candidates}"),
        ));
    };
    let mut lines = Lines::open(&Input::from(path))?;
    let (mut cells, mut times_s) = (Vec::with_capacity(1), Vec::new());
    let expected = || "one time in seconds".to_owned();
    while lines.next_numbers(&mut cells, |n| n == 1, expected)? {
        let time_s = cells[0];
        if let Some(last_s) = times_s.last().filter(|last_s| time_s <= **last_s) {
            let found = format!("time {time_s} s after {last_s} s");
            return Err(lines.error(found, "times that increase"));
        }
        times_s.push(time_s);
    }
    Ok((path.clone(), times_s))
}

/// The `oxts` folder of a drive; `folder` itself if it has no such folder.
fn oxts_folder(folder: &Path) -> PathBuf {
    let inner = folder.join("oxts");
    if inner.is_dir() {
        inner
    } else {
        folder.to_owned()
    }
}

/// Reads the IMU of a raw drive. `folder` is the folder of the drive or its `oxts` folder, with
/// `timestamps.txt` and, for each of its lines, a file of 30 numbers such as `data/0000000000.txt`. The
/// body has x forward, y left and z up; the specific force includes gravity.
///
/// Times are seconds of the Unix epoch if the computer that recorded them had UTC: time stamps have
/// a date, but no time zone. A double resolves them to 0.2 µs.
///
/// # Errors
/// Missing files, more records than time stamps, records without 30 finite numbers, lines without a
/// date and a time, no records.
pub fn read_imu(folder: &Path) -> Result<Vec<ImuSample>> {
    let oxts = oxts_folder(folder);
    let path = oxts.join("timestamps.txt");
    let mut lines = Lines::open(&Input::from(&path))?;
    let record = |index: usize| oxts.join("data").join(format!("{index:010}.txt"));
    let mut samples = Vec::new();
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() {
            continue;
        }
        let Some(time_s) = time_s(text) else {
            let found: String = text.chars().take(80).collect();
            let expected = "a time stamp, `2011-09-26 13:02:25.964389445`";
            return Err(lines.error(format!("`{found}`"), expected));
        };
        let values = oxts_record(&record(samples.len()))?;
        let vector = |at: usize| Vec3::new(values[at], values[at + 1], values[at + 2]);
        samples.push(ImuSample {
            time_s,
            gyro_rad_s: vector(GYRO),
            accel_m_s2: vector(ACCEL),
        });
    }
    if samples.is_empty() {
        return Err(nothing_in(&path, "time stamp"));
    }
    if record(samples.len()).exists() {
        let found = format!("{} time stamps", samples.len());
        let expected = format!(
            "more: there is a record {}",
            record(samples.len()).display()
        );
        return Err(Error::format(&path, Location::Whole, found, expected));
    }
    Ok(samples)
}

/// The numbers of one record.
fn oxts_record(path: &Path) -> Result<[f64; OXTS]> {
    let mut lines = Lines::open(&Input::from(path))?;
    let mut cells = Vec::with_capacity(OXTS);
    let expected = || format!("{OXTS} finite numbers");
    if !lines.next_numbers(&mut cells, |n| n == OXTS, expected)? {
        return Err(nothing_in(path, "record"));
    }
    let mut values = [0.0; OXTS];
    values.copy_from_slice(&cells);
    if lines.next_numbers(&mut cells, |n| n == OXTS, expected)? {
        return Err(lines.error("a second record", "one record per file"));
    }
    Ok(values)
}

/// The seconds from 1970-01-01 to `2011-09-26 13:02:25.964389445`.
fn time_s(text: &str) -> Option<f64> {
    let (date, time) = text.split_once([' ', 'T'])?;
    let mut date = date.splitn(3, '-').map(|part| part.parse::<u32>().ok());
    let mut next = || date.next().flatten().map(i64::from);
    let days = days_since_1970(next()?, next()?, next()?)?;
    let mut time = time.splitn(3, ':');
    let (hour, minute) = (time.next()?.parse().ok()?, time.next()?.parse().ok()?);
    let second = time
        .next()
        .filter(|s| s.starts_with(|c: char| c.is_ascii_digit()))?;
    let second_s = second_of_day(hour, minute, second.parse().ok()?)?;
    Some(days as f64 * DAY_S + second_s)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::format::mutation::for_each_damaged;

    fn cells(line: &str) -> Vec<f64> {
        line.split_whitespace()
            .filter_map(|cell| cell.parse().ok())
            .collect()
    }

    const POSES: &str = "1.000000e+00 0 0 0 0 1 0 0 0 0 1 0\n\
        9.999e-01 -1.414e-02 0 1.5 1.414e-02 9.999e-01 0 -2.5 0 0 1 3.5\n\
        0 -1 0 4 1 0 0 5 0 0 1 6\n";
    const TIMES: &str = "0.000000e+00\n1.036224e-01\n2.0e-01\n";
    const STAMPS: &str = "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:25.974389445\n";

    fn poses(poses: &str, times: &str, place: &str) -> Result<Vec<PoseRecord>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses/07.txt");
        let times_path = dir.path().join(place);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::create_dir_all(times_path.parent().unwrap()).unwrap();
        fs::write(&path, poses).unwrap();
        fs::write(times_path, times).unwrap();
        read_poses(&Input::from(&path))
    }

    fn oxts(folder: &Path, stamps: &str, records: &[String]) -> Result<Vec<ImuSample>> {
        let data = folder.join("oxts/data");
        fs::create_dir_all(&data).unwrap();
        fs::write(folder.join("oxts/timestamps.txt"), stamps).unwrap();
        for (i, record) in records.iter().enumerate() {
            fs::write(data.join(format!("{i:010}.txt")), record).unwrap();
        }
        read_imu(folder)
    }

    /// A record that holds 0, 1, 2, … plus `offset`.
    fn record(offset: f64) -> String {
        let cells: Vec<String> = (0..OXTS).map(|i| (i as f64 + offset).to_string()).collect();
        cells.join(" ") + "\n"
    }

    #[test]
    fn poses_are_rows_of_a_matrix_with_times_from_beside_above_or_the_sequence() {
        for place in ["poses/times.txt", "times.txt", "sequences/07/times.txt"] {
            let found = poses(POSES, TIMES, place).unwrap();
            assert_eq!(found.len(), 3, "{place}");
            assert_eq!(found[1].time_s, 0.103_622_4);
            let turned = found[2].world_from_body;
            assert_eq!(turned.translation_m, Vec3::new(4.0, 6.0, -5.0));
            // The y axis of the file is down.
            assert!((turned.rotation * Vec3::x() + Vec3::z()).norm() < 1e-15);
            let rounded = found[1].world_from_body;
            let angle = 1.414e-2_f64.atan2(0.9999);
            let about_z = upright(WorldFromBody::identity()).rotation.inverse() * rounded.rotation;
            assert!((about_z.scaled_axis() - Vec3::z() * angle).norm() < 1e-12);
            assert_eq!(rounded.translation_m, Vec3::new(1.5, 3.5, 2.5));
        }
        let first = POSES.lines().next().unwrap();
        assert!(looks_like_poses(&cells(first)));
        for other in [
            "1 2 3 4 5 6 7 8 9 10 11 12",
            "1 0 0 0",
            "",
            "nan ".repeat(12).as_str(),
        ] {
            assert!(!looks_like_poses(&cells(other)), "{other}");
        }
    }

    #[test]
    fn errors_of_poses_name_the_place_and_the_remedy() {
        let text = |p: &str, t: &str, place: &str| poses(p, t, place).unwrap_err().to_string();
        let e = text(POSES, TIMES, "poses/other.txt");
        assert!(
            e.contains("found poses without times, expected a file with one time"),
            "{e}"
        );
        assert!(e.contains("sequences/07/times.txt"), "{e}");
        let e = text(POSES, "0\n1\n", "times.txt");
        assert!(
            e.contains("line 3: found pose 3, expected 2 poses, one per time"),
            "{e}"
        );
        let e = text(POSES, "0\n1\n2\n3\n", "times.txt");
        assert!(
            e.contains("found 3 poses, expected 4, one per time of"),
            "{e}"
        );
        let e = text(POSES, "0\n1\n1\n", "times.txt");
        assert!(
            e.contains("times.txt, line 3: found time 1 s after 1 s"),
            "{e}"
        );
        let e = text(&POSES.replace("0 -1 0 4", "0 1 0 4"), TIMES, "times.txt");
        assert!(
            e.contains("line 3: found columns that are not perpendicular"),
            "{e}"
        );
        let e = text(&POSES.replace(" 6\n", "\n"), TIMES, "times.txt");
        assert!(
            e.contains("line 3: found `0 -1 0 4 1 0 0 5 0 0 1`, expected 12 finite"),
            "{e}"
        );
        assert!(text("\n", TIMES, "times.txt").contains("no pose"));
    }

    #[test]
    fn oxts_records_give_the_body_axes_with_nanosecond_times() {
        let dir = tempfile::tempdir().unwrap();
        let records = [record(0.0), record(0.5)];
        let samples = oxts(dir.path(), STAMPS, &records).unwrap();
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[0].accel_m_s2, Vec3::new(11.0, 12.0, 13.0));
        assert_eq!(samples[1].gyro_rad_s, Vec3::new(17.5, 18.5, 19.5));
        assert_eq!(
            samples[0].time_s,
            "1317042145.964389445".parse::<f64>().unwrap()
        );
        assert_eq!(read_imu(&dir.path().join("oxts")).unwrap(), samples);
    }

    #[test]
    fn errors_of_oxts_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let text = |stamps: &str, records: &[String]| {
            oxts(dir.path(), stamps, records).unwrap_err().to_string()
        };
        assert!(text(STAMPS, &[record(0.0)]).contains("0000000001.txt"));
        let short = record(0.0).replace(" 29", "");
        let e = text(STAMPS, &[record(0.0), short]);
        assert!(
            e.contains("0000000001.txt, line 1") && e.contains("30 finite numbers"),
            "{e}"
        );
        let e = text(STAMPS, &[record(0.0), record(1.0) + &record(2.0)]);
        assert!(e.contains("line 2: found a second record"), "{e}");
        let e = text(STAMPS.lines().next().unwrap(), &[record(0.0), record(1.0)]);
        assert!(e.contains("found 1 time stamps, expected more"), "{e}");
        for bad in [
            "2011-09-31 13:02:25",
            "2011-09-26 13:02",
            "2011-09-26 13:02:-0",
            "x y",
            "-",
        ] {
            let e = text(bad, &[record(0.0)]);
            assert!(e.contains("timestamps.txt, line 1: found `"), "{e}");
        }
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let dir = tempfile::tempdir().unwrap();
        let (path, times) = (dir.path().join("07.txt"), dir.path().join("times.txt"));
        fs::write(&times, TIMES).unwrap();
        for_each_damaged(&path, POSES.as_bytes(), 2000, || {
            drop(read_poses(&Input::from(&path)))
        });
        fs::write(&path, POSES).unwrap();
        for_each_damaged(&times, TIMES.as_bytes(), 1000, || {
            drop(read_poses(&Input::from(&path)))
        });
        oxts(dir.path(), STAMPS, &[record(0.0), record(1.0)]).unwrap();
        let stamps = dir.path().join("oxts/timestamps.txt");
        for_each_damaged(&stamps, STAMPS.as_bytes(), 2000, || {
            drop(read_imu(dir.path()))
        });
        fs::write(&stamps, STAMPS).unwrap();
        let first = dir.path().join("oxts/data/0000000000.txt");
        let valid = record(0.0);
        for_each_damaged(&first, valid.as_bytes(), 2000, || {
            drop(read_imu(dir.path()))
        });
    }

    #[test]
    fn companion_files_are_listed() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            path
        };
        fs::write(at("poses/07.txt"), POSES).unwrap();
        let found = crate::format::files_of(&at("poses/07.txt"));
        let places = [
            "poses/07.txt",
            "poses/times.txt",
            "poses/../times.txt",
            "poses/../sequences/07/times.txt",
        ];
        assert_eq!(found, places.map(|place| dir.path().join(place)));

        fs::write(at("oxts/timestamps.txt"), STAMPS).unwrap();
        let records = ["oxts/data/0000000000.txt", "oxts/data/0000000001.txt"];
        for record in records.iter().rev() {
            fs::write(at(record), "").unwrap();
        }
        let found = crate::format::files_of(&at("oxts/timestamps.txt"));
        let expected = ["oxts/timestamps.txt", records[0], records[1]];
        assert_eq!(found, expected.map(|place| dir.path().join(place)));
    }
}
