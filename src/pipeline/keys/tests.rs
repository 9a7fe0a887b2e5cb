//! Tests which changes of a project affect which keys.

use std::fs;
use std::path::Path;

use super::*;
use crate::progress::Silent;

/// A project with two further drives: one is adjusted together with the first, the other is evaluated.
const PROJECT: &str = r#"[imu]
file = "imu.csv"
[prism]
file = "prism.csv"
lever_arm_m = [0.1, 0.05, -0.55]
sigma_m = 0.005
[[scanner]]
name = "left"
profiles = "left.csv"
translation_m = [1.2, -0.5, 0.5]
rotation_deg = [-145.0, 0.0, 90.0]
[reference]
file = "ground.csv"
[calibration]
neighbours = 20
"#;
const OTHERS: &str = r#"[[drive]]
name = "second"
project = "second/project.toml"
[[evaluation]]
name = "third"
project = "third/project.toml"
"#;
const LOGS: [&str; 4] = ["imu.csv", "prism.csv", "left.csv", "ground.csv"];

/// The keys by their names.
fn keys(folder: &Path) -> [(&'static str, String); 5] {
    let project = Project::read(&folder.join("project.toml")).unwrap();
    let inputs = Inputs::read(project.inputs(), &Silent).unwrap();
    let keys = Keys::new(&OpenProject::new(&project), &inputs).unwrap();
    let evaluations: String = keys.evaluations.iter().map(Key::to_string).collect();
    [
        ("reference", keys.reference.to_string()),
        ("poses", keys.poses.to_string()),
        ("calibration", keys.calibration.to_string()),
        ("joint", keys.joint.to_string()),
        ("evaluations", evaluations),
    ]
}

#[test]
fn stages_follow_their_inputs_and_settings() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let write = |drive: &str, text: &str| {
        fs::create_dir_all(at(drive)).unwrap();
        fs::write(at(drive).join("project.toml"), text).unwrap();
        for log in LOGS {
            fs::write(at(drive).join(log), format!("{log} of {drive}")).unwrap();
        }
    };
    write("", &format!("{PROJECT}{OTHERS}"));
    write("second", PROJECT);
    write("third", PROJECT);

    let mut before = keys(folder.path());
    // The keys that a change to a file affects.
    let mut follows = |file: &str, change: &dyn Fn(&str) -> String, expected: &[&str]| {
        let text = fs::read_to_string(at(file)).unwrap();
        fs::write(at(file), change(&text)).unwrap();
        let now = keys(folder.path());
        let pairs = now.iter().zip(&before);
        let changed = pairs.filter(|(now, before)| now != before);
        let names: Vec<&str> = changed.map(|(now, _)| now.0).collect();
        assert_eq!(names, expected, "{file}");
        before = now;
    };
    let longer = |text: &str| format!("{text}.");
    let of_scans = ["calibration", "joint", "evaluations"];
    let of_poses = ["poses", "calibration", "joint", "evaluations"];

    // The content of a file counts, not its name or time.
    follows("prism.csv", &str::to_owned, &[]);
    follows("prism.csv", &longer, &of_poses);
    follows("left.csv", &longer, &of_scans);
    follows(
        "ground.csv",
        &longer,
        &["reference", "calibration", "joint", "evaluations"],
    );
    follows("second/imu.csv", &longer, &["joint", "evaluations"]);
    follows("third/imu.csv", &longer, &["evaluations"]);
    let set = |from: &'static str, to: &'static str| {
        move |text: &str| {
            assert_eq!(text.matches(from).count(), 1, "{from}");
            text.replace(from, to)
        }
    };
    let project = "project.toml";
    follows(
        project,
        &set("sigma_m = 0.005", "sigma_m = 0.006"),
        &of_poses,
    );
    follows(
        project,
        &set("neighbours = 20", "neighbours = 21"),
        &of_scans,
    );
    follows(
        "third/project.toml",
        &set("0.005", "0.006"),
        &["evaluations"],
    );
    // The comparison affects only clouds, and the acceptance limits affect only verdicts.
    let judged = |text: &str| {
        format!("{text}[comparison]\nmin_points = 3\n[acceptance]\nsigma_translation_m = 0.1\n")
    };
    follows(project, &judged, &[]);
    follows(
        project,
        &set("[[drive]]", "[[evaluation]]"),
        &["joint", "evaluations"],
    );
}

#[test]
fn poses_from_a_recording_follow_the_logs_of_its_scanners() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("project.toml"), PROJECT).unwrap();
    for log in LOGS {
        fs::write(at(log), log).unwrap();
    }
    for name in ["left.stamps.csv", "clock.csv", "events.csv"] {
        fs::write(at(name), "").unwrap();
    }
    let poses = || keys(folder.path())[1].1.clone();
    let mut before = poses();
    for file in ["left.csv", "left.stamps.csv"] {
        fs::write(at(file), "salvaged").unwrap();
        let now = poses();
        assert_ne!(now, before, "{file}");
        before = now;
    }
}
