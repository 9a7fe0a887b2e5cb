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
    // World points as the las crate decodes them, in any order.
    let mut reader = las::Reader::from_path(&truck).unwrap();
    let mut world: Vec<_> = reader
        .read_all()
        .unwrap()
        .points()
        .map(|p| p.unwrap())
        .map(|p| [p.x, p.y, p.z])
        .collect();
    let nodes = trajectory.nodes();
    let mut back: Vec<_> = points
        .iter()
        .map(|point| {
            let range = point.position_m.norm();
            assert!(range > 15.0 && range < 80.0, "{range}");
            // The file's times are whole seconds, yet every point finds its own pose.
            let i = nodes.partition_point(|node| node.time_s < point.time_s);
            assert_eq!(nodes[i].time_s, point.time_s);
            let p = transform(&nodes[i].world_from_body, &point.position_m);
            // The file's step is a millimetre.
            [p.x, p.y, p.z].map(|v| (v * 1e3).round() / 1e3)
        })
        .collect();
    let order = |a: &[f64; 3], b: &[f64; 3]| a.partial_cmp(b).unwrap();
    for p in &mut world {
        *p = p.map(|v| (v * 1e3).round() / 1e3);
    }
    world.sort_by(order);
    back.sort_by(order);
    assert_eq!(world, back);
    // Along each pass the sensor moves as an aircraft does, not to and fro.
    let steps: Vec<_> = nodes
        .windows(2)
        .map(|n| {
            let d =
                n[1].world_from_body.translation.vector - n[0].world_from_body.translation.vector;
            (n[1].time_s - n[0].time_s, d.norm())
        })
        .collect();
    let length: f64 = steps.iter().filter(|s| s.0 < 2.0).map(|s| s.1).sum();
    println!("{} poses, {length:.1} m within the passes", nodes.len());
    assert!(length < 400.0, "{length}");
}

/// Ranges of a cloud on each axis.
fn extent(points: &[Vec3]) -> [(f64, f64); 3] {
    [0, 1, 2].map(|k| {
        points
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
                (a.min(p[k]), b.max(p[k]))
            })
    })
}

#[test]
fn clouds_that_others_wrote_hold_what_they_should() {
    let Some(folder) = shared_data("readers") else {
        return;
    };
    // File, format, points, with times.
    for (name, format, count, timed) in [
        ("las/autzen.las", Format::Las, 106, true),
        ("las/autzen.laz", Format::Laz, 106, true),
        ("las/extrabytes.laz", Format::Laz, 1065, true),
        ("las/pdal_1.2-with-color.las", Format::Las, 1065, true),
        ("ply/smallgicp_source.ply", Format::Ply, 69_792, false),
        ("pcd/pdal_autzen-utm.pcd", Format::Pcd, 1065, true),
        ("pcd/pdal_utm17_space.pcd", Format::Pcd, 10, false),
        ("ptx_pts/autzen.pts", Format::Pts, 10, false),
        ("ptx_pts/test.pts", Format::Pts, 19, false),
        ("ptx_pts/1.2-with-color.ptx", Format::Ptx, 1065, false),
        ("e57/cry_bunnyFloat.e57", Format::E57, 30_571, false),
        ("e57/cry_bunnyInt24.e57", Format::E57, 30_571, false),
        ("e57/pdal_A4_moved.e57", Format::E57, 4, false),
    ] {
        let path = folder.join(name);
        assert_eq!(detect(&path).unwrap(), format, "{name}");
        let cloud = read_cloud(&path).unwrap();
        assert_eq!(cloud.points.len(), count, "{name}");
        assert_eq!(cloud.time_s.len(), if timed { count } else { 0 }, "{name}");
        assert_eq!(inspect(&path).unwrap().count, count as u64, "{name}");
    }
    // The same points in LAS, PTX and LAZ.
    let las = read_cloud(&folder.join("las/pdal_1.2-with-color.las")).unwrap();
    let ptx = read_cloud(&folder.join("ptx_pts/1.2-with-color.ptx")).unwrap();
    for (a, b) in las.points.iter().zip(&ptx.points) {
        assert!((a - b).amax() < 0.006, "PTX has two decimals: {a} {b}");
    }
    let float = read_cloud(&folder.join("e57/cry_bunnyFloat.e57")).unwrap();
    let int24 = read_cloud(&folder.join("e57/cry_bunnyInt24.e57")).unwrap();
    for (a, b) in float.points.iter().zip(&int24.points) {
        assert!((a - b).amax() < 1e-6, "{a} {b}");
    }
    println!(
        "{:?}",
        read_cloud(&folder.join("e57/pdal_A4_moved.e57"))
            .unwrap()
            .points
    );
    println!(
        "{:?}",
        extent(
            &read_cloud(&folder.join("e57/cry_tiny_spherical.e57"))
                .unwrap()
                .points
        )
    );
    for name in [
        "e57/cry_corrupt_crc.e57",
        "pcd/pdal_missingheader.pcd",
        "trajectory/pdal_badfile.sbet",
        "csd/optech_sample.csd",
        "imu_csv/microstrain_3DM-GX3-35.csv",
        "euroc_5line_sample/imu0/data.csv",
    ] {
        let error = inspect(&folder.join(name)).unwrap_err().to_string();
        assert!(error.contains(name.rsplit('/').next().unwrap()), "{error}");
        println!("{error}");
    }
    let sbet = folder.join("trajectory/pdal_2-points.sbet");
    let report = inspect(&sbet).unwrap();
    assert_eq!((report.format, report.count), (Format::Sbet, 2));
    let [first, last] = report.span_s.unwrap();
    assert!((first - 151_631.0).abs() < 1.0 && (last - first - 0.005).abs() < 1e-4);
    assert!(
        read_trajectory(&sbet)
            .unwrap_err()
            .to_string()
            .contains("latitude")
    );
}

#[test]
fn arrays_of_numpy_are_clouds() {
    let Some(folder) = shared_data("m3c2_case") else {
        return;
    };
    let cloud = read_cloud(&folder.join("epoch1.npy")).unwrap();
    assert_eq!(cloud.points.len(), 200_000);
    let error = read_cloud(&folder.join("distance.npy"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("shape (n, 3)"), "{error}");
}

#[test]
fn mountings_return_and_show_the_convention_of_bonn() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("left.xml");
    std::fs::write(
        &path,
        "<SystemCalibration>\n<x> 1.254 </x><y>-0.545</y><z>0.587</z>\n\
         <rx>-143.769</rx><ry>-0.369</ry><rz>89.833</rz></SystemCalibration>",
    )
    .unwrap();
    assert_eq!(detect(&path).unwrap(), Format::BonnMounting);
    let mounting = read_mounting(&path).unwrap();
    assert_eq!(mounting.translation.vector, Vec3::new(1.254, -0.545, 0.587));
    // The left scanner of the paper looks inward (+y of FRD) and down (+z).
    let view = mounting.rotation * Vec3::new(0.0, 0.0, -1.0);
    assert!(view.y > 0.5 && view.z > 0.75);
    write_mounting(&path, &mounting).unwrap();
    let back = read_mounting(&path).unwrap();
    assert_eq!(back.translation, mounting.translation);
    assert!(back.rotation.angle_to(&mounting.rotation) < 1e-12);
    let attributes = "<SystemCalibration x=\"1\" y=\"2\" z=\"3\" rx=\"0\" ry=\"0\" rz=\"0\"/>";
    std::fs::write(&path, attributes).unwrap();
    let plain = read_mounting(&path).unwrap();
    assert_eq!(plain.translation.vector, Vec3::new(1.0, 2.0, 3.0));
    std::fs::write(&path, attributes.replace("rz=", "r=")).unwrap();
    assert!(
        read_mounting(&path)
            .unwrap_err()
            .to_string()
            .contains("no rz")
    );
}

#[test]
fn ply_of_all_encodings_is_the_same_cloud() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    let points = [[1.5f32, -2.25, 3.0, 7.0], [0.5, 0.25, -8.0, 9.0]];
    let header = |name: &str| {
        format!(
            "ply\nformat {name} 1.0\ncomment c\nelement vertex 2\nproperty float x\n\
             property float y\nproperty float z\nproperty float intensity\n\
             element face 0\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let text = "1.5 -2.25 3 7\n0.5 0.25 -8 9\n".as_bytes().to_vec();
    let little = points
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let big = points
        .iter()
        .flatten()
        .flat_map(|v| v.to_be_bytes())
        .collect();
    for (name, body) in [
        ("ascii", text),
        ("binary_little_endian", little),
        ("binary_big_endian", big),
    ] as [(&str, Vec<u8>); 3]
    {
        std::fs::write(&path, [header(name).as_bytes(), &body].concat()).unwrap();
        let cloud = read_cloud(&path).unwrap();
        assert_eq!(cloud.intensity, [7.0, 9.0]);
        assert_eq!(cloud.points[1], Vec3::new(0.5, 0.25, -8.0));
    }
}

#[test]
fn compressed_pcd_is_unpacked() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.pcd");
    let columns: Vec<u8> = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let mut file = b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n\
        COUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary_compressed\n"
        .to_vec();
    // All literals: one run of 24.
    file.extend(25u32.to_le_bytes());
    file.extend(24u32.to_le_bytes());
    file.push(23);
    file.extend(&columns);
    std::fs::write(&path, &file).unwrap();
    let cloud = read_cloud(&path).unwrap();
    assert_eq!(
        cloud.points,
        [Vec3::new(1.0, 3.0, 5.0), Vec3::new(2.0, 4.0, 6.0)]
    );
}

#[test]
fn tables_and_plain_lines_are_clouds_too() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.csv");
    let cloud = boresight::cloud::PointCloud {
        points: (0..20).map(|i| vector(i, 0)).collect(),
        time_s: (0..20).map(f64::from).collect(),
        intensity: vec![3.5; 20],
    };
    write_cloud_table(&path, &cloud).unwrap();
    assert_eq!(detect(&path).unwrap(), Format::CloudCsv);
    assert_eq!(read_cloud(&path).unwrap(), cloud);
    std::fs::write(&path, "# x y z\n1 2 3\n4 5 6\n").unwrap();
    assert_eq!(
        read_cloud(&path).unwrap().points[1],
        Vec3::new(4.0, 5.0, 6.0)
    );
    std::fs::write(&path, "1 2 3\n4 5\n").unwrap();
    let error = read_cloud(&path).unwrap_err().to_string();
    assert!(error.contains("line 2: found `4 5`"), "{error}");
    std::fs::write(&path, "east_m,nord_m,up_m\n1,2,3\n").unwrap();
    let error = read_cloud(&path).unwrap_err().to_string();
    assert!(error.contains("without north_m"), "{error}");
    std::fs::write(&path, "east_m,north_m,up_m\n").unwrap();
    assert!(
        read_cloud(&path)
            .unwrap_err()
            .to_string()
            .contains("no point")
    );
}

#[test]
fn an_inspection_names_span_rate_gaps_and_ranges() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("imu.csv");
    let imu: Vec<_> = (0..1000)
        .filter(|i| !(300..450).contains(i))
        .map(|i| ImuSample {
            time_s: i as f64 * 0.01,
            gyro_rad_s: Vec3::new(i as f64, 0.0, 0.0),
            accel_m_s2: Vec3::new(0.0, 0.0, 9.81),
        })
        .collect();
    write_imu(&path, &imu).unwrap();
    let report = inspect(&path).unwrap();
    assert_eq!((report.format, report.count), (Format::ImuCsv, 850));
    assert!((report.rate_hz.unwrap() - 100.0).abs() < 1e-6);
    assert_eq!(report.gaps.len(), 1);
    assert!((report.gaps[0].duration_s - 1.51).abs() < 1e-9);
    assert!((report.gaps[0].start_s - 2.99).abs() < 1e-9);
    assert_eq!(report.bounds[0].max, 999.0);
    let text = report.to_string();
    for part in [
        "IMU log",
        "100.000 Hz",
        "1.510 s after 2.990 s",
        "9.810000 m/s²",
    ] {
        assert!(text.contains(part), "{text}");
    }
    let bin = dir.path().join("left.bin");
    let points = write_recording(&bin, 100);
    let report = inspect(&bin).unwrap();
    assert_eq!(report.format, Format::BonnProfiles);
    assert_eq!(
        (report.count, report.epochs),
        (points.len() as u64, Some(100))
    );
    assert!((report.rate_hz.unwrap() - 200.0).abs() < 1e-6);
}

/// Reads a file in every way; it must end, in data or in an error.
fn try_everything(path: &Path) {
    let _ = inspect(path);
    let _ = read_cloud(path);
    let _ = read_trajectory(path);
    let _ = all_points_unchecked(path);
    let _ = read_mounting(path);
    let _ = read_imu(path);
}

fn all_points_unchecked(path: &Path) -> boresight::Result<()> {
    let mut reader = open_profiles(path)?;
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk)? {}
    Ok(())
}

#[test]
fn damaged_files_are_errors_and_never_more() {
    let dir = tempfile::tempdir().unwrap();
    let mut samples = vec![dir.path().join("a.bin"), dir.path().join("a.laz")];
    samples.push(dir.path().join("a.las"));
    write_recording(&samples[0], 4);
    write_cloud(&samples[1], 2000);
    write_cloud(&samples[2], 200);
    if let Some(folder) = shared_data("readers") {
        for name in [
            "las/autzen.laz",
            "las/extrabytes.laz",
            "las/autzen.las",
            "pcd/pdal_autzen-utm.pcd",
            "e57/cry_tiny_spherical.e57",
            "e57/pdal_A4_moved.e57",
            "ptx_pts/test.pts",
            "ptx_pts/1.2-with-color.ptx",
            "trajectory/pdal_2-points.sbet",
        ] {
            samples.push(folder.join(name));
        }
    }
    for sample in samples {
        let whole = std::fs::read(&sample).unwrap();
        let path = dir
            .path()
            .join(format!("damaged-{}", sample.file_name().unwrap().display()));
        for k in 0..60 {
            // Dense in the header, then all along the file.
            let n = if k < 30 {
                k * 13
            } else {
                whole.len() * (k - 30) / 30
            };
            std::fs::write(&path, &whole[..n.min(whole.len() - 1)]).unwrap();
            try_everything(&path);
        }
        for k in 0..200 {
            let mut bytes = whole.clone();
            let span = if k % 2 == 0 {
                whole.len().min(600)
            } else {
                whole.len()
            };
            let at = ((noise(k, 7) * 0.5 + 0.5) * span as f64) as usize;
            bytes[at.min(span - 1)] ^= if k % 3 == 0 { 0xff } else { 1 << (k % 8) };
            std::fs::write(&path, &bytes).unwrap();
            try_everything(&path);
        }
    }
    // The files are small; what they claim to hold must not have been believed.
    if let Ok(status) = std::fs::read_to_string("/proc/self/status") {
        let peak = status
            .lines()
            .find_map(|line| line.strip_prefix("VmHWM:"))
            .unwrap();
        let peak_kib: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
        println!("peak memory {peak_kib} KiB");
        assert!(peak_kib < 1_000_000, "{peak_kib} KiB");
    }
}

#[test]
fn a_truncated_recording_says_where() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bin");
    write_recording(&path, 3);
    let whole = std::fs::read(&path).unwrap();
    let length = whole.len() / 3;
    for n in (length + 1)..(2 * length) {
        std::fs::write(&path, &whole[..n]).unwrap();
        let error = all_points(&path).unwrap_err().to_string();
        assert!(
            error.contains(&format!("starts at byte {length}")),
            "{error}"
        );
    }
    let mut wide = whole.clone();
    wide[length + 52..length + 56].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&path, &wide).unwrap();
    let error = all_points(&path).unwrap_err().to_string();
    assert!(error.contains(&format!(
        "byte {}: found a profile of 4294967295",
        length + 52
    )));
}
