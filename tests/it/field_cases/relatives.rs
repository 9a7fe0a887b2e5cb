//! Relatives of the other field cases: in `relatives`, and in short texts made here.

use std::fs;
use std::path::PathBuf;

use boresight::format::{self, Input, inspect, read_cloud};
use boresight::geometry::Vec3;
use boresight::sensor::Observations;

use super::logs::sample;
use super::logs_recordings::times_s;
use crate::common::boresight;

/// A file of the folder.
fn relative(name: &str) -> Input {
    Input::from(&sample("relatives").join(name))
}

/// A file with this text, which lives as long as its folder.
fn written(name: &str, text: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    (folder, path)
}

/// The points of a text, and what was said.
fn points(name: &str, text: &str) -> (Vec<Vec3>, String) {
    let (_folder, path) = written(name, text);
    let input = Input::from(&path);
    let cloud = read_cloud(&input).unwrap();
    (cloud.points, input.remarks().join("\n"))
}

#[test]
fn missing_values_never_become_numbers() {
    let (found, remarks) = points(
        "a.xyz",
        "1 2 nan\n4 5 6\n8 8 1.#QNAN\n4 5 -1.#IND\n7 8 9 # end\n",
    );
    assert_eq!(found, [Vec3::new(4.0, 5.0, 6.0), Vec3::new(7.0, 8.0, 9.0)]);
    assert!(
        remarks.contains("3 records without a position"),
        "{remarks}"
    );
    let (found, _) = points(
        "a.csv",
        "X,Y,Z,I\n1,2,3,4\n5,5,#N/A,7\n7,8,9,*****\n7,8,-,1\n",
    );
    assert_eq!(found.len(), 2);
}

#[test]
fn points_beside_decimal_commas_group_digits_or_are_refused() {
    let (found, _) = points(
        "a.csv",
        "X;Y;Z;I\n1.234,5;2.345;61,25;10\n1.235,5;2.346;62,5;20\n",
    );
    assert_eq!(found[0], Vec3::new(1234.5, 2345.0, 61.25));
    let (_folder, path) = written(
        "a.csv",
        "X;Y;Z\n364.500;621.000;61,25\n364.501;621.001;62,5\n",
    );
    let error = read_cloud(&path).unwrap_err().to_string();
    assert!(error.contains("line 2: found `61,25`"), "{error}");
}

#[test]
fn rows_of_native_tables_without_a_value_are_left_out() {
    let imu =
        "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n";
    for (header, row, missing, count) in [
        (imu, "{t},0,0,0,0,0,9.81", "{t},nan,0,0,0,0,9.81", 4),
        ("time_s,heading_deg\n", "{t},5", "{t},", 4),
        (
            "time_s,east_m,north_m,up_m\n",
            "{t},1,2,3",
            "{t},1,NaN,3",
            4,
        ),
        ("time_s,x_m,z_m\n", "{t},1,2", "{t},n/a,2", 4),
        ("east_m,north_m,up_m\n", "{t},1,2", "{t},,2", 4),
        (
            "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n",
            "{t},1,2,3,0,0,0,1",
            "{t},1,2,3,0,0,0,nan",
            4,
        ),
        (
            "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n",
            "{t},1,2,3,0,0,0,1",
            "{t},1,2,3,0,0,0,0",
            5,
        ),
    ] {
        let rows = (0..5)
            .map(|i| if i == 3 { missing } else { row }.replace("{t}", &i.to_string()) + "\n");
        let (_folder, path) = written("a.csv", header.to_owned() + &rows.collect::<String>());
        let found = inspect(&path).unwrap();
        assert_eq!(found.count, count, "{header}");
        let poses = header.contains("qx").then(|| {
            let input = Input::from(&path);
            let poses = format::read_trajectory(&input).unwrap();
            assert!(input.remarks().join("\n").contains("left out"), "{header}");
            poses.len()
        });
        assert!(poses.is_none_or(|count| count == 4), "{header}");
        let is_said = found.notes.join("\n").contains("left out: ");
        assert!(is_said || count == 5, "{header}: {:?}", found.notes);
    }
}

#[test]
fn arrays_are_turned_and_raw_integers_are_refused() {
    let cloud = read_cloud(relative("n_T5.npy")).unwrap();
    assert_eq!(cloud.points.len(), 5);
    let cloud = read_cloud(relative("n_align.npy")).unwrap();
    assert_eq!((cloud.points.len(), cloud.time_s.len()), (2, 2));
    let error = read_cloud(relative("n_lasraw.npy"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("without their scale and offset"), "{error}");
}

#[test]
fn clouds_with_a_wrong_stamp_are_left_out_and_named() {
    for (name, left, right) in [
        ("s30_dup.mcap", 29, "1 of 30 messages"),
        ("s30_back300.mcap", 29, "1 of 30 messages"),
        ("pc_onestamp0.mcap", 11, "1 of 12 messages"),
    ] {
        let (found, remarks) = times_s(&relative(name));
        assert_eq!(found.len(), 6 * left, "{name}: {remarks}");
        assert!(remarks.contains(right), "{name}: {remarks}");
    }
}

#[test]
fn units_and_names_of_the_times_of_points_are_asked_for() {
    for (name, asked) in [
        ("pc_t_u4_ms.mcap", "they may be milliseconds"),
        ("pc_ts.mcap", "the field ts, whose meaning is not known"),
    ] {
        let error = inspect(relative(name)).unwrap_err().to_string();
        assert!(error.contains(asked), "{name}: {error}");
    }
}

#[test]
fn points_without_a_time_or_a_place_are_counted() {
    for (name, reason) in [
        ("pc_onenan.mcap", "1 point with a time that is no number"),
        ("pc_onehuge.mcap", "1 point with a time that is no number"),
        ("pc_xyz_nan.mcap", "4 points without finite coordinates"),
    ] {
        let (_, remarks) = times_s(&relative(name));
        assert!(remarks.contains(reason), "{name}: {remarks}");
    }
    let input = relative("t_nan.las");
    let cloud = read_cloud(&input).unwrap();
    assert_eq!((cloud.points.len(), cloud.time_s[0]), (6, 100.0));
    assert!(
        input
            .remarks()
            .join("\n")
            .contains("1 of 6 points have no time")
    );
    let input = relative("ply_f32time_be.ply");
    assert!(read_cloud(&input).unwrap().time_s.is_empty());
    assert!(input.remarks().join("\n").contains("steps of 128 s"));
    let notes = |name| inspect(relative(name)).unwrap().notes.join("\n");
    assert!(notes("t_unixflagstd.las").contains("is 2065-07-27"));
    assert!(notes("c_less.las").contains("8 points beyond the 12 points"));
}

#[test]
fn texts_of_windows_and_lone_returns_are_read() {
    assert_eq!(read_cloud(relative("hl1.csv")).unwrap().points.len(), 3);
    assert!(inspect(relative("lone.gsi")).unwrap().count > 3);
    let error = read_cloud(relative("flip.e57")).unwrap_err().to_string();
    assert!(error.contains("a wrong checksum of page 1"), "{error}");
}

#[test]
fn logs_have_dates_and_decimal_commas() {
    let text = "time;heading_deg\n2023-11-14T22:13:20.0Z;1,5\n2023-11-14T22:13:21.5Z;2,5\n";
    let (_folder, path) = written("a.csv", text);
    let found = format::read_heading(&path).unwrap();
    assert_eq!(found[1].time_s, 1_700_000_001.5);
    for (separator, end) in [(";", "timestamp;tx;ty;tz;qx;qy;qz;qw\n"), (" ", "")] {
        let row =
            |time: &str| [time, "0,5", "2,0", "3,0", "0,0", "0,0", "0,6", "0,8"].join(separator);
        let rows = ["10,0", "10,1", "10,3", "10,2"].map(row).join("\n");
        let (_folder, path) = written("a.tum", format!("{end}{rows}\n"));
        let poses = format::read_trajectory(&path).unwrap();
        assert_eq!(poses.len(), 3, "{separator}");
        assert_eq!(
            poses[0].world_from_body.translation_m,
            Vec3::new(0.5, 2.0, 3.0)
        );
    }
}

#[test]
fn positions_with_times_and_angles_are_positions_and_said_so() {
    let text =
        "time_s,east_m,north_m,up_m,roll_deg,pitch_deg,yaw_deg\n1,2,3,4,0,1,2\n2,2,3,4,0,1,2\n";
    let (_folder, path) = written("a.csv", text);
    assert!(
        inspect(&path)
            .unwrap()
            .notes
            .join("\n")
            .contains("only the positions are read")
    );
    let input = Input::from(&path);
    format::read_positions(&input, &Observations::AsFound).unwrap();
    assert!(
        input
            .remarks()
            .join("\n")
            .contains("only the positions are read")
    );
}

#[test]
fn poses_of_two_bodies_are_not_mixed() {
    let folder = tempfile::tempdir().unwrap();
    let poses = |aside: f64, later: f64| -> String {
        let row = |i: i32| {
            format!(
                "{} {} {aside} 0 0 0 0 1\n",
                0.01 * f64::from(i) + later,
                0.01 * f64::from(i)
            )
        };
        (0..300).map(row).collect()
    };
    fs::write(folder.path().join("a.tum"), poses(0.0, 0.0)).unwrap();
    fs::write(folder.path().join("b.tum"), poses(5.0, 0.004)).unwrap();
    let path = folder.path().to_str().unwrap();
    let run = boresight(&["init", path]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(
        run.out
            .contains("poses of another sensor at the same time as a.tum"),
        "{}",
        run.out
    );
    let project = folder.path().join("project.toml");
    let text = fs::read_to_string(&project).unwrap();
    assert!(text.contains("file = \"a.tum\""), "{text}");
    fs::write(
        &project,
        text.replace("\"a.tum\"", "[\"a.tum\", \"b.tum\"]"),
    )
    .unwrap();
    boresight(&["trajectory", project.to_str().unwrap()])
        .assert_failed_with(&["different poses at the same times"]);
}

#[test]
fn a_hopeless_file_keeps_back_no_other_copy() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(at("a.csv"), "no table\n").unwrap();
    fs::write(at("b.csv"), "time_s,heading_deg\n1,2\n3,4,5\n6,7\n").unwrap();
    let run = boresight(&[
        "salvage",
        &at("a.csv"),
        &at("b.csv"),
        "--out",
        &at("copies"),
    ]);
    assert_eq!(run.code, 1, "{}{}", run.out, run.err);
    assert!(run.out.contains("a.csv: nothing kept"), "{}", run.out);
    let copy = fs::read_to_string(folder.path().join("copies/b.csv")).unwrap();
    assert_eq!(copy, "time_s,heading_deg\n1,2\n6,7\n");
    assert!(!folder.path().join("copies/a.csv").exists());
}
