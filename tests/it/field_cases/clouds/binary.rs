//! PLY, PCD, `.npy` and E57.

use boresight::geometry::{Rotation, Vec3};
use boresight::nalgebra::Quaternion;

use super::{INTENSITIES, UTM, assert_points, case, error, read, some};

const TWO: [[f64; 3]; 2] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];

#[test]
fn intensities_that_a_scan_does_not_have_are_empty() {
    let (cloud, remarks) = read("e57_missing_intensity/mi.e57");
    let expected = [
        Some(0.1),
        Some(0.2),
        Some(0.3),
        Some(0.4),
        None,
        None,
        None,
        None,
    ];
    assert_eq!(some(&cloud.intensity), expected);
    assert!(
        remarks.contains("4 of 8 points have no intensity"),
        "{remarks}"
    );
    let (cloud, _) = read("e57_missing_intensity/iv2.e57");
    assert_eq!(some(&cloud.intensity), [Some(0.1), None, Some(0.3), None]);
    let (cloud, _) = read("e57/twoscan_oneint.e57");
    assert_eq!(some(&cloud.intensity)[3..5], [Some(8.0), None]);
}

#[test]
fn points_at_the_scanner_are_left_out() {
    let points = [[11.0, 25.0, 30.5], [14.0, 25.0, 32.0]];
    let (_, remarks) = assert_points("e57/phantom_zero.e57", &points);
    assert!(
        remarks.contains("2 points at the origin of the scanner"),
        "{remarks}"
    );
}

#[test]
fn a_rotation_of_zeros_is_none_and_a_long_one_is_normalised() {
    let points = [
        [11.0, 25.0, 30.5],
        [12.0, 25.0, 31.0],
        [13.0, 25.0, 31.5],
        [14.0, 25.0, 32.0],
    ];
    let (_, remarks) = assert_points("e57/zeroquat.e57", &points);
    assert!(remarks.contains("is taken for no rotation"), "{remarks}");
    let (not_turned, remarks) = read("e57_quat/pz.e57");
    assert!(
        remarks.contains("of scan 1 is taken for no rotation"),
        "{remarks}"
    );
    let (turned, remarks) = read("e57_quat/pu.e57");
    assert!(
        remarks.contains("of length 2.0000 in the pose of scan 1 is normalised"),
        "{remarks}"
    );
    // The same points, 40 m away, turned about the scanner by (4, 1, 2, 3)/√30, which the file has with eight digits.
    let scanner = Vec3::new(364_500.0, 5_621_000.0, 60.0);
    let turn = Rotation::new_normalize(Quaternion::new(4.0, 1.0, 2.0, 3.0));
    for (before, after) in not_turned.points.iter().zip(&turned.points) {
        let expected = scanner + turn * (before - scanner);
        assert!((expected - after).norm() < 1e-5, "{after}");
    }
}

#[test]
fn a_viewpoint_is_said_not_to_be_applied() {
    let (_, remarks) = assert_points("pcd/pcd_vp.pcd", &TWO);
    let expected = "VIEWPOINT (10, 20, 30) m, turned by 90.0°, is not applied";
    assert!(remarks.contains(expected), "{remarks}");
    let (_, remarks) = assert_points("pcd/pcd_time.pcd", &TWO);
    assert_eq!(remarks, "");
}

#[test]
fn times_of_pcd_are_kept() {
    let (cloud, _) = assert_points("pcd/pcd_time.pcd", &TWO);
    assert_eq!(cloud.time_s, [1_700_000_000.5, 1_700_000_001.5]);
    let (cloud, remarks) = read("pcd_time_lost/ts.pcd");
    assert_eq!(cloud.time_s[2], 1_700_000_002.123_456);
    assert!(
        remarks.contains("the fields ring are left out"),
        "{remarks}"
    );
    // Whole numbers have an unknown unit.
    let (cloud, remarks) = assert_points("pcd/pcd_t.pcd", &TWO);
    assert!(cloud.time_s.is_empty());
    assert!(
        remarks.contains("the field t has whole numbers"),
        "{remarks}"
    );
}

#[test]
fn old_and_padded_pcd_are_read() {
    let points = [
        [1.5, 2.25, 61.25],
        [3.5, 4.125, 62.5],
        [5.75, 6.0625, 63.75],
    ];
    for name in ["pcd_refused/c0.pcd", "pcd_refused/v7.pcd"] {
        let (cloud, _) = assert_points(name, &points);
        assert_eq!(cloud.intensity, INTENSITIES, "{name}");
    }
}

#[test]
fn pcd_without_some_values_is_read() {
    let points = [
        [1.5, 2.25, 61.25],
        [3.5, 4.125, 62.5],
        [5.75, 6.0625, 63.75],
    ];
    let (cloud, remarks) = assert_points("nan_text/anan2.pcd", &points);
    assert_eq!(cloud.intensity, INTENSITIES);
    assert!(
        remarks.contains("left out: 2 records without a position"),
        "{remarks}"
    );
    let (cloud, _) = assert_points("one_nan_drops_column/ni.pcd", &TWO);
    assert_eq!(some(&cloud.intensity), [None, Some(7.0)]);
}

#[test]
fn ply_of_other_writers_is_read() {
    for name in [
        "ply_face_first",
        "ply_latin1",
        "ply_list_in_vertex",
        "ply_gps_time",
    ] {
        assert_points(&format!("ply/{name}.ply"), &TWO);
    }
    let (cloud, _) = read("ply/ply_gps_time.ply");
    assert_eq!(cloud.time_s, [1000.5, 1001.5]);
    assert_eq!(cloud.intensity, [7.0, 8.0]);
    let (_, remarks) = read("ply/ply_list_in_vertex.ply");
    assert!(remarks.contains("the lists idx are left out"), "{remarks}");
    let (_, remarks) = assert_points("ply/ply_nanind.ply", &TWO[1..]);
    assert!(remarks.contains("1 record without a position"), "{remarks}");
    assert_points("ply_lists/cc1455.ply", &TWO);
    for name in [
        "ply_lists/listv.ply",
        "ply_blank_line/blank.ply",
        "ply_cr/cr.ply",
    ] {
        let (cloud, _) = assert_points(name, &UTM);
        assert_eq!(cloud.intensity, INTENSITIES, "{name}");
    }
}

#[test]
fn binary_ply_with_returns_as_line_ends_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let text = std::fs::read_to_string(case("ply_cr/cr.ply")).unwrap();
    let (header, _) = text.split_once("end_header\r").unwrap();
    let header = header.replace("ascii", "binary_little_endian");
    let mut bytes = (header + "end_header\r").into_bytes();
    for point in UTM {
        // The first byte of a coordinate may be a line feed.
        let mut record: Vec<u8> = point.iter().flat_map(|v| v.to_le_bytes()).collect();
        record[0] = b'\n';
        bytes.extend(record);
        bytes.extend([255, 10, 0]);
    }
    std::fs::write(&path, bytes).unwrap();
    let cloud = boresight::format::read_cloud(&path).unwrap();
    assert_eq!(cloud.points.len(), 3);
    assert!((cloud.points[2].z - 63.75).abs() < 1e-12);
}

#[test]
fn arrays_of_numpy_in_other_orders_are_read() {
    assert_points("npy/n_T.npy", &UTM);
    let (cloud, remarks) = assert_points("npy/n_f8.npy", &UTM);
    assert!(cloud.intensity.is_empty());
    assert!(
        remarks.contains("column 4 has no name and is left out"),
        "{remarks}"
    );
    let (cloud, _) = assert_points("npy/n_st.npy", &UTM);
    assert_eq!(cloud.intensity, INTENSITIES);
    // In Fortran order and with the other byte order.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let mut bytes = std::fs::read(case("npy/n_T.npy")).unwrap();
    let header = String::from_utf8_lossy(&bytes[10..128]).into_owned();
    let header = header
        .replace("'<f8'", "'>f8'")
        .replace("False", "True ")
        .replace("(3, 3)", "(1, 9)");
    bytes[10..128].copy_from_slice(header.as_bytes());
    bytes[128..].chunks_exact_mut(8).for_each(<[u8]>::reverse);
    std::fs::write(&path, bytes).unwrap();
    let cloud = boresight::format::read_cloud(&path).unwrap();
    assert_eq!(
        cloud.points[0].iter().copied().collect::<Vec<_>>(),
        [364_500.123_4, 364_501.5, 364_502.75]
    );
}

#[test]
fn records_of_numpy_without_coordinates_are_refused() {
    let text = error("npy-structured/a.npy");
    assert!(
        text.contains("'Health'") && text.contains("records of shape (n,)"),
        "{text}"
    );
}
