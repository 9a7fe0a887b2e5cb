//! Files that other programs wrote or could have written.

use std::path::Path;

use boresight::format::*;
use boresight::geometry::{Rotation, Vec3};
use boresight::sensor::*;
use boresight::trajectory::Trajectory;

use crate::common::samples::*;
use crate::common::{data, external_data};

#[test]
fn points_with_sensor_poses_return_to_their_world_coordinates() {
    let truck = data("boresight_truck/Truck.adc.laz");
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
    let nodes = trajectory.poses();
    let mut back: Vec<_> = points
        .iter()
        .map(|point| {
            let range = point.position_m.norm();
            assert!(range > 15.0 && range < 80.0, "{range}");
            // The file's times are whole seconds, but every point gets the right pose.
            let i = nodes.partition_point(|node| node.time_s < point.time_s);
            assert_eq!(nodes[i].time_s, point.time_s);
            let p = nodes[i].world_from_body.map(&point.position_m);
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
    // Along each pass the sensor moves steadily like an aircraft, not back and forth.
    let steps: Vec<_> = nodes
        .windows(2)
        .map(|n| {
            let d = n[1].world_from_body.translation_m - n[0].world_from_body.translation_m;
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

/// Checks format, number of points and presence of times of a file; returns the points.
fn assert_cloud(path: &Path, format: &str, count: usize, timed: bool) -> Vec<Vec3> {
    let name = path.display();
    assert_eq!(detect(path).unwrap().id(), format, "{name}");
    let cloud = read_cloud(path).unwrap();
    assert_eq!(cloud.points.len(), count, "{name}");
    assert_eq!(cloud.time_s.len(), if timed { count } else { 0 }, "{name}");
    assert_eq!(inspect(path).unwrap().count, count as u64, "{name}");
    cloud.points
}

/// Checks that a file exists and is refused with an error that names it.
fn assert_refused(path: &Path) {
    assert!(path.exists(), "{}", path.display());
    let error = inspect(path).unwrap_err().to_string();
    let name = path.file_name().unwrap().to_str().unwrap();
    assert!(error.contains(name), "{error}");
}

#[test]
fn euroc_folders_are_read_as_published() {
    let Some(folder) = external_data("readers/euroc_5line_sample") else {
        return;
    };
    let imu = folder.join("imu0/data.csv");
    let report = inspect(&imu).unwrap();
    assert_eq!((report.format.id(), report.count), ("euroc-imu", 5));
    assert!((report.rate_hz.unwrap() - 200.0).abs() < 0.1);
    assert_eq!(read_imu(&imu).unwrap().len(), 5);
    let truth = folder.join("state_groundtruth_estimate0/data.csv");
    assert_eq!(inspect(&truth).unwrap().format.id(), "euroc-poses");
    assert!(read_trajectory(&truth).unwrap()[0].velocity_m_s.is_some());
    let leica = folder.join("leica0/data.csv");
    let positions = read_positions(&leica, &Observations::AsFound).unwrap();
    assert_eq!(inspect(&leica).unwrap().count, positions.fixes.len() as u64);
}

#[test]
fn external_clouds_of_other_programs_are_read() {
    let Some(folder) = external_data("readers") else {
        return;
    };
    assert_cloud(
        &folder.join("ply/smallgicp_source.ply"),
        "ply",
        69_792,
        false,
    );
    let [float, int24] = ["Float", "Int24"].map(|kind| {
        let bunny = folder.join(format!("e57/cry_bunny{kind}.e57"));
        assert_cloud(&bunny, "e57", 30_571, false)
    });
    for (a, b) in float.iter().zip(&int24) {
        assert!((a - b).amax() < 1e-6, "{a} {b}");
    }
    assert_refused(&folder.join("imu_csv/microstrain_3DM-GX3-35.csv"));
}

#[test]
fn clouds_of_other_programs_are_read_and_damaged_ones_refused() {
    let folder = data("readers");
    for (name, format, count, timed) in [
        ("las/autzen.las", "las", 106, true),
        ("las/autzen.laz", "laz", 106, true),
        ("las/extrabytes.laz", "laz", 1065, true),
        ("las/pdal_1.2-with-color.las", "las", 1065, true),
        ("pcd/pdal_autzen-utm.pcd", "pcd", 1065, true),
        ("pcd/pdal_utm17_space.pcd", "pcd", 10, false),
        ("ptx_pts/autzen.pts", "pts", 10, false),
        ("ptx_pts/test.pts", "pts", 19, false),
        ("ptx_pts/1.2-with-color.ptx", "ptx", 1065, false),
        ("e57/pdal_A4_moved.e57", "e57", 4, false),
    ] {
        assert_cloud(&folder.join(name), format, count, timed);
    }
    // The same points in LAS, PTX and LAZ.
    let las = read_cloud(&folder.join("las/pdal_1.2-with-color.las")).unwrap();
    let ptx = read_cloud(&folder.join("ptx_pts/1.2-with-color.ptx")).unwrap();
    for (a, b) in las.points.iter().zip(&ptx.points) {
        assert!((a - b).amax() < 0.006, "PTX has two decimals: {a} {b}");
    }
    // Unit ranges around the x axis, upwards.
    let spherical = read_cloud(&folder.join("e57/cry_tiny_spherical.e57")).unwrap();
    let [x, y, z] = extent(&spherical.points);
    assert!(x.0 >= 0.0 && x.1 <= 1.0 && z.0 >= 0.0 && z.1 <= 1.0 && y.0 > -0.51 && y.1 < 0.51);
    for name in [
        "e57/cry_corrupt_crc.e57",
        "pcd/pdal_missingheader.pcd",
        "trajectory/pdal_badfile.sbet",
        "csd/optech_sample.csd",
    ] {
        assert_refused(&folder.join(name));
    }
    let sbet = folder.join("trajectory/pdal_2-points.sbet");
    let report = inspect(&sbet).unwrap();
    assert_eq!((report.format.id(), report.count), ("sbet", 2));
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
fn numpy_arrays_are_read_as_clouds() {
    let folder = data("m3c2_case");
    let cloud = read_cloud(&folder.join("epoch1.npy")).unwrap();
    assert_eq!(cloud.points.len(), 13_936);
    let error = read_cloud(&folder.join("distance.npy"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("shape (n, 3)"), "{error}");
}

#[test]
fn mounting_files_of_bonn_are_read_in_their_convention_and_written_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("left.xml");
    std::fs::write(
        &path,
        "<SystemCalibration>\n<x> 1.254 </x><y>-0.545</y><z>0.587</z>\n\
         <rx>-143.769</rx><ry>-0.369</ry><rz>89.833</rz></SystemCalibration>",
    )
    .unwrap();
    assert_eq!(detect(&path).unwrap().id(), "bonn-mounting");
    let mounting = read_mounting(&path).unwrap();
    assert_eq!(mounting.translation_m, Vec3::new(1.254, -0.545, 0.587));
    // The left scanner of the paper looks inward (+y of FRD) and down (+z).
    let view = mounting.rotation * Vec3::new(0.0, 0.0, -1.0);
    assert!(view.y > 0.5 && view.z > 0.75);
    write_mounting(&path, &mounting).unwrap();
    let back = read_mounting(&path).unwrap();
    assert_eq!(back.translation_m, mounting.translation_m);
    assert!(back.rotation.angle_to(&mounting.rotation) < 1e-12);
    let attributes = "<SystemCalibration x=\"1\" y=\"2\" z=\"3\" rx=\"0\" ry=\"0\" rz=\"0\"/>";
    std::fs::write(&path, attributes).unwrap();
    let plain = read_mounting(&path).unwrap();
    assert_eq!(plain.translation_m, Vec3::new(1.0, 2.0, 3.0));
    std::fs::write(&path, attributes.replace("rz=", "r=")).unwrap();
    assert!(
        read_mounting(&path)
            .unwrap_err()
            .to_string()
            .contains("no rz")
    );
}

#[test]
fn ply_files_of_all_encodings_give_the_same_cloud() {
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
fn compressed_pcd_files_are_unpacked() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.pcd");
    let columns: Vec<u8> = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let mut file = b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n\
        COUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary_compressed\n"
        .to_vec();
    // Only literals: one run of 24.
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
fn tables_and_plain_lines_are_read_as_clouds() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.csv");
    let cloud = boresight::cloud::PointCloud {
        points: (0..20).map(|i| vector(i, 0)).collect(),
        time_s: (0..20).map(f64::from).collect(),
        intensity: vec![3.5; 20],
    };
    write_cloud_table(&path, &cloud).unwrap();
    assert_eq!(detect(&path).unwrap().id(), "cloud-csv");
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
fn an_inspection_reports_span_rate_gaps_and_ranges() {
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
    assert_eq!((report.format.id(), report.count), ("imu-csv", 850));
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
    assert_eq!(report.format.id(), "bonn-profiles");
    assert_eq!(
        (report.count, report.epochs),
        (points.len() as u64, Some(100))
    );
    assert!((report.rate_hz.unwrap() - 200.0).abs() < 1e-6);
}

#[test]
fn scans_of_an_e57_are_transformed_by_their_poses() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.e57");
    let mut writer = e57::E57Writer::from_file(&path, "file").unwrap();
    let column = |name| e57::Record {
        name,
        data_type: e57::RecordDataType::F64,
    };
    let prototype = vec![
        column(e57::RecordName::CartesianX),
        column(e57::RecordName::CartesianY),
        column(e57::RecordName::CartesianZ),
    ];
    let turn = Rotation::from_euler_angles(0.3, -0.2, 1.1);
    let shift = Vec3::new(100.0, -20.0, 3.0);
    let point = Vec3::new(1.0, 2.0, 3.0);
    let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
    scan.add_point(point.iter().map(|v| e57::RecordValue::Double(*v)).collect())
        .unwrap();
    scan.set_transform(Some(e57::Transform {
        rotation: e57::Quaternion {
            w: turn.w,
            x: turn.i,
            y: turn.j,
            z: turn.k,
        },
        translation: e57::Translation {
            x: shift.x,
            y: shift.y,
            z: shift.z,
        },
    }));
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    let cloud = read_cloud(&path).unwrap();
    assert!((cloud.points[0] - (turn * point + shift)).norm() < 1e-12);
}
