//! Trajectories with roll, pitch and heading as other programs write them.

use std::fs;

use boresight::format::{self, inspect};
use boresight::geometry::heading::heading_rad;
use boresight::geometry::{BodyAxes, Vec3};

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
