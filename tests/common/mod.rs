//! Helpers shared by several integration tests.

pub mod against_truth;
pub mod consistency;
pub mod demo_drive;
pub mod field_days;
pub mod instrument;
pub mod joint_drive;
pub mod kernels;
pub mod moving;
pub mod random_drive;
pub mod random_series;
pub mod ranks;
pub mod results;
pub mod samples;
pub mod small_field;
pub mod tables;
pub mod truck;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// A file or folder of the data in the repository, see `tests/data/README.md`.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

/// A file or folder of the data outside the repository, which lie in the folder that `BORESIGHT_DATA` names, or in
/// `shared/data` beside the checkout. `None`, with a message, if there is no such folder: the test is then skipped.
/// If the folder exists and the file is missing in it, the test fails.
pub fn external_data(name: &str) -> Option<PathBuf> {
    let named = std::env::var_os("BORESIGHT_DATA").filter(|folder| !folder.is_empty());
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = named.clone().map_or_else(beside, PathBuf::from);
    if named.is_none() && !folder.is_dir() {
        // Not with `println`, whose output is shown only for tests that fail.
        let _ = writeln!(std::io::stderr(), "skipped: no {}", folder.display());
        return None;
    }
    let path = folder.join(name);
    assert!(path.exists(), "{} is missing", path.display());
    Some(path)
}

/// The bytes of all files below a folder, by their relative paths.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_owned();
                files.insert(name, std::fs::read(path).unwrap());
            }
        }
    }
    files
}

/// Writes files below a folder, by their relative paths.
pub fn write_files(files: &BTreeMap<PathBuf, Vec<u8>>, folder: &Path) {
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}

/// The source folders: that of the package, then those of its crates.
pub fn source_folders() -> Vec<PathBuf> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = std::fs::read_dir(package.join("crates")).unwrap();
    let crates = crates.map(|entry| entry.unwrap().path().join("src"));
    std::iter::once(package.join("src")).chain(crates).collect()
}

/// The names of all entries of a folder, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// One board, two passes, ten coarse profiles per second.
pub const TINY_SCENARIO: &str = include_str!("../data/tiny_scenario.toml");

/// Exit code and output of a run of the binary.
pub struct Run {
    /// Exit code; −1 if a signal ended the run.
    pub code: i32,
    /// Its standard output.
    pub out: String,
    /// Its standard error.
    pub err: String,
}

impl Run {
    /// Asserts that the run failed without a panic, with a message that contains every one of `expected`.
    pub fn assert_failed_with(&self, expected: &[&str]) {
        assert_eq!(self.code, 1, "{}", self.err);
        assert!(!self.err.contains("panicked"), "{}", self.err);
        for expected in expected {
            assert!(
                self.err.contains(expected),
                "should contain: {expected}\n{}",
                self.err
            );
        }
    }
}

/// Runs the binary with `arguments`.
pub fn boresight(arguments: &[&str]) -> Run {
    boresight_at(Path::new("."), arguments)
}

/// Runs the binary with `folder` as its working directory.
pub fn boresight_at(folder: &Path, arguments: &[&str]) -> Run {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_boresight"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    Run {
        code: output.status.code().unwrap_or(-1),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs a command of the binary on `project.toml` in `folder`.
pub fn on_project(folder: &Path, command: &str, more: &[&str]) -> Run {
    let project = folder.join("project.toml");
    boresight(&[&[command, project.to_str().unwrap()], more].concat())
}

/// Cases with their names, for [`side_by_side`].
macro_rules! named {
    ($($case:ident),* $(,)?) => {
        [$((stringify!($case), $case as fn())),*]
    };
}
pub(crate) use named;

/// Runs cases that mostly wait, each in a thread.
pub fn side_by_side<const N: usize>(cases: [(&'static str, fn()); N]) {
    let failed: Vec<&str> = std::thread::scope(|scope| {
        let running = cases.map(|(name, case)| {
            let thread = std::thread::Builder::new().name(name.to_owned());
            (name, thread.spawn_scoped(scope, case).unwrap())
        });
        let failed = running
            .into_iter()
            .filter_map(|(name, thread)| thread.join().err().map(|_| name));
        failed.collect()
    });
    assert!(failed.is_empty(), "{failed:?}");
}

/// The folder of the drive of [`TINY_SCENARIO`], with a space in its path and one coarse scale, and
/// the temporary folder that contains it.
pub fn simulated() -> (tempfile::TempDir, PathBuf) {
    // Holds the files rather than a folder, which a static would never remove.
    static FILES: LazyLock<BTreeMap<PathBuf, Vec<u8>>> = LazyLock::new(simulate_tiny);
    let temp = tempfile::tempdir().unwrap();
    let field = temp.path().join("test field");
    write_files(&FILES, &field);
    let drive = field.join("drive-1");
    (temp, drive)
}

/// Copies the project and the sensors' files of the drive of [`simulated`] into another folder, which is made. The
/// reference is two folders up from there.
pub fn copy_drive(drive: &Path, folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    for name in [
        "imu.csv",
        "prism.csv",
        "heading.csv",
        "left.bin",
        "right.bin",
    ] {
        std::fs::copy(drive.join(name), folder.join(name)).unwrap();
    }
    let text = std::fs::read_to_string(drive.join("project.toml")).unwrap();
    let text = text.replace("\"../tls.laz\"", "\"../../tls.laz\"");
    std::fs::write(folder.join("project.toml"), text).unwrap();
}

/// The files of the field of [`simulated`].
fn simulate_tiny() -> BTreeMap<PathBuf, Vec<u8>> {
    let temp = tempfile::tempdir().unwrap();
    let scenario = temp.path().join("tiny.toml");
    std::fs::write(&scenario, TINY_SCENARIO).unwrap();
    let out = temp.path().join("test field");
    let run = boresight(&[
        "simulate",
        "--scenario",
        scenario.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(run.code, 0, "{}", run.err);
    rewrite_project(&out.join("drive-1"), |text| {
        let lines = text.lines().map(|line| match line.split_once(" = ") {
            Some(("voxel_sizes_m", _)) => "voxel_sizes_m = [0.1]\n".to_owned(),
            Some(("neighbours", _)) => "neighbours = 20\n".to_owned(),
            _ => format!("{line}\n"),
        });
        lines.collect()
    });
    files(&out)
}

/// Runs a command that must fail with exit code 1; arguments that begin with `./` are files in
/// `folder`.
pub fn refused(folder: &Path, arguments: &[&str]) -> Run {
    let paths: Vec<String> = arguments
        .iter()
        .map(|argument| match argument.strip_prefix("./") {
            Some(name) => folder.join(name).to_str().unwrap().to_owned(),
            None => (*argument).to_owned(),
        })
        .collect();
    let run = boresight(&paths.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(run.code, 1, "{arguments:?}: {}{}", run.out, run.err);
    run
}

/// Rewrites a text file.
pub fn rewrite(path: &Path, how: impl FnOnce(&str) -> String) {
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::write(path, how(&text)).unwrap();
}

/// Rewrites `project.toml` in `folder`.
pub fn rewrite_project(folder: &Path, how: impl FnOnce(&str) -> String) {
    rewrite(&folder.join("project.toml"), how);
}

/// Replaces `old`, which must occur exactly once in the project, with `new`.
pub fn change_project(folder: &Path, old: &str, new: &str) {
    rewrite_project(folder, |text| {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        text.replace(old, new)
    });
}

/// Replaces everything before the scanners of the project with `tables`.
pub fn replace_logs(folder: &Path, tables: &str) {
    rewrite_project(folder, |text| {
        format!("{tables}\n{}", &text[text.find("[[scanner]]").unwrap()..])
    });
}

/// A folder with a small drive: 30 s northwards at 0.5 m/s on level ground, IMU at 50 Hz, prism at
/// 5 Hz, one scanner with ten profiles per second that looks straight down on a plane and a step.
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

/// Writes a nearly level plane of points at a height.
pub fn plane(path: &Path, up_m: f64) {
    let mut text = String::from("east_m,north_m,up_m\n");
    for i in 0..150 {
        for j in 0..150 {
            let ripple = 1e-3 * f64::from((7 * i + 3 * j) % 5);
            let (x, y) = (0.01 * f64::from(i), 0.01 * f64::from(j));
            text.push_str(&format!("{x},{y},{}\n", up_m + ripple));
        }
    }
    std::fs::write(path, text).unwrap();
}
