//! The UAV lidar data `boresight_truck` (see `tests/data/README.md`); shared by tests and examples.

use std::path::{Path, PathBuf};

use boresight::geometry::{Vec3, so3};
use boresight::project::Project;

/// Rotation vector of an independent multi-start fit of the mean omnivariance, degrees.
pub const KNOWN_DEG: [f64; 3] = [1.48, -0.81, 0.30];

pub fn truck() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/boresight_truck/Truck.adc.laz")
}

/// The whole file as one 3D scanner with a fixed lever arm.
pub fn project(start_deg: Vec3, folder: &Path) -> Project {
    project_with("", start_deg, folder)
}

/// The same, with further lines in the table of the trajectory.
pub fn project_with(trajectory_lines: &str, start_deg: Vec3, folder: &Path) -> Project {
    let start = so3::exp(&start_deg.map(f64::to_radians));
    let q = start.coords;
    let laz = truck();
    let text = format!(
        r#"
        [trajectory]
        file = "{0}"
        {5}
        [[scanner]]
        name = "lidar"
        profiles = "{0}"
        translation_m = [0.0, 0.0, 0.0]
        quaternion_xyzw = [{1}, {2}, {3}, {4}]
        fixed = ["tx", "ty", "tz"]
        [calibration]
        voxel_sizes_m = [2.0, 1.0, 0.5, 0.25, 0.1, 0.05]
        neighbours = 20
        "#,
        laz.display(),
        q.x,
        q.y,
        q.z,
        q.w,
        trajectory_lines
    );
    let path = folder.join("project.toml");
    std::fs::write(&path, text).unwrap();
    Project::read(&path).unwrap()
}
