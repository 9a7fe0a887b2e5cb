//! Projects made from the files of a folder, with the real binary.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::common::{self, boresight, change_project, names, rewrite_project, simulated};
use boresight::format::{read_trajectory, write_mounting};
use boresight::project::Project;

fn init(folder: &Path) -> common::Run {
    boresight(&["init", folder.to_str().unwrap()])
}

/// Writes a trajectory with the ten columns of FieldPheno4D: every other pose from `first` on.
fn write_trj(drive: &Path, first: usize, to: &Path) {
    let poses = read_trajectory(&drive.join("truth/trajectory.csv")).unwrap();
    let mut text = String::from("# time x y z vx vy vz roll pitch yaw\n");
    for pose in poses.iter().skip(first).step_by(2) {
        let t = pose.world_from_body.translation_m;
        let (roll, pitch, yaw) = pose.world_from_body.rotation.euler_angles();
        let row = [pose.time_s, t.x, t.y, t.z, 0.0, 0.0, 0.0, roll, pitch, yaw];
        let row: Vec<String> = row.iter().map(|x| format!("{x:.9}")).collect();
        let _ = writeln!(text, "{}", row.join(" "));
    }
    fs::write(to, text).unwrap();
}

#[test]
fn a_folder_of_fieldpheno4d_is_georeferenced_without_editing_the_project() {
    let (temp, drive) = simulated();
    let plot = temp.path().join("Plot01/230516");
    let [profiles, trajectory] = ["01_laserprofiles", "02_trajectory"].map(|name| plot.join(name));
    fs::create_dir_all(&profiles).unwrap();
    fs::create_dir_all(&trajectory).unwrap();
    let project = Project::read(&drive.join("project.toml")).unwrap();
    for (index, (scanner, side)) in project.scanners.iter().zip(["l", "r"]).enumerate() {
        let name = format!("230516_P01_{side}");
        fs::copy(&scanner.profiles[0], profiles.join(format!("{name}.bin"))).unwrap();
        write_trj(&drive, index, &trajectory.join(format!("{name}.trj")));
        let xml = plot.join(format!("system_config_lmi_{side}.xml"));
        write_mounting(&xml, &scanner.body_from_scanner).unwrap();
    }
    let made = init(&plot);
    assert_eq!(made.code, 0, "{}", made.err);
    assert!(
        made.out.contains("Everything that a run needs was found"),
        "{}",
        made.out
    );
    let initialised = Project::read(&plot.join("project.toml")).unwrap();
    let scanners = initialised.scanners.iter();
    let scanners: Vec<&str> = scanners.map(|s| s.name.as_str()).collect();
    assert_eq!(scanners, ["left", "right"]);
    for (read, given) in initialised.scanners.iter().zip(&project.scanners) {
        let (turn, shift) = read
            .body_from_scanner
            .perturbation_from(&given.body_from_scanner);
        assert!(turn.norm() < 1e-7 && shift.norm() < 1e-6);
    }
    let path = plot.join("project.toml");
    let run = boresight(&["georeference", path.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    let written = names(&plot.join("out"));
    assert!(
        written.contains(&"cloud-left.laz".to_owned()),
        "{written:?}"
    );
    // An existing project is not replaced without `--force`.
    let again = init(&plot);
    assert_eq!(again.code, 1);
    assert!(again.err.contains("--force to replace it"), "{}", again.err);
}

#[test]
fn a_project_of_a_folder_of_logs_lacks_only_the_values_that_files_do_not_contain() {
    let (_temp, drive) = simulated();
    let given = Project::read(&drive.join("project.toml")).unwrap();
    let by_tape = fs::read_to_string(drive.join("project.toml")).unwrap();
    fs::remove_file(drive.join("project.toml")).unwrap();
    let made = init(&drive);
    assert_eq!(made.code, 0, "{}", made.err);
    assert!(
        made.out
            .contains("lever_arm_m; translation_m; rotation_deg"),
        "{}",
        made.out
    );
    // The error of a run names the missing value, with its line.
    let path = drive.join("project.toml");
    let run = || boresight(&["inspect", path.to_str().unwrap()]);
    assert!(run().err.contains("lever_arm_m"), "{}", run().err);
    let line = |key: &str| {
        by_tape
            .lines()
            .find(|l| l.starts_with(key))
            .unwrap()
            .to_owned()
    };
    change_project(
        &drive,
        "# lever_arm_m =                   # from the IMU, in the body frame: [x, y, z]",
        &line("lever_arm_m"),
    );
    rewrite_project(&drive, |text| {
        text.lines()
            .map(|l| match l.split_once(" =  ") {
                Some(("# translation_m", _)) => line("translation_m"),
                Some(("# rotation_deg", _)) => line("rotation_deg"),
                _ => l.to_owned(),
            })
            .collect::<Vec<_>>()
            .join("\n")
    });
    let completed = Project::read(&path).unwrap();
    let [completed, given] = [&completed, &given].map(|project| {
        let mut inputs = project.inputs();
        // The reference lies beside the drive.
        inputs.retain(|path| !path.ends_with("tls.laz"));
        inputs.sort();
        inputs
    });
    assert_eq!(completed, given);
}

#[test]
fn folders_without_a_scanner_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("notes.txt"), "nothing\n").unwrap();
    let run = init(folder.path());
    assert_eq!(run.code, 1);
    assert!(
        run.err.contains("none of the 1 files") && run.err.contains("is a recording of a scanner"),
        "{}",
        run.err
    );
    let missing = init(&folder.path().join("not-there"));
    assert!(missing.err.contains("no such folder"), "{}", missing.err);
}

#[test]
fn recordings_alone_give_an_incomplete_project() {
    let folder = tempfile::tempdir().unwrap();
    let bag = common::data("ros").join("plain.mcap");
    fs::copy(bag, folder.path().join("drive.mcap")).unwrap();
    let made = init(folder.path());
    assert_eq!(made.code, 0, "{}", made.err);
    assert!(
        made.out.contains("[imu], or [trajectory] with poses") && made.out.contains("[[scanner]]")
    );
    let text = fs::read_to_string(folder.path().join("project.toml")).unwrap();
    assert!(text.contains("/ouster (sensor_msgs/PointCloud2"), "{text}");
}
