//! Text: separators, numbers, headers, rows, and tables that are no clouds.

use super::{INTENSITIES, UTM, assert_points, case, error, read, some};
use boresight::format::{inspect, read_cloud, read_imu};
use boresight::geometry::Vec3;

const THREE: [[f64; 3]; 3] = [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5], [7.25, 8.25, 9.25]];

#[test]
fn the_fourth_value_is_not_taken_for_an_intensity() {
    let two = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    for name in ["p6.pts", "crgb.xyz"] {
        let (cloud, remarks) = assert_points(&format!("pts_rgb_as_intensity/{name}"), &two);
        assert!(cloud.intensity.is_empty(), "{name}");
        assert!(
            remarks.contains("the last 3 of 6 values (colours or normals"),
            "{remarks}"
        );
    }
}

#[test]
fn pts_with_no_or_a_wrong_count_is_read() {
    let (cloud, remarks) = assert_points("pts-count/nocount.pts", &THREE);
    assert_eq!(cloud.intensity, INTENSITIES);
    assert!(
        remarks.contains("does not begin with the number"),
        "{remarks}"
    );
    let (_, remarks) = assert_points("pts-count/more.pts", &THREE);
    assert!(
        remarks.contains("announces 2 points and has 3"),
        "{remarks}"
    );
    let (cloud, _) = read("pts_no_count/nc.pts");
    assert_eq!(cloud.intensity, [-640.0, -366.0]);
    let (cloud, _) = assert_points("pts_no_count/wl.pts", &UTM);
    assert_eq!(cloud.intensity, INTENSITIES);
}

#[test]
fn lone_returns_end_lines() {
    assert_points("cr_only/cr.xyz", &UTM);
    let samples = read_imu(&case("cr_only/ic.csv")).unwrap();
    assert_eq!(samples.len(), 20);
    assert_eq!(samples[19].time_s, 1_700_000_000.19);
}

#[test]
fn a_column_is_kept_with_gaps() {
    for name in ["sn.csv", "se.csv"] {
        let (cloud, remarks) = read(&format!("one_nan_drops_column/{name}"));
        assert_eq!(some(&cloud.intensity), [None, Some(7.0)], "{name}");
        assert!(
            remarks.contains("1 of 2 points have no intensity"),
            "{remarks}"
        );
    }
    let (cloud, _) = read("one_nan_drops_column/te.csv");
    assert_eq!(some(&cloud.time_s), [Some(100.5), None, Some(101.0)]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    std::fs::write(
        &path,
        "x\ty\tz\tRed\tIntensity\n1\t2\t3\t\t7\n4\t5\t6\t255\t\n",
    )
    .unwrap();
    assert_eq!(
        some(&read_cloud(&path).unwrap().intensity),
        [Some(7.0), None]
    );
    // In the native table, too.
    std::fs::write(
        &path,
        "east_m,north_m,up_m,intensity\n1,2,3,nan\n,,,5\n4,5,6,7\n",
    )
    .unwrap();
    let cloud = read_cloud(&path).unwrap();
    assert_eq!(some(&cloud.intensity), [None, Some(7.0)]);
}

#[test]
fn rows_without_numbers_are_left_out() {
    let (cloud, _) = read("nan_text/sn.xyz");
    assert_eq!(cloud.points.len(), 3);
    let points = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let (_, remarks) = assert_points("text/xyz_nan.xyz", &points);
    assert!(
        remarks.contains("left out: 1 record without a position"),
        "{remarks}"
    );
}

#[test]
fn headers_of_other_languages_name_coordinates() {
    for name in ["hn.csv", "he.csv", "hd.csv", "hc.txt"] {
        let (cloud, _) = assert_points(&format!("csv_names/{name}"), &UTM);
        assert_eq!(cloud.intensity, INTENSITIES, "{name}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    for text in [
        "EASTING,NORTHING,HEIGHT\n1.5,2.5,3.5\n",
        "Rechtswert;Hochwert;Höhe\n1,5;2,5;3,5\n",
        "X[mm] Y[mm] Z[mm]\n1500 2500 3500\n",
        "x,y,z\n1.5 2.5 3.5\n",
        "x y z\n1.5 2.5 3.5 # by hand\n",
        "x;y;z\n\"1,5\";\"2,5\";\"3,5\"\n",
        "x,y,z\n\"1.5\",\"2.5\",\"3.5\",\n",
        "x,y,z,time\n1.5,2.5,3.5,2023-11-14T22:13:20Z\n",
    ] {
        std::fs::write(&path, text).unwrap();
        let cloud = read_cloud(&path).unwrap();
        let point: Vec<f64> = cloud.points[0].iter().copied().collect();
        assert_eq!(point, [1.5, 2.5, 3.5], "{text}");
        let has_time = text.contains("time");
        assert_eq!(cloud.time_s.first(), has_time.then_some(&1.7e9), "{text}");
    }
    std::fs::write(&path, "x;y;z\n364'500.25;5,621,000.5;61\n").unwrap();
    let point = read_cloud(&path).unwrap().points[0];
    assert_eq!((point.x, point.y), (364_500.25, 5_621_000.5));
}

#[test]
fn decimal_commas_are_read_and_named() {
    for name in ["dc.xyz", "dcb.xyz"] {
        let (_, remarks) = assert_points(&format!("decimal_comma/{name}"), &UTM);
        assert!(
            remarks.contains("commas are read as decimal marks"),
            "{remarks}"
        );
    }
    let (cloud, _) = assert_points("decimal_comma/dch.csv", &UTM);
    assert_eq!(cloud.intensity, INTENSITIES);
    let (cloud, _) = assert_points("decimal_comma/qd.csv", &[[1.5, 2.5, 3.5]]);
    assert_eq!(cloud.intensity, [7.0]);
    assert_points("text/xyz_semidec.xyz", &THREE[..2]);
    // Between commas, decimal commas cannot be told from separators.
    let text = error("text/xyz_commadec.xyz");
    assert!(text.contains("may be decimal commas"), "{text}");
}

#[test]
fn what_follows_the_values_is_passed_over() {
    assert_points("trailing_comma/tcn.xyz", &UTM);
    let points = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    assert_points("text/xyz_trail.xyz", &points);
}

#[test]
fn tables_of_spreadsheets_are_read() {
    for name in ["imu_quoted", "imu_semidec", "imu_sep", "imu_trail"] {
        let samples = read_imu(&case(&format!("text/{name}.csv"))).unwrap();
        assert_eq!(samples.len(), 5, "{name}");
        let (gyro, accel) = (samples[4].gyro_rad_s, samples[4].accel_m_s2);
        assert_eq!(samples[4].time_s, 1_700_000_000.04, "{name}");
        assert_eq!((gyro.z, accel.y, accel.z), (0.03, 0.2, 9.81), "{name}");
    }
    // The header that the book recommends above a log with blanks.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    std::fs::write(&path, "time_s, heading_deg\n1.5 90\n2.5 91\n").unwrap();
    assert_eq!(inspect(&path).unwrap().count, 2);
}

#[test]
fn text_of_16_bits_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let text = std::fs::read_to_string(case("csv_names/hn.csv")).unwrap();
    let units: Vec<u16> = "\u{feff}"
        .encode_utf16()
        .chain(text.encode_utf16())
        .collect();
    for to_bytes in [u16::to_le_bytes, u16::to_be_bytes] {
        let bytes: Vec<u8> = units.iter().flat_map(|unit| to_bytes(*unit)).collect();
        std::fs::write(&path, bytes).unwrap();
        let cloud = read_cloud(&path).unwrap();
        assert_eq!(cloud.intensity, INTENSITIES);
        assert_eq!(cloud.points[2].y, UTM[2][1]);
    }
}

#[test]
fn tables_without_a_header_that_are_no_clouds_are_refused() {
    for (name, expected) in [
        ("pnezd_numonly.csv", "points with their numbers"),
        (
            "time_xyz_rpy_nohead.txt",
            "time, position and roll, pitch, yaw",
        ),
    ] {
        let text = error(&format!("headerless-as-cloud/{name}"));
        assert!(text.contains(expected), "{text}");
    }
    // An IMU log of EuRoC, and no cloud.
    let text = read_cloud(&case("headerless-as-cloud/nohead.csv")).unwrap_err();
    assert!(text.to_string().contains("IMU log (EuRoC)"), "{text}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    let rows = |second: f64| format!("2245 {second} 50.7253 7.0880 63.2 1\n");
    std::fs::write(&path, rows(345_600.0) + &rows(345_601.0) + &rows(345_602.0)).unwrap();
    let text = read_cloud(&path).unwrap_err().to_string();
    assert!(text.contains("GPS weeks and seconds of the week"), "{text}");
}

#[test]
fn lists_of_points_with_ids_are_read_by_their_header() {
    let points = [
        [352_000.123, 5_646_000.456, 95.277],
        [352_001.123, 5_646_001.456, 95.377],
        [352_002.123, 5_646_002.456, 95.477],
    ];
    // Between tabs, `Point ID` is one name.
    let (_, remarks) = assert_points("formats-refused/leica_infinity.txt", &points[..2]);
    assert!(
        remarks.contains("the columns Point ID, Code are left out"),
        "{remarks}"
    );
    // The order of north and east cannot be known without a header. With the one that the error names, it is.
    let folder = tempfile::tempdir().unwrap();
    for (name, count, found, header) in [
        (
            "pnezd_num.csv",
            3,
            "points with their names and codes",
            "id,northing,easting,height,code",
        ),
        (
            "trimble_pts.csv",
            2,
            "points with their names and codes",
            "id,easting,northing,height,code",
        ),
        (
            "pnezd_numonly.csv",
            3,
            "points with their numbers",
            "id,northing,easting,height",
        ),
    ] {
        let text = error(&format!("formats-refused/{name}"));
        assert!(
            text.contains("without a header") && text.contains(found),
            "{text}"
        );
        assert!(text.contains(&format!("`{header}`")), "{text}");
        let rows = std::fs::read_to_string(case("formats-refused").join(name)).unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, format!("{header}\n{rows}")).unwrap();
        let cloud = read_cloud(&path).unwrap();
        let expected: Vec<Vec3> = points[..count].iter().map(|p| Vec3::from(*p)).collect();
        assert_eq!(cloud.points, expected);
    }
    // Blanks between the values of a row, and no code in the last one.
    let path = folder.path().join("a.txt");
    let text = "Point ID\tX\tY\tZ\tCode\nP 1\t1\t2\t3\tTOP OF WALL\nP2\t4\t5\t6\n";
    std::fs::write(&path, text).unwrap();
    let cloud = read_cloud(&path).unwrap();
    let last: Vec<f64> = cloud.points[1].iter().copied().collect();
    assert_eq!((cloud.points.len(), last), (2, vec![4.0, 5.0, 6.0]));
}
