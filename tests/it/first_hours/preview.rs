//! What `inspect` finds in a project before a run does.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::common::{change_project, copy_drive, on_project, simulated};

/// The first file of `inspect --json`.
fn document(drive: &Path) -> Value {
    let run = on_project(drive, "inspect", &["--json"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let document: Value = serde_json::from_str(&run.out).unwrap();
    document["files"][0].clone()
}

fn codes(document: &Value) -> Vec<String> {
    let all = document["verdicts"].as_array().unwrap().iter();
    all.map(|verdict| verdict["code"].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn a_sound_project_is_usable_and_its_scans_are_counted() {
    let (_temp, drive) = simulated();
    let run = on_project(&drive, "inspect", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for line in [
        "result: usable\n",
        "what a run finds",
        "scanner left            23286 points, 360",
        "0.0 % outside the trajectory",
        "reference               9928 points",
    ] {
        assert!(run.out.contains(line), "{line}: {}", run.out);
    }
    let document = document(&drive);
    assert_eq!(document["found"]["scanners"][1]["points"], 24046);
    assert!(codes(&document).contains(&"placement.consistent".to_owned()));
}

#[test]
fn swapped_files_and_angles_in_another_order_are_not_usable() {
    for mistake in ["swapped", "order"] {
        let (_temp, drive) = simulated();
        // Coarse voxels leave too few points to see it.
        change_project(&drive, "voxel_sizes_m = [0.1]", "voxel_sizes_m = [0.05]");
        match mistake {
            "swapped" => {
                fs::rename(drive.join("left.bin"), drive.join("a.bin")).unwrap();
                fs::rename(drive.join("right.bin"), drive.join("left.bin")).unwrap();
                fs::rename(drive.join("a.bin"), drive.join("right.bin")).unwrap();
            }
            _ => {
                change_project(&drive, "[-145.0, 0.0, 90.0]", "[90.0, 0.0, -145.0]");
                change_project(&drive, "[145.0, 0.0, 90.0]", "[90.0, 0.0, 145.0]");
            }
        }
        let document = document(&drive);
        assert_ne!(document["headline"], "usable", "{mistake}: {document}");
        let marked = codes(&document);
        assert!(
            marked[0].starts_with("scanner.") || marked[0].starts_with("mounting."),
            "{mistake}: {marked:?}"
        );
        assert!(
            !marked.contains(&"placement.consistent".to_owned()),
            "{mistake}"
        );
    }
}

#[test]
fn recordings_without_profiles_on_the_drive_are_not_usable() {
    let assert_unusable = |drive: &Path, what: &str| {
        let run = on_project(drive, "inspect", &[]);
        assert_eq!(run.code, 0, "{}", run.err);
        let first = "result: not usable\n\n! A run would end with this error: ";
        assert!(run.out.starts_with(first), "{}", run.out);
        assert!(
            run.out.lines().nth(2).unwrap().contains(what),
            "{}",
            run.out
        );
    };
    let (_temp, drive) = simulated();
    fs::write(drive.join("left.bin"), "").unwrap();
    assert_unusable(&drive, "left.bin");

    let (_temp, drive) = simulated();
    fs::write(drive.join("empty.csv"), "time_s,x_m,z_m\n").unwrap();
    change_project(&drive, "left.bin", "empty.csv");
    assert_unusable(&drive, "empty.csv");

    let (_temp, drive) = simulated();
    let profiles = "profiles = \"left.bin\"\n";
    change_project(
        &drive,
        profiles,
        &format!("{profiles}time_offset_s = 5000.0\n"),
    );
    assert_unusable(&drive, "left");
}

#[test]
fn what_was_not_looked_at_is_said() {
    let (_temp, drive) = simulated();
    let path = drive.join("project.toml");
    let text = fs::read_to_string(&path).unwrap();
    let other = "\n[[evaluation]]\nname = \"other\"\nproject = \"other/project.toml\"\n";
    copy_drive(&drive, &drive.join("other"));
    fs::write(&path, text + other).unwrap();
    let run = on_project(&drive, "inspect", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(
        run.out
            .contains("not looked at           drive other: inspect its project"),
        "{}",
        run.out
    );
}
