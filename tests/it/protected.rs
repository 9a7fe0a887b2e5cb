//! No command replaces a file that it reads: it fails with a message before it computes.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::common::{boresight, project_of_logs, refused};

/// The files in a folder, without those in subfolders.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries
        .filter(|entry| entry.path().is_file())
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            (name, fs::read(entry.path()).unwrap())
        })
        .collect()
}

/// Runs a command in the folder and checks that it refuses to replace `input` and leaves every file
/// unchanged; the log, which gives the reason, may be new.
fn assert_protected(folder: &Path, arguments: &[&str], input: &str) {
    let before = files(folder);
    let run = refused(folder, arguments);
    let named = format!("{input} is an input");
    assert!(run.err.contains(&named), "{arguments:?}: {}", run.err);
    let after = files(folder);
    for (name, bytes) in &before {
        // A refused command may write its log, unless the log is the input.
        assert!(
            after[name] == *bytes || name == "log.txt" && input != "log.txt",
            "{arguments:?}: {name}"
        );
    }
    let new = after.keys().filter(|name| !before.contains_key(*name));
    let new: Vec<&String> = new.filter(|name| *name != "log.txt").collect();
    assert!(new.is_empty(), "{arguments:?}: {new:?}");
}

/// Writes a project; all files that it names exist.
fn project(folder: &Path, text: &str) {
    fs::write(folder.join("p.toml"), text).unwrap();
}

const LOGS: &str = "[imu]\nfile = \"imu.csv\"\n[prism]\nfile = \"prism.csv\"\n\
                    lever_arm_m = [0, 0, 0]\n";
const SCANNER: &str = "[[scanner]]\nname = \"left\"\nprofiles = \"left.csv\"\n\
                       translation_m = [0, 0, 0]\nrotation_deg = [0, 0, 0]\n";

#[test]
fn a_project_and_its_inputs_are_not_replaced() {
    let temp = project_of_logs();
    let folder = temp.path();
    let out = ["--out", "./"];
    let on = |command: &str, project: &str, input: &str| {
        assert_protected(folder, &[&[command, project], &out[..]].concat(), input);
    };
    on("run", "./project.toml", "project.toml");

    let copy = |from: &str, to: &str| fs::copy(folder.join(from), folder.join(to)).unwrap();
    for name in ["trajectory.csv", "report.html", "cloud-left.laz", "log.txt"] {
        copy("imu.csv", name);
    }
    copy("left.csv", "calibration.toml");
    let imu = |name: &str| LOGS.replace("imu.csv", name) + SCANNER;
    project(folder, &imu("trajectory.csv"));
    on("trajectory", "./p.toml", "trajectory.csv");
    assert_protected(
        folder,
        &["trajectory", "./p.toml", "--online", "--out", "./"],
        "trajectory.csv",
    );
    on("run", "./p.toml", "trajectory.csv");
    project(folder, &imu("report.html"));
    on("run", "./p.toml", "report.html");
    project(folder, &imu("log.txt"));
    for command in ["trajectory", "calibrate", "georeference", "run"] {
        on(command, "./p.toml", "log.txt");
    }
    project(
        folder,
        &(LOGS.to_owned() + &SCANNER.replace("left.csv", "calibration.toml")),
    );
    on("calibrate", "./p.toml", "calibration.toml");
    let reference = "[reference]\nfile = \"cloud-left.laz\"\n";
    project(folder, &(LOGS.to_owned() + SCANNER + reference));
    on("georeference", "./p.toml", "cloud-left.laz");
    on("run", "./p.toml", "cloud-left.laz");
    project(folder, &(LOGS.to_owned() + SCANNER));
    for flag in ["--trajectory", "--calibration"] {
        // A mistake in the file would be reported first.
        let valid = match flag {
            "--trajectory" => "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n",
            _ => SCANNER,
        };
        for name in ["cloud-left.laz", "log.txt"] {
            fs::write(folder.join(name), valid).unwrap();
            let given = format!("./{name}");
            assert_protected(
                folder,
                &["georeference", "./p.toml", flag, &given, "--out", "./"],
                name,
            );
        }
    }
    // The logs belong to the project even if they are not read.
    copy("imu.csv", "cloud-left.laz");
    project(folder, &imu("cloud-left.laz"));
    let poses = folder.join("poses.csv");
    fs::write(
        &poses,
        "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n",
    )
    .unwrap();
    assert_protected(
        folder,
        &[
            "georeference",
            "./p.toml",
            "--trajectory",
            "./poses.csv",
            "--out",
            "./",
        ],
        "cloud-left.laz",
    );

    // The inputs of an evaluation drive belong to the project as well.
    project(folder, &imu("trajectory.csv"));
    let evaluation = "[[evaluation]]\nname = \"other\"\nproject = \"p.toml\"\n";
    fs::write(
        folder.join("whole.toml"),
        LOGS.to_owned() + SCANNER + evaluation,
    )
    .unwrap();
    on("run", "./whole.toml", "trajectory.csv");
}

#[test]
fn clouds_are_not_replaced() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let points = "x,y,z\n0,0,0\n1,0,0\n0,1,0\n";
    for name in ["m3c2.csv", "a.csv", "log.txt"] {
        fs::write(folder.join(name), points).unwrap();
    }
    let out = ["--out", "./"];
    let on = |arguments: &[&str], input: &str| {
        assert_protected(folder, &[arguments, &out[..]].concat(), input);
    };
    on(&["compare", "./m3c2.csv", "./a.csv"], "m3c2.csv");
    on(&["compare", "./a.csv", "./m3c2.csv"], "m3c2.csv");
    on(
        &["compare", "./a.csv", "./a.csv", "--core", "./m3c2.csv"],
        "m3c2.csv",
    );
    on(&["thin", "./log.txt", "--voxel-m", "1"], "log.txt");
    on(&["features", "./log.txt"], "log.txt");
    on(&["compare", "./a.csv", "./log.txt"], "log.txt");
    // A file with the name of an output can be the input under another name.
    for name in ["a-features.laz", "a-thinned.laz"] {
        fs::hard_link(folder.join("a.csv"), folder.join(name)).unwrap();
    }
    on(&["features", "./a.csv"], "a.csv");
    on(&["thin", "./a.csv", "--voxel-m", "1"], "a.csv");
}

#[test]
fn a_scenario_is_not_replaced() {
    let temp = tempfile::tempdir().unwrap();
    for name in ["scenario.toml", "tls.laz", "log.txt"] {
        fs::write(temp.path().join(name), "name = \"mine\"\n").unwrap();
        let scenario = format!("./{name}");
        assert_protected(
            temp.path(),
            &["simulate", "--scenario", &scenario, "--out", "./"],
            name,
        );
        fs::remove_file(temp.path().join(name)).unwrap();
    }
}

#[test]
fn results_can_be_written_into_the_folder_of_the_inputs() {
    let folder = project_of_logs();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let before = files(folder.path());
    let run = boresight(&["trajectory", &at("project.toml"), "--out", &at("")]);
    assert_eq!(run.code, 0, "{}", run.err);
    let after = files(folder.path());
    assert!(before.iter().all(|(name, bytes)| after[name] == *bytes));
    assert!(after.contains_key("trajectory.csv"));
    // And again: earlier results are not inputs.
    let run = boresight(&["trajectory", &at("project.toml"), "--out", &at("")]);
    assert_eq!(run.code, 0, "{}", run.err);
}
