use std::path::{Path, PathBuf};

use super::*;
use crate::format::mutation::for_each_damaged;
use crate::format::{inspect, read_projected_trajectory, read_trajectory, write_sbet};
use crate::geometry::attitude::{from_roll_pitch_heading, roll_pitch_heading};
use crate::geometry::{BodyAxes, Projection, Rotation, WorldFromBody, heading::wrap, so3};
use crate::sensor::PoseRecord;

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sbet");
    (folder, path)
}

fn read_sbet(input: impl Into<Input>, system: &Projection) -> Result<Vec<PoseRecord>> {
    read_projected_trajectory(input, BodyAxes::Flu, Some(system))
}

fn write(path: &Path, rows: &[[f64; 17]]) {
    let bytes: Vec<u8> = rows
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    std::fs::write(path, bytes).unwrap();
}

/// Two records of a real file, as listed in PDAL's test of its SBET reader (BSD licence), in radians.
const REAL: [[f64; 17]; 2] = [
    [
        151631.002836071,
        0.5680211852972264,
        -2.04165439230394,
        107.715295329656,
        -2.332420866600025,
        -0.3335067504871401,
        -0.03093961631767838,
        -0.02813407149321339,
        -0.02429905393889139,
        3.046773230278662,
        -0.02198414736922658,
        0.785963973775239,
        0.7849084719295495,
        -0.2978807916450262,
        6.226807982589819e-05,
        0.009312162756440178,
        0.07217812320996525,
    ],
    [
        151631.0078318641,
        0.5680211834722869,
        -2.041654392034053,
        107.7151424357507,
        -2.336228229691271,
        -0.3324663118952635,
        -0.03022948961008987,
        -0.02813856631423094,
        -0.02425215669392169,
        3.047131105236811,
        -0.02198416007932108,
        0.8397590491636475,
        0.3252165276637165,
        -0.1558883225990844,
        0.0008379685112283802,
        0.007372886784718076,
        0.07179027672314571,
    ],
];

/// A real file was written without our conventions: its positions, velocities and rates agree only if
/// our signs are right.
#[test]
fn motion_in_a_real_file_agrees_with_its_velocities_and_rates() {
    let (_folder, path) = folder();
    write(&path, &REAL);
    let system = Projection::new("EPSG:32611").unwrap();
    let poses = read_sbet(&path, &system).unwrap();
    let (a, b) = (&poses[0], &poses[1]);
    let dt = b.time_s - a.time_s;
    let moved = (b.world_from_body.translation_m - a.world_from_body.translation_m) / dt;
    let velocity = (a.velocity_m_s.unwrap() + b.velocity_m_s.unwrap()) * 0.5;
    // Over 5 ms, filtering moves positions by 0.1 mm; a wrong sign of the wander angle, of y or of z
    // would cause 0.06 to 0.7 m/s.
    assert!((moved - velocity).norm() < 0.03, "{moved} {velocity}");
    let (from, to) = (a.world_from_body.rotation, b.world_from_body.rotation);
    let rate = so3::log(&(from.inverse() * to)) / dt;
    // The rates of a record are those since the previous record.
    let expected = Vec3::new(REAL[1][14], -REAL[1][15], -REAL[1][16]);
    assert!((rate - expected).norm() < 1e-4, "{rate} {expected}");
}

#[test]
fn headings_refer_to_grid_north() {
    let (_folder, path) = folder();
    let mut row = REAL[0];
    (row[7], row[8], row[9], row[10]) = (0.1, -0.2, 1.0, 0.3);
    write(&path, &[row]);
    let system = Projection::new("EPSG:32611").unwrap();
    let pose = read_sbet(&path, &system).unwrap()[0];
    let point = system.project(row[1], row[2]).unwrap();
    assert!(point.convergence_rad.abs() > 1e-4);
    let angles = roll_pitch_heading(&pose.world_from_body.rotation);
    let expected = [0.1, -0.2, 0.7 - point.convergence_rad];
    for (angle, expected) in angles.iter().zip(expected) {
        assert!((angle - expected).abs() < 1e-14, "{angle} {expected}");
    }
    assert_eq!(pose.world_from_body.translation_m.z, row[3]);
}

/// `tests/data/sbet/scipy.sbet` with `scipy.csv` (time, east, north, up, qx, qy, qz, qw, velocity):
/// made by pyproj 3.7.2 and scipy 1.17.1 from random records.
#[test]
fn poses_agree_with_pyproj_and_scipy() {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/data/sbet/scipy.sbet"
    ));
    let table = include_str!("../../../../../../tests/data/sbet/scipy.csv");
    let system = Projection::new("EPSG:25832").unwrap();
    let poses = read_sbet(path, &system).unwrap();
    assert_eq!(poses.len(), table.lines().count());
    for (pose, line) in poses.iter().zip(table.lines()) {
        let v: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        assert_eq!(pose.time_s, v[0]);
        let off = pose.world_from_body.translation_m - Vec3::new(v[1], v[2], v[3]);
        assert!(off.norm() < 1e-6, "{off}");
        let rotation = Rotation::new_normalize(nalgebra::Quaternion::new(v[7], v[4], v[5], v[6]));
        assert!(pose.world_from_body.rotation.angle_to(&rotation) < 1e-8);
        let off = pose.velocity_m_s.unwrap() - Vec3::new(v[8], v[9], v[10]);
        assert!(off.norm() < 1e-6, "{off}");
    }
}

fn drive(start: Vec3) -> Vec<PoseRecord> {
    let pose = |i: u32| {
        let s = f64::from(i) * 0.01;
        let rotation = Rotation::from_euler_angles(0.3 * s.sin(), 0.2 * (2.0 * s).cos(), 3.0 * s);
        let position = start + Vec3::new(20.0 * s.cos(), 15.0 * s.sin(), 0.4 * (3.0 * s).sin());
        PoseRecord::new(1000.0 + s, WorldFromBody::new(rotation, position))
    };
    (0..800).map(pose).collect()
}

#[test]
fn written_poses_are_read_back() {
    let (_folder, path) = folder();
    for (name, start) in [
        ("EPSG:25832", Vec3::new(364_000.0, 5_621_000.0, 110.0)),
        ("EPSG:32756", Vec3::new(700_000.0, 6_200_000.0, 5.0)),
        ("EPSG:2154", Vec3::new(300_000.0, 6_700_000.0, -20.0)),
    ] {
        let system = Projection::new(name).unwrap();
        let poses = drive(start);
        write_sbet(&path, &poses, &system).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let read = read_sbet(&path, &system).unwrap();
        assert_eq!(read.len(), poses.len());
        for (read, pose) in read.iter().zip(&poses) {
            let (r, d) = read
                .world_from_body
                .perturbation_from(&pose.world_from_body);
            assert!(d.norm() < 1e-5 && r.norm() < 1e-11, "{name}: {d} {r}");
            assert_eq!(read.time_s, pose.time_s);
        }
        // The writer takes central differences over 20 ms as well.
        for pair in read.windows(3) {
            let moved =
                pair[2].world_from_body.translation_m - pair[0].world_from_body.translation_m;
            let velocity = moved / (pair[2].time_s - pair[0].time_s);
            let off = pair[1].velocity_m_s.unwrap() - velocity;
            assert!(off.norm() < 1e-5, "{off}");
        }
        // Writing again gives the same bytes, and the file is detected by its content.
        write_sbet(&path, &poses, &system).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
        assert_eq!(inspect(&path).unwrap().format.id(), "sbet");
    }
}

#[test]
fn velocities_and_rates_are_in_the_axes_of_the_format() {
    let (_folder, path) = folder();
    let system = Projection::new("EPSG:25832").unwrap();
    // A right turn at 2 m/s and 0.5 rad/s, initially towards grid north, climbing at 0.1 m/s.
    let pose = |i: i32| {
        let s = f64::from(i) * 0.01;
        let turn = 0.5 * s;
        let rotation = from_roll_pitch_heading(0.0, 0.0, turn);
        let position = Vec3::new(4.0 - 4.0 * turn.cos(), 4.0 * turn.sin(), 0.1 * s);
        let start = Vec3::new(364_000.0, 5_621_000.0, 0.0);
        PoseRecord::new(100.0 + s, WorldFromBody::new(rotation, start + position))
    };
    let poses: Vec<_> = (-5..=5).map(pose).collect();
    write_sbet(&path, &poses, &system).unwrap();
    let mut rows = Vec::new();
    for_each(&Input::from(&path), |row| rows.push(*row)).unwrap();
    let middle = rows[5];
    let point = system.project(middle[1], middle[2]).unwrap();
    let gamma = point.convergence_rad;
    let speed = 2.0 / point.scale;
    // y points west: a negative azimuth is west of north.
    assert!(gamma < -1e-3);
    for (column, expected) in [
        (4, speed * gamma.cos()),
        (5, -speed * gamma.sin()),
        (6, 0.1),
        (9, gamma),
        (10, 0.0),
        // The acceleration is to the right.
        (12, speed * 0.5),
        (16, 0.5),
    ] {
        let off = wrap(middle[column] - expected).abs();
        assert!(
            off < 1e-4,
            "{}: {} {expected}",
            COLUMNS[column],
            middle[column]
        );
    }
}

#[test]
fn a_single_pose_is_written_and_invalid_poses_are_refused() {
    let (_folder, path) = folder();
    let system = Projection::new("EPSG:25832").unwrap();
    let mut poses = drive(Vec3::new(364_000.0, 5_621_000.0, 110.0));
    write_sbet(&path, &poses[..1], &system).unwrap();
    let single = read_sbet(&path, &system).unwrap();
    assert_eq!(single[0].velocity_m_s, Some(Vec3::zeros()));
    std::fs::remove_file(&path).unwrap();
    let refused = |poses: &[PoseRecord], expected: &str| {
        let error = write_sbet(&path, poses, &system).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
        assert!(!path.exists());
    };
    poses[3].time_s = poses[2].time_s;
    refused(&poses, "pose at 1000.02 s: it follows 1000.02 s");
    refused(
        &[PoseRecord::new(f64::NAN, poses[0].world_from_body)],
        "NaN",
    );
    let elsewhere = drive(Vec3::new(5e5, 1e8, 0.0));
    refused(&elsewhere, "is outside EPSG:25832");
    let mut high = poses[0];
    high.world_from_body.translation_m.z = f64::INFINITY;
    refused(&[high], "not finite");
}

#[test]
fn a_repeated_record_is_left_out_and_said() {
    let (_folder, path) = folder();
    let system = Projection::new("EPSG:32611").unwrap();
    write(&path, &[REAL[0], REAL[0]]);
    let input = Input::from(&path);
    assert_eq!(read_sbet(&input, &system).unwrap().len(), 1);
    let remarks = input.remarks().join("\n");
    assert!(remarks.contains("1 of 2 poses left out"), "{remarks}");
}

#[test]
fn errors_name_the_byte() {
    let (_folder, path) = folder();
    let system = Projection::new("EPSG:32611").unwrap();
    let failed = |rows: &[[f64; 17]], expected: &str| {
        write(&path, rows);
        let error = read_sbet(&path, &system).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    let mut degrees = REAL[1];
    degrees[1] = degrees[1].to_degrees();
    failed(&[REAL[0], degrees], "byte 136: found latitude 1864");
    let mut elsewhere = REAL[1];
    elsewhere[2] = 0.1;
    failed(
        &[elsewhere],
        "a.sbet: position at 151631.0078318641 s: latitude 32.5",
    );
    let mut missing = REAL[1];
    missing[9] = f64::NAN;
    failed(
        &[REAL[0], missing],
        "byte 208: found platform_heading_rad = NaN",
    );
    std::fs::write(&path, [0; 200]).unwrap();
    let error = read_sbet(&path, &system).unwrap_err().to_string();
    assert!(
        error.contains("an SBET record") || error.contains("EPSG"),
        "{error}"
    );
    // Without a system, SBET cannot be read as a trajectory.
    write(&path, &REAL);
    let error = read_trajectory(&path).unwrap_err().to_string();
    assert!(error.contains("`crs` in [frame]"), "{error}");
}

#[test]
fn damaged_files_are_refused_or_read() {
    let (_folder, path) = folder();
    let system = Projection::new("EPSG:32611").unwrap();
    let valid: Vec<u8> = REAL
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let (mut read, mut refused) = (0, 0);
    for_each_damaged(&path, &valid, 3000, || match read_sbet(&path, &system) {
        Ok(_) => read += 1,
        Err(_) => refused += 1,
    });
    assert!(read > 100 && refused > 100, "{read} {refused}");
}
