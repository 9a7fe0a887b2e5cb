//! Sample bags written by other programs (`tests/data/ros/make.py`), value by value.

use std::path::{Path, PathBuf};

use super::*;
use crate::geometry::Vec3;
use crate::sensor::ScanPoint;

/// All samples; they contain the same messages.
pub(super) const SAMPLES: [&str; 15] = [
    "plain.bag",
    "bz2.bag",
    "lz4.bag",
    "zstd.mcap",
    "lz4.mcap",
    "plain.mcap",
    "unchunked_big_endian.mcap",
    "no_summary.mcap",
    "ros1.mcap",
    "rosbags.mcap",
    "rosbags.db3.zst",
    "small_pages.db3",
    "messages.db3.zst",
    "messages.mcap.zst",
    "split",
];

/// Those of one file that is neither compressed as a whole nor a database.
pub(super) fn plain_samples() -> impl Iterator<Item = &'static str> {
    let is_plain = |name: &&str| name.ends_with(".bag") || name.ends_with(".mcap");
    SAMPLES.into_iter().filter(is_plain)
}

const START_S: f64 = 1_700_000_000.0;
/// Stamps near [`START_S`] are multiples of this.
const CLOCK_S: f64 = 2.4e-7;

pub(super) fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join("tests/data/ros")
        .join(name)
}

pub(super) fn points_of(path: &Path, topic: &str) -> Result<Vec<ScanPoint>> {
    let mut reader = open_points(&Input::from(path), Some(topic))?;
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk)? {
        all.append(&mut chunk);
    }
    assert!(all.is_sorted_by(|a, b| a.time_s <= b.time_s));
    Ok(all)
}

fn stamp_s(i: usize) -> f64 {
    START_S + 0.01 * i as f64
}

#[track_caller]
fn assert_near(time_s: f64, expected_s: f64) {
    assert!(
        (time_s - expected_s).abs() <= 2.0 * CLOCK_S,
        "{time_s} {expected_s}"
    );
}

#[test]
fn the_topics_are_listed() {
    for name in SAMPLES {
        let topics = topics(&Input::from(&sample(name))).unwrap();
        let listed: Vec<_> = topics
            .iter()
            .map(|t| (t.name.as_str(), t.message_type.as_str(), t.count))
            .collect();
        let cloud = "sensor_msgs/PointCloud2";
        let expected = [
            ("/fix", "sensor_msgs/NavSatFix", 12),
            ("/hesai", cloud, 4),
            ("/imu", "sensor_msgs/Imu", 12),
            ("/livox", cloud, 4),
            ("/odom", "nav_msgs/Odometry", 12),
            ("/offset", cloud, 4),
            ("/ouster", cloud, 4),
            ("/pose", "geometry_msgs/PoseStamped", 12),
            ("/pose_cov", "geometry_msgs/PoseWithCovarianceStamped", 12),
            ("/scan", "sensor_msgs/LaserScan", 4),
            ("/transform", "geometry_msgs/TransformStamped", 12),
            ("/untimed", cloud, 4),
            ("/velodyne", cloud, 4),
        ];
        assert_eq!(listed, expected, "{name}");
        let (first_s, last_s) = topics[0].recorded_s.unwrap();
        assert_near(first_s, START_S);
        assert_near(last_s, stamp_s(11));
    }
}

#[test]
fn imu_samples_are_exact() {
    for name in SAMPLES {
        let samples = read_imu(&Input::from(&sample(name)), None).unwrap();
        assert_eq!(samples.len(), 12, "{name}");
        for (i, sample) in samples.iter().enumerate() {
            let x = i as f64;
            assert_near(sample.time_s, stamp_s(i));
            assert_eq!(sample.gyro_rad_s, Vec3::new(0.1 * x, -0.2, 0.001 * x * x));
            assert_eq!(sample.accel_m_s2, Vec3::new(0.5 - x, 0.25 * x, 9.81));
        }
    }
}

#[test]
fn poses_are_exact_and_have_sigmas_where_the_covariance_is_given() {
    for name in SAMPLES {
        for topic in ["/odom", "pose", "/pose_cov", "/transform"] {
            let poses = read_poses(&Input::from(&sample(name)), Some(topic)).unwrap();
            assert_eq!(poses.len(), 12, "{name}");
            for (i, pose) in poses.iter().enumerate() {
                let x = i as f64;
                assert_near(pose.time_s, stamp_s(i));
                let at = &pose.world_from_body;
                assert_eq!(at.translation_m, Vec3::new(1.0 + 0.5 * x, -2.0 * x, 0.25));
                let heading = Vec3::new(0.0, 0.0, 0.1 * x);
                assert!((at.rotation.scaled_axis() - heading).norm() < 1e-14);
                let has_sigma = i % 2 == 0 && topic.ends_with(['m', 'v']) && topic != "/transform";
                assert_eq!(pose.sigma.is_some(), has_sigma, "{topic}");
                if let Some(sigma) = pose.sigma {
                    assert!((sigma.position_m - Vec3::new(0.1, 0.2, 0.3)).norm() < 1e-15);
                    assert!((sigma.rotation_rad - Vec3::new(0.01, 0.02, 0.03)).norm() < 1e-15);
                }
            }
        }
    }
}

#[test]
fn fixes_are_exact_and_messages_without_a_fix_are_skipped() {
    for name in SAMPLES {
        let fixes = read_fixes(&Input::from(&sample(name)), None).unwrap();
        assert_eq!(fixes.len(), 11, "{name}");
        for (fix, i) in fixes.iter().zip(1..) {
            let x = i as f64;
            assert_near(fix.time_s, stamp_s(i));
            assert_eq!(fix.latitude_rad, (50.5 + 1e-6 * x).to_radians());
            assert_eq!(fix.longitude_rad, (7.25 - 1e-6 * x).to_radians());
            assert_eq!(fix.height_m, 60.125 + x);
            let sigma_m = Vec3::new(1.0, 2f64.sqrt(), 2.0);
            assert_eq!(fix.sigma_m, (i != 1).then_some(sigma_m));
        }
    }
}

/// Checks the points of a cloud topic: `expected` gives time after the stamp, y and intensity of point k.
fn check_clouds(topic: &str, first: usize, expected: impl Fn(usize) -> (f64, f64, f32)) {
    for name in SAMPLES {
        let points = points_of(&sample(name), topic).unwrap();
        let per_cloud = points.len() / 4;
        assert_eq!(per_cloud, 4 - first, "{name}");
        for (n, point) in points.iter().enumerate() {
            let k = n % per_cloud + first;
            let (after_s, y, intensity) = expected(k);
            assert_near(point.time_s, stamp_s(3 * (n / per_cloud)) + after_s);
            assert_eq!(point.position_m, Vec3::new(1.0 + k as f64, y, -3.0));
            assert_eq!(point.intensity, intensity);
        }
    }
}

#[test]
fn points_of_clouds_are_exact_with_the_times_of_each_manufacturer() {
    check_clouds("/velodyne", 1, |k| {
        (0.0078125 * (k as f64 - 3.0), 0.5, k as f32)
    });
    check_clouds("/livox", 0, |k| (0.001 * k as f64, 0.5, k as f32 + 7.0));
    check_clouds("/hesai", 0, |k| (0.001 * k as f64, 0.5, k as f32 + 7.0));
    check_clouds("/offset", 0, |k| (0.002 * k as f64, 0.5, 0.0));
    check_clouds("/untimed", 0, |_| (0.0, 0.5, 0.0));
}

#[test]
fn rings_are_merged_by_time() {
    for name in SAMPLES {
        let points = points_of(&sample(name), "/ouster").unwrap();
        assert_eq!(points.len(), 4 * 6, "{name}");
        for (n, point) in points.iter().enumerate() {
            // Three columns of two rings.
            let (cloud, k, ring) = (n / 6, n % 6 / 2, n % 2);
            let (k_value, ring_value) = (k as f64, ring as f64);
            assert_near(point.time_s, stamp_s(3 * cloud) + 0.005 * k_value);
            let expected = Vec3::new(1.0 + k_value, 2.0 * ring_value + 0.5, -3.0);
            assert_eq!(point.position_m, expected);
            assert_eq!(f64::from(point.intensity), 100.0 * ring_value + k_value);
        }
    }
}

#[test]
fn a_laser_scan_is_in_the_x_y_plane() {
    for name in SAMPLES {
        let points = points_of(&sample(name), "scan").unwrap();
        // One of seven ranges is infinite, and one is beyond the limit.
        assert_eq!(points.len(), 4 * 5, "{name}");
        for (n, point) in points.iter().enumerate() {
            let k = (n % 5) as f64;
            assert_near(point.time_s, stamp_s(3 * (n / 5)) + 0.0009765625 * k);
            let (range, angle) = (1.0 + 0.5 * k, -0.5 + 0.25 * k);
            let expected = Vec3::new(range * angle.cos(), range * angle.sin(), 0.0);
            assert!((point.position_m - expected).norm() < 1e-15);
            assert_eq!(f64::from(point.intensity), 10.0 * k);
        }
    }
}

#[test]
fn a_choice_between_several_topics_is_left_to_the_caller() {
    let path = sample("zstd.mcap");
    let message = |error: Error| error.to_string();
    let text = message(read_poses(&Input::from(&path), None).unwrap_err());
    assert!(
        text.contains("4 topics with poses: /odom (nav_msgs/Odometry, 12"),
        "{text}"
    );
    let text = message(read_imu(&Input::from(&path), Some("/gyro")).unwrap_err());
    assert!(text.contains("no topic `/gyro` among /fix"), "{text}");
    let text = message(read_imu(&Input::from(&path), Some("/odom")).unwrap_err());
    assert!(text.contains("found /odom (nav_msgs/Odometry") && text.contains("sensor_msgs/Imu"));
    let text = message(open_points(&Input::from(&path), None).err().unwrap());
    assert!(text.contains("7 topics with points: /hesai"), "{text}");
}

#[test]
fn both_versions_of_bags_are_detected_by_their_first_bytes() {
    for name in SAMPLES {
        let input = Input::from(&sample(name));
        let start = input.first_bytes(&mut input.open().unwrap().0).unwrap();
        assert!(looks_like(&start));
    }
    assert!(looks_like(b"#ROSBAG V1.2\n") && !looks_like(b"time_s,x_m,z_m\n"));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bag");
    std::fs::write(&path, b"#ROSBAG V1.2\n1234").unwrap();
    let text = topics(&Input::from(&path)).unwrap_err().to_string();
    assert!(
        text.contains("\"#ROSBAG V1.2\"") && text.contains("version 2.0"),
        "{text}"
    );
}
