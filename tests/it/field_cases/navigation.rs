//! Trajectories with roll, pitch and heading, and positions of GNSS receivers, as other programs write them.

use std::fs;

use boresight::format::{self, inspect};
use boresight::geometry::attitude::roll_pitch_heading;
use boresight::geometry::heading::heading_rad;
use boresight::geometry::{BodyAxes, Projection, Vec3};
use boresight::sensor::{FixQuality, Observations, PoseRecord};

use super::logs::sample;
use crate::common::boresight;

const HEADER: &str = "time_s,east_m,north_m,up_m,roll_deg,pitch_deg,heading_deg";

#[test]
fn poses_whose_yaw_is_not_stated_are_read_under_names_that_state_it() {
    let folder = tempfile::tempdir().unwrap();
    for (name, found) in [
        (
            "riegl_pof.csv",
            "poses with angles whose zero and direction",
        ),
        ("pix4d.txt", "poses with angles whose zero and direction"),
        (
            "time_xyz_rpy_nohead.txt",
            "time, position and roll, pitch, yaw",
        ),
    ] {
        let path = sample("formats-refused").join(name);
        boresight(&["inspect", path.to_str().unwrap()]).assert_failed_with(&[found, HEADER]);
        // As the message says.
        let text = fs::read_to_string(&path).unwrap();
        let is_row = |line: &&str| line.starts_with(|c: char| c.is_ascii_digit());
        let rows: Vec<&str> = text.lines().filter(is_row).collect();
        let path = folder.path().join(name);
        fs::write(&path, format!("{HEADER}\n{}\n", rows.join("\n"))).unwrap();
        assert_eq!(inspect(&path).unwrap().count, 2);
        let poses = format::read_projected_trajectory(&path, BodyAxes::Flu, None).unwrap();
        let pose = &poses[1];
        assert_eq!(pose.time_s, 292_500.005);
        let at_m = pose.world_from_body.translation_m;
        assert_eq!(at_m, Vec3::new(352_000.124, 5_646_000.458, 95.277));
        let heading_deg = heading_rad(&pose.world_from_body.rotation).to_degrees();
        assert!(
            (heading_deg - (341.33 - 360.0)).abs() < 1e-9,
            "{heading_deg}"
        );
        let ahead = pose.world_from_body.rotation * Vec3::x();
        assert!((ahead.z.asin().to_degrees() + 0.43).abs() < 1e-9);
    }
}

/// The system of the samples with latitudes.
fn utm32() -> Projection {
    Projection::new("EPSG:25832").unwrap()
}

/// Asserts the place of the first row of the samples, and their heading of 341.33 degrees from true north, which is
/// 1.6347 degrees more from the north of the grid. By the series of Krüger to the fourth order.
fn assert_place(pose: &PoseRecord) {
    let expected = Vec3::new(352_189.891_248_1, 5_646_846.106_289_1, 95.277);
    let off_m = (pose.world_from_body.translation_m - expected).norm();
    assert!(off_m < 2e-4, "{off_m}");
    let [roll, pitch, heading] =
        roll_pitch_heading(&pose.world_from_body.rotation).map(f64::to_degrees);
    assert!((roll - 0.12).abs() < 1e-9 && (pitch + 0.43).abs() < 1e-9);
    assert!(
        (heading - (341.33 + 1.634_738 - 360.0)).abs() < 1e-6,
        "{heading}"
    );
}

#[test]
fn exports_of_pospac_are_poses_with_latitudes() {
    let path = sample("formats-refused/pospac.txt");
    let run = boresight(&["inspect", path.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    for expected in [
        "POSPac text export",
        "341.330000 to 341.330000 °",
        "`Time: UTC seconds of day`",
    ] {
        assert!(run.out.contains(expected), "{}", run.out);
    }
    let crs = utm32();
    let read = |axes, crs| format::read_projected_trajectory(&path, axes, crs);
    let poses = read(BodyAxes::Flu, Some(&crs)).unwrap();
    let times_s: Vec<f64> = poses.iter().map(|pose| pose.time_s).collect();
    assert_eq!(times_s, [33_300.0, 33_300.005]);
    assert_place(&poses[0]);
    assert_eq!((poses[0].velocity_m_s, poses[0].sigma), (None, None));
    let down = read(BodyAxes::Frd, Some(&crs)).unwrap()[0]
        .world_from_body
        .rotation
        * Vec3::z();
    assert!(down.z < -0.99);
    let error = read(BodyAxes::Flu, None).unwrap_err().to_string();
    assert!(
        error.contains("pospac.txt") && error.contains("`crs`"),
        "{error}"
    );
    // It is written like any other trajectory.
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("a.tum");
    let convert = |more: &[&str]| {
        let files = ["convert", path.to_str().unwrap(), to.to_str().unwrap()];
        boresight(&[&files[..], more].concat())
    };
    convert(&[]).assert_failed_with(&["latitudes and longitudes"]);
    let run = convert(&["--crs", "EPSG:25832", "--axes", "FLU"]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert_place(&format::read_trajectory(&to).unwrap()[0]);
}

/// The checksum of NovAtel, bit by bit.
fn novatel_sum(text: &str) -> u32 {
    text.bytes().fold(0, |sum, byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    })
}

#[test]
fn logs_of_novatel_are_poses_and_positions() {
    let path = sample("formats-refused/novatel.txt");
    // The checksums of this sample are made up.
    boresight(&["inspect", path.to_str().unwrap()])
        .assert_failed_with(&["0 positions (BESTPOSA), left out: 1 with a wrong checksum"]);
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("novatel.txt");
    let text = fs::read_to_string(&path).unwrap();
    let with_sum = |line: &str| {
        let text = line.trim_start_matches('#').split('*').next().unwrap();
        format!("#{text}*{:08x}\r\n", novatel_sum(text))
    };
    fs::write(&whole, text.lines().map(with_sum).collect::<String>()).unwrap();
    let unix_s = 1_691_572_500.0 - 18.0;
    let poses = format::read_projected_trajectory(&whole, BodyAxes::Flu, Some(&utm32())).unwrap();
    assert_eq!((poses.len(), poses[0].time_s), (1, unix_s));
    assert_place(&poses[0]);
    let sigma = poses[0].sigma.unwrap();
    assert!((sigma.position_m - Vec3::new(0.01, 0.01, 0.02)).norm() < 1e-9);
    assert!((sigma.rotation_rad.z.to_degrees() - 0.1).abs() < 1e-5);
    let read = format::read_projected_positions(&whole, &Observations::AsFound, Some(&utm32()));
    let positions = read.unwrap();
    let fix = positions.fixes[0];
    assert_eq!(
        (fix.time_s, positions.qualities[0]),
        (unix_s, FixQuality::Fixed)
    );
    assert!((fix.position_m.z - 95.2771).abs() < 1e-9);
    let up_m = fix.covariance_m2.unwrap().m33.sqrt();
    assert!((up_m - 0.0273).abs() < 1e-9, "{up_m}");
    let run = boresight(&["inspect", whole.to_str().unwrap()]);
    assert!(
        run.out.contains("1 INSPVAXA, 1 BESTPOSA"),
        "{} {}",
        run.out,
        run.err
    );
}

#[test]
fn tracks_of_gpx_are_positions_if_their_heights_are_known() {
    let path = sample("formats-refused/drive.gpx");
    boresight(&["inspect", path.to_str().unwrap()]).assert_failed_with(&[
        "0 track points, left out: 1 whose height may count from the sea or from the ellipsoid",
        "time, ele and geoidheight",
    ]);
    let folder = tempfile::tempdir().unwrap();
    let known = folder.path().join("drive.gpx");
    let text = fs::read_to_string(&path).unwrap();
    let text = text.replace("</time>", "</time><geoidheight>46.9</geoidheight>");
    fs::write(&known, text).unwrap();
    let read = format::read_projected_positions(&known, &Observations::AsFound, Some(&utm32()));
    let positions = read.unwrap();
    assert_eq!(positions.fixes[0].time_s, 1_691_572_500.0);
    assert_eq!(positions.qualities, [FixQuality::Single]);
    let expected = utm32()
        .project(50.95f64.to_radians(), 6.89f64.to_radians())
        .unwrap();
    let place_m = positions.fixes[0].position_m;
    assert_eq!((place_m.x, place_m.y), (expected.east_m, expected.north_m));
    assert!((place_m.z - 142.1).abs() < 1e-9);
}
