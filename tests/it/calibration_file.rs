//! `calibration.toml` for someone who has only this file.

use std::fs;

use crate::common::{boresight, on_project, simulated};

#[test]
fn a_calibration_says_what_its_numbers_mean() {
    let (_temp, drive) = simulated();
    let calibrated = || {
        let run = on_project(&drive, "calibrate", &[]);
        assert_eq!(run.code, 0, "{}", run.err);
        fs::read_to_string(drive.join("out/calibration.toml")).unwrap()
    };
    let text = calibrated();
    let (comments, tables) = text.split_once("\n[[scanner]]").unwrap();
    assert!(
        comments
            .lines()
            .all(|line| line.is_empty() || line.starts_with('#'))
    );
    for part in [
        "Mountings by boresight",
        "project.toml",
        "times 36000.000 s to ",
        "FRD: x forward, y right, z down",
        "x_body = R x_scanner + translation_m",
        "R = (Rz(γ) Ry(β) Rx(α))ᵀ",
        "Standard deviations (1 σ)",
        "  left: ",
        "  right: ",
    ] {
        assert!(comments.contains(part), "{part}: {comments}");
    }
    // No path of this machine, and the same bytes each time.
    assert!(!text.contains(drive.to_str().unwrap()), "{text}");
    assert!(tables.contains("profiles = \"left.bin\""), "{tables}");
    assert_eq!(calibrated(), text);
    // It is read as before.
    let file = drive.join("out/calibration.toml");
    let urdf = drive.join("mount.urdf");
    let run = boresight(&["convert", file.to_str().unwrap(), urdf.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
}
