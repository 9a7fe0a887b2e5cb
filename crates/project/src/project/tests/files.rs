//! Tests of the files that a project names.

use super::joint::JOINT;
use super::{EXAMPLE, POSES, Project, folder, write};

#[test]
fn missing_files_are_named_with_key_line_and_path() {
    let folder = folder();
    let drive_1 = folder.path().join("drive-1");
    let drive_2 = folder.path().join("drive-2");
    for drive in [&drive_1, &drive_2] {
        std::fs::create_dir(drive).unwrap();
    }
    let path = write(&drive_1, EXAMPLE);
    let missing = || {
        let checked = Project::read(&path).unwrap().check_files();
        checked.map_err(|error| error.to_string())
    };
    for (file, expected) in [
        ("imu.csv", "line 8: found imu.file = "),
        ("prism.csv", "line 15: found prism.file = "),
        ("heading.csv", "line 20: found heading.file = "),
        ("left.bin", "line 29: found scanner[0].profiles"),
        ("tls.laz", "line 36: found reference.file = "),
    ] {
        let message = missing().unwrap_err();
        assert!(
            message.contains(expected) && message.contains(file),
            "{message}"
        );
        assert!(message.contains("no such file"), "{message}");
        std::fs::write(drive_1.join(file), "").unwrap();
        std::fs::write(drive_2.join(file), "").unwrap();
    }
    let message = missing().unwrap_err();
    assert!(
        message.contains("line 44: found evaluation[0].project = "),
        "{message}"
    );

    // The other drive is checked as well, but not the drives that it names in turn.
    write(&drive_2, EXAMPLE);
    assert_eq!(missing(), Ok(()));
    write(&drive_2, &EXAMPLE.replace("\"left\"", "\"rear\""));
    let message = missing().unwrap_err();
    assert!(
        message.contains("line 44: found an evaluation with the scanner \"rear\", which this"),
        "{message}"
    );
    write(&drive_2, &EXAMPLE.replace("FRD", "FLU"));
    let message = missing().unwrap_err();
    assert!(
        message.contains("other body axes (Flu instead of Frd)"),
        "{message}"
    );
    write(&drive_2, &EXAMPLE.replace("left.bin", "elsewhere.bin"));
    let message = missing().unwrap_err();
    assert!(
        message.contains("drive-2/project.toml, line 29"),
        "{message}"
    );
}

#[test]
fn drives_are_checked_like_evaluations_and_may_be_named_only_once() {
    let folder = folder();
    let path = |drive: &str| folder.path().join(drive);
    for drive in ["drive-1", "drive-2", "drive-3", "drive-4"] {
        std::fs::create_dir(path(drive)).unwrap();
        for file in [
            "frame.csv",
            "imu.csv",
            "prism.csv",
            "gnss.csv",
            "heading.csv",
        ] {
            std::fs::write(path(drive).join(file), "").unwrap();
        }
        for file in ["left.bin", "right.bin", "tls.laz"] {
            std::fs::write(path(drive).join(file), "").unwrap();
        }
    }
    let checked = |text: &str| {
        let project = Project::read(&write(&path("drive-1"), text)).unwrap();
        let checked = project.check_files().map_err(|error| error.to_string());
        checked.map(|()| project)
    };
    let refused = |text: &str, expected: &str| {
        let message = checked(text).unwrap_err();
        assert!(message.contains(expected), "{message}");
    };
    refused(JOINT, "line 49: found drive[0].project = ");
    for drive in ["drive-2", "drive-3", "drive-4"] {
        write(&path(drive), JOINT);
    }
    let inputs = checked(JOINT).unwrap().inputs();
    for drive in ["drive-2", "drive-3", "drive-4"] {
        for file in ["project.toml", "frame.csv", "imu.csv", "right.bin"] {
            let input = path(drive).join(file).canonicalize().unwrap();
            let canonical = |input: &std::path::PathBuf| input.canonicalize().unwrap();
            assert!(inputs.iter().map(canonical).any(|known| known == input));
        }
    }

    let other = |from: &str, to: &str| JOINT.replace(&format!("../{from}/"), &format!("../{to}/"));
    refused(&other("drive-3", "drive-2"), "line 53: found the drive \"");
    refused(&other("drive-2", "drive-1"), "line 49: found the drive \"");
    refused(
        &other("drive-4", "drive-3"),
        "line 57: found an evaluation with \"",
    );
    refused(
        &other("drive-4", "drive-1"),
        "expected a drive that tests the result",
    );

    write(&path("drive-3"), &JOINT.replace("\"right\"", "\"rear\""));
    refused(
        JOINT,
        "line 53: found a drive with the scanner \"rear\", which this project does not calibrate",
    );
    let flu = format!("[frame]\nbody = \"FLU\"\n{JOINT}");
    write(&path("drive-3"), &flu);
    refused(
        JOINT,
        "line 53: found a drive with other body axes (Flu instead of Frd)",
    );
}

#[test]
fn a_logo_must_be_an_existing_picture() {
    let folder = folder();
    let with = |logo: &str| {
        write(
            folder.path(),
            &format!("{POSES}[report]\nlogo = \"{logo}\"\n"),
        )
    };
    let error = Project::read(&with("logo.pdf")).unwrap_err().to_string();
    assert!(
        error.contains("logo.pdf") && error.contains(".png"),
        "{error}"
    );
    let project = Project::read(&with("logo.png")).unwrap();
    std::fs::write(folder.path().join("trajectory.csv"), "").unwrap();
    let error = project.check_files().unwrap_err().to_string();
    assert!(
        error.contains("report.logo = ") && error.contains("no such file"),
        "{error}"
    );
    let empty = write(folder.path(), &format!("{POSES}[report]\nauthor = \" \"\n"));
    let error = Project::read(&empty).unwrap_err().to_string();
    assert!(error.contains("line 7: found an empty author"), "{error}");
}
