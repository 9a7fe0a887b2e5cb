//! What several integration tests need.
#![allow(dead_code, clippy::unwrap_used)] // each test uses its part; helpers fail as tests do

use std::path::PathBuf;

/// The file or folder `name` of the data that lie beside the repository; prints `skipped` and
/// returns `None` where they are not there.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/data")
        .join(name);
    if path.exists() {
        Some(path)
    } else {
        println!("skipped: {} is not there", path.display());
        None
    }
}

/// One board, two passes, ten coarse profiles a second.
pub const TINY_SCENARIO: &str = r#"
name = "tiny"
boards = [{ center_m = [1.2, 1.2, 0.5], tilt_deg = 30.0, azimuth_deg = 70.0, size_m = [1.0, 1.0] }]
drives = [{ passes = [{ board = 0, heading_deg = 90.0 }, { board = 0, heading_deg = 270.0 }] }]
[field]
size_m = [2.4, 2.4]
margin_m = 4.0
[profiles]
rate_hz = 10.0
width = 64
[reference]
board_spacing_m = 0.015
soil_spacing_m = 0.03
[motion]
rest_s = 3.0
"#;

/// How a run of the binary ended.
pub struct Run {
    /// Exit code, −1 where a signal ended it.
    pub code: i32,
    /// What it wrote to stdout.
    pub out: String,
    /// What it wrote to stderr.
    pub err: String,
}

/// Runs the binary with `arguments`.
pub fn boresight(arguments: &[&str]) -> Run {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_boresight"))
        .args(arguments)
        .output()
        .unwrap();
    Run {
        code: output.status.code().unwrap_or(-1),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// A folder with a small drive: 30 s northwards at 0.5 m/s on level ground, IMU at 50 Hz, prism at
/// 5 Hz, one scanner with ten profiles a second that look straight down on a plane and a step.
pub fn project_of_logs() -> tempfile::TempDir {
    use std::fmt::Write;

    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "project.toml",
        r#"[imu]
file = "imu.csv"

[prism]
file = "prism.csv"
lever_arm_m = [0.10, 0.05, -0.55]

[[scanner]]
name = "left"
profiles = "left.csv"
translation_m = [1.2, -0.5, 0.5]
rotation_deg = [-145.0, 0.0, 90.0]
rotation_convention = "bonn"
"#,
    );
    let mut imu = "time_s, gyro_x_rad_s, gyro_y_rad_s, gyro_z_rad_s, accel_x_m_s2, accel_y_m_s2, accel_z_m_s2\n".to_owned();
    for i in 0..1500 {
        let _ = writeln!(imu, "{:.3}, 0, 0, 0, 0, 0, -9.81", f64::from(i) / 50.0);
    }
    write("imu.csv", &imu);
    // The body (FRD) heads north with its IMU 2 m above the ground: x is north, y east, z down.
    let mut prism = "time_s, east_m, north_m, up_m\n".to_owned();
    for i in 0..150 {
        let time = f64::from(i) / 5.0 + 0.01;
        let _ = writeln!(prism, "{time:.3}, 0.05, {:.4}, 2.55", 0.5 * time + 0.10);
    }
    write("prism.csv", &prism);
    let mut profiles = "time_s, x_m, z_m\n".to_owned();
    for i in 0..250 {
        for j in -20..=20 {
            let x = f64::from(j) * 0.02;
            let z = if (100..150).contains(&i) { -1.5 } else { -1.7 };
            let _ = writeln!(profiles, "{:.3}, {x:.3}, {z:.3}", f64::from(i) / 10.0 + 1.0);
        }
    }
    write("left.csv", &profiles);
    folder
}
