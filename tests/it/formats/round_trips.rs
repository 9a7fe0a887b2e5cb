//! Written files are read back exactly, or within the rounding of their format.

use boresight::format::*;
use boresight::geometry::{Rotation, Vec3, WorldFromBody};
use boresight::sensor::*;

use crate::common::samples::*;

#[test]
fn logs_are_read_back_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.csv");
    let imu: Vec<_> = (0..500)
        .map(|i| ImuSample {
            time_s: 1.7e9 + i as f64 * 0.01,
            gyro_rad_s: vector(i, 0),
            accel_m_s2: vector(i, 3) * 10.0,
        })
        .collect();
    write_imu(&path, &imu).unwrap();
    assert_eq!(read_imu(&path).unwrap(), imu);

    for with_sigma in [false, true] {
        let prism: Vec<_> = (0..50)
            .map(|i| {
                PositionFix::with_sigma(
                    i as f64 / 7.0,
                    vector(i, 0) * 1e6,
                    (with_sigma && i % 3 == 0).then_some(0.005),
                )
            })
            .collect();
        write_positions(&path, &prism).unwrap();
        let read = read_positions(&path, &Observations::AsFound).unwrap();
        assert_eq!(read.fixes, prism);
        let heading: Vec<_> = (0..50)
            .map(|i| {
                HeadingFix::new(
                    i as f64 / 5.0,
                    noise(i, 0) * 3.0,
                    (with_sigma && i % 3 == 0).then_some(0.0125),
                )
            })
            .collect();
        write_heading(&path, &heading).unwrap();
        for (a, b) in read_heading(&path).unwrap().iter().zip(&heading) {
            // Converted to degrees and back: two roundings.
            assert!((a.heading_rad - b.heading_rad).abs() < 2e-15);
            assert_eq!(a.sigma_rad.is_some(), b.sigma_rad.is_some());
            assert_eq!(a.time_s, b.time_s);
        }
    }
}

fn some_poses(full: impl Fn(usize) -> bool) -> Vec<PoseRecord> {
    (0..40)
        .map(|i| PoseRecord {
            time_s: 100.0 + i as f64 * 0.01,
            world_from_body: WorldFromBody::new(
                Rotation::from_scaled_axis(vector(i, 0) * 2.0),
                vector(i, 3),
            ),
            velocity_m_s: full(i).then(|| vector(i, 6)),
            bias: full(i).then(|| ImuBias {
                gyro_rad_s: vector(i, 9),
                accel_m_s2: vector(i, 12),
            }),
            sigma: full(i).then(|| PoseSigma {
                position_m: vector(i, 15).abs(),
                rotation_rad: vector(i, 18).abs(),
            }),
        })
        .collect()
}

#[test]
fn trajectories_are_read_back_bit_for_bit_with_all_columns() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("trajectory.csv");
    for poses in [
        some_poses(|_| false),
        some_poses(|_| true),
        some_poses(|i| i % 2 == 0),
    ] {
        write_trajectory(&path, &poses).unwrap();
        assert_eq!(read_trajectory(&path).unwrap(), poses);
    }
}

#[test]
fn trajectories_of_bonn_and_tum_are_distinguished_by_their_number_of_columns() {
    let dir = tempfile::tempdir().unwrap();
    let trj = dir.path().join("a.trj");
    std::fs::write(
        &trj,
        "# t x y z v rpy ba bw\n10.5 1 2 3 0.1 0.2 0.3 0.01 0.02 1.5 1 2 3 4 5 6\n",
    )
    .unwrap();
    let record = read_trajectory(&trj).unwrap()[0];
    assert_eq!(record.time_s, 10.5);
    assert_eq!(record.velocity_m_s, Some(Vec3::new(0.1, 0.2, 0.3)));
    let bias = record.bias.unwrap();
    assert_eq!(bias.accel_m_s2, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!(bias.gyro_rad_s, Vec3::new(4.0, 5.0, 6.0));
    // R = Rz(1.5) Ry(0.02) Rx(0.01): its first column is the body's x axis.
    let x = record.world_from_body.rotation * Vec3::x();
    let expected = Vec3::new(
        1.5f64.cos() * 0.02f64.cos(),
        1.5f64.sin() * 0.02f64.cos(),
        -0.02f64.sin(),
    );
    assert!((x - expected).norm() < 1e-15);

    let tum = dir.path().join("a.txt");
    std::fs::write(&tum, "# t x y z q\n1 4 5 6 0 0 0.6 0.8\n2 4 5 6 0 0 0 1\n").unwrap();
    let poses = read_trajectory(&tum).unwrap();
    assert_eq!(poses.len(), 2);
    assert!((poses[0].world_from_body.rotation.k - 0.6).abs() < 1e-15);
    std::fs::write(&tum, "1 4 5 6 0 0 0.6 0.9\n").unwrap();
    let error = read_trajectory(&tum).unwrap_err().to_string();
    assert!(
        error.contains("line 1: found a quaternion of length 1.08"),
        "{error}"
    );
}

#[test]
fn errors_of_incomplete_logs_name_the_line() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("prism.csv");
    let header = "time_s,east_m,north_m,up_m,sigma_m\n";
    for (rows, expected) in [
        ("1,2,3,NaN,0.005\n", "line 2: found `NaN` in column up_m"),
        ("nan,2,3,4,0.005\n", "line 2: found `nan` in column time_s"),
        ("1,2,3,4,-1\n", "line 2: found sigma_m = -1"),
        ("", "found no position"),
    ] {
        std::fs::write(&path, format!("{header}{rows}")).unwrap();
        let error = read_positions(&path, &Observations::AsFound)
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
    let missing = read_positions(&dir.path().join("none.csv"), &Observations::AsFound)
        .unwrap_err()
        .to_string();
    assert!(missing.contains("none.csv"), "{missing}");
    std::fs::write(&path, "").unwrap();
    assert!(
        read_positions(&path, &Observations::AsFound)
            .unwrap_err()
            .to_string()
            .contains("an empty file")
    );
    assert!(
        read_positions(dir.path(), &Observations::AsFound)
            .unwrap_err()
            .to_string()
            .contains("a folder")
    );
}

#[test]
fn recordings_are_read_back_within_half_a_step() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("left.bin");
    let written = write_recording(&path, 3000);
    let read = all_points(&path).unwrap();
    assert_eq!(read.len(), written.len());
    let mut worst = 0.0f64;
    for (a, b) in read.iter().zip(&written) {
        assert_eq!((a.time_s, a.intensity), (b.time_s, b.intensity));
        worst = worst.max((a.position_m - b.position_m).amax());
    }
    // Profiles here are at most 2.3 m wide: steps of 2.3 m / 65534 = 35 µm.
    assert!(worst < 17.6e-6, "{worst}");
    assert!(
        worst > 1e-6,
        "the file stores 16 bits per coordinate, {worst}"
    );
}

#[test]
fn profiles_as_text_are_read_back_bit_for_bit_in_chunks() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("left.csv");
    let points: Vec<_> = (0..250_000)
        .map(|i| ScanPoint {
            time_s: (i / 100) as f64 * 0.005,
            position_m: vector(i, 0),
            intensity: (i % 256) as f32,
        })
        .collect();
    write_profiles(&path, &points).unwrap();
    assert_eq!(all_points(&path).unwrap(), points);
    std::fs::write(&path, "time_s x_m z_m\n1 2 3\n0.5 2 3\n").unwrap();
    let error = all_points(&path).unwrap_err().to_string();
    assert!(
        error.contains("line 3: found time 0.5 s after 1 s"),
        "{error}"
    );
}

#[test]
fn written_clouds_are_exact_to_a_hundredth_of_a_millimetre() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["cloud.las", "cloud.laz"] {
        let path = dir.path().join(name);
        let written = write_cloud(&path, 1_150_000);
        let again = dir.path().join(format!("again-{name}"));
        write_cloud(&again, 1_150_000);
        assert_eq!(
            std::fs::read(&path).unwrap(),
            std::fs::read(&again).unwrap()
        );
        // Parts read in parallel give the same points as the file read in order.
        let cloud = read_cloud(&path).unwrap();
        assert_eq!(cloud.points.len(), written.len());
        let streamed = all_points(&path).unwrap();
        for (i, point) in streamed.iter().enumerate() {
            assert_eq!(cloud.points[i], point.position_m);
            assert_eq!(
                (cloud.time_s[i], cloud.intensity[i]),
                (point.time_s, point.intensity)
            );
        }
        let read = streamed;
        assert_eq!(read.len(), written.len());
        for (a, (point, time_s)) in read.iter().zip(&written) {
            assert_eq!((a.time_s, a.intensity), (*time_s, 130.0));
            // Half a step, and the rounding of northings in f64.
            assert!((a.position_m - point).amax() < 0.5e-5 + 2e-9);
        }
    }
    let mut writer = CloudWriter::create(&dir.path().join("far.laz"), Vec3::zeros()).unwrap();
    for x in [30_000.0, f64::NAN] {
        let error = writer
            .write(&Vec3::new(x, 0.0, 0.0), 1.0, 0.0, 1)
            .unwrap_err();
        assert!(error.to_string().contains("21475 m"), "{error}");
    }
    assert!(CloudWriter::create(&dir.path().join("cloud.xyz"), Vec3::zeros()).is_err());
}
