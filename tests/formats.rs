//! Files that others wrote, round trips of all that is written here, and damaged files.

mod common;

use std::path::Path;

use boresight::format::*;
use boresight::geometry::{Rotation, Vec3, pose, transform};
use boresight::sensor::*;
use boresight::trajectory::Trajectory;
use common::shared_data;

fn all_points(path: &Path) -> boresight::Result<Vec<ScanPoint>> {
    let mut reader = open_profiles(path)?;
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk)? {
        assert!(!chunk.is_empty() && chunk.len() <= 270_000);
        all.extend_from_slice(&chunk);
    }
    assert!(chunk.is_empty());
    assert_eq!(reader.bytes_read(), reader.bytes_total());
    Ok(all)
}

/// Numbers without pattern, the same in every run.
fn noise(i: usize, k: usize) -> f64 {
    let mut x = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (k as u64 + 1) << 32;
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
}

fn vector(i: usize, k: usize) -> Vec3 {
    Vec3::new(noise(i, k), noise(i, k + 1), noise(i, k + 2))
}

#[test]
fn logs_return_bit_by_bit() {
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
            .map(|i| PrismFix {
                time_s: i as f64 / 7.0,
                position_m: vector(i, 0) * 1e6,
                sigma_m: (with_sigma && i % 3 == 0).then_some(0.005),
            })
            .collect();
        write_prism(&path, &prism).unwrap();
        assert_eq!(read_prism(&path).unwrap(), prism);
        let heading: Vec<_> = (0..50)
            .map(|i| HeadingFix {
                time_s: i as f64 / 5.0,
                heading_rad: noise(i, 0) * 3.0,
                sigma_rad: (with_sigma && i % 3 == 0).then_some(0.0125),
            })
            .collect();
        write_heading(&path, &heading).unwrap();
        for (a, b) in read_heading(&path).unwrap().iter().zip(&heading) {
            // Degrees and back round twice.
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
            world_from_body: pose(Rotation::from_scaled_axis(vector(i, 0) * 2.0), vector(i, 3)),
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
fn trajectories_return_bit_by_bit_with_all_they_carry() {
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
fn trajectories_of_bonn_and_tum_are_told_apart_by_their_width() {
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
fn logs_with_holes_in_them_are_errors_that_name_the_line() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("prism.csv");
    let header = "time_s,east_m,north_m,up_m,sigma_m\n";
    for (rows, expected) in [
        (
            "1,2,3,4,0.005\n1,2,3,4,0.005\n",
            "line 3: found time 1 s after 1 s",
        ),
        ("1,2,3,NaN,0.005\n", "line 2: found `NaN` in column up_m"),
        ("nan,2,3,4,0.005\n", "line 2: found `nan` in column time_s"),
        ("1,2,3,4,-1\n", "line 2: found sigma_m = -1"),
        ("", "found no prism position"),
    ] {
        std::fs::write(&path, format!("{header}{rows}")).unwrap();
        let error = read_prism(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let missing = read_prism(&dir.path().join("none.csv"))
        .unwrap_err()
        .to_string();
    assert!(missing.contains("none.csv"), "{missing}");
    std::fs::write(&path, "").unwrap();
    assert!(
        read_prism(&path)
            .unwrap_err()
            .to_string()
            .contains("an empty file")
    );
    assert!(
        read_prism(dir.path())
            .unwrap_err()
            .to_string()
            .contains("a folder")
    );
}

/// A recording of `profiles` profiles with 160 rays, a third of them blind.
fn write_recording(path: &Path, profiles: usize) -> Vec<ScanPoint> {
    let mut writer = BonnWriter::create(path).unwrap();
    let mut written = Vec::new();
    for i in 0..profiles {
        let time_s = 1000.0 + i as f64 * 0.005;
        let rays: Vec<_> = (0..160)
            .map(|j| {
                let z = -1.2 + 0.5 * noise(i, j);
                let x = z * (j as f64 - 80.0) / 120.0;
                (j % 3 != 0).then_some((x, z, j as u8))
            })
            .collect();
        writer.write_profile(time_s, &rays).unwrap();
        written.extend(rays.into_iter().flatten().map(|(x, z, shade)| ScanPoint {
            time_s,
            position_m: Vec3::new(x, 0.0, z),
            intensity: f32::from(shade),
        }));
    }
    writer.finish().unwrap();
    written
}

#[test]
fn recordings_return_within_half_a_step() {
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
    assert!(worst > 1e-6, "the file holds 16 bits a coordinate, {worst}");
}

#[test]
fn profiles_as_text_return_bit_by_bit_in_chunks() {
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

fn write_cloud(path: &Path, n: usize) -> Vec<(Vec3, f64)> {
    let offset = Vec3::new(400_000.3, 5_600_000.0, 60.0);
    let mut writer = CloudWriter::create(path, offset).unwrap();
    let points: Vec<_> = (0..n)
        .map(|i| {
            (
                offset + vector(i, 0) * 20.0,
                1.7e9 + (i / 10) as f64 * 0.005,
            )
        })
        .collect();
    for (point, time_s) in &points {
        writer.write(point, *time_s, 130.4, 2).unwrap();
    }
    writer.finish().unwrap();
    points
}

#[test]
fn written_clouds_keep_the_hundredth_of_a_millimetre() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["cloud.las", "cloud.laz"] {
        let path = dir.path().join(name);
        let written = write_cloud(&path, 450_000);
        let again = dir.path().join(format!("again-{name}"));
        write_cloud(&again, 450_000);
        assert_eq!(
            std::fs::read(&path).unwrap(),
            std::fs::read(&again).unwrap()
        );
        let read = all_points(&path).unwrap();
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

#[test]
fn sensor_poses_beside_the_points_bring_the_points_back() {
    let Some(truck) = shared_data("boresight_truck/Truck.adc.laz") else {
        return;
    };
    let points = all_points(&truck).unwrap();
    assert_eq!(points.len(), 26_414);
    let poses = read_trajectory(&truck).unwrap();
    let trajectory = Trajectory::new(poses).unwrap();
    // World points as the las crate decodes them, in time order.
    let mut reader = las::Reader::from_path(&truck).unwrap();
    let mut world: Vec<_> = reader
        .read_all()
        .unwrap()
        .points()
        .map(|p| p.unwrap())
        .map(|p| (p.gps_time.unwrap(), Vec3::new(p.x, p.y, p.z)))
        .collect();
    world.sort_by(|a, b| a.0.total_cmp(&b.0));
    let nodes = trajectory.nodes();
    for (point, (time_s, p)) in points.iter().zip(&world) {
        assert_eq!(point.time_s, *time_s);
        let i = nodes.partition_point(|node| node.time_s < *time_s);
        let back = transform(&nodes[i].world_from_body, &point.position_m);
        // All points of one time share the pose of the first of them.
        assert!((back - p).norm() < 1e-6, "{} m", (back - p).norm());
        let range = point.position_m.norm();
        assert!(range > 15.0 && range < 80.0, "{range}");
    }
}
