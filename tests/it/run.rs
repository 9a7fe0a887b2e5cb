//! Whole runs on a small simulated project, through the real binary.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::results::{results, timeless};
use crate::common::{boresight, on_project, rewrite_project, simulated};
use serde_json::Value;

#[test]
fn a_run_writes_the_same_bytes_with_one_thread_and_two() {
    let (_temp, drive) = simulated();
    let [one, two] = ["1", "2"].map(|threads| {
        let out = drive.join(format!("threads {threads}"));
        let run = on_project(
            &drive,
            "run",
            &[
                "--json",
                "--threads",
                threads,
                "--out",
                out.to_str().unwrap(),
            ],
        );
        assert_eq!(run.code, 0, "{}", run.err);
        let printed: Value = serde_json::from_str(&run.out).unwrap();
        let written = fs::read(out.join("result.json")).unwrap();
        let written: Value = serde_json::from_slice(&written).unwrap();
        assert_eq!(timeless(printed), timeless(written));
        results(&out)
    });
    for (name, bytes) in &one {
        assert!(bytes == &two[name], "{name} differs");
    }
}

#[test]
fn every_command_prints_json_and_is_silent_with_quiet() {
    let (temp, drive) = simulated();
    let out = temp.path().join("results");
    let out = out.to_str().unwrap();
    let answers = |arguments: &[&str]| {
        let run = boresight(&[arguments, &["--json", "--quiet"]].concat());
        assert_eq!(run.code, 0, "{arguments:?}: {}", run.err);
        assert_eq!(run.err, "", "{arguments:?}");
        let document: Value = serde_json::from_str(&run.out).unwrap();
        assert!(
            document
                .as_object()
                .is_some_and(|entries| !entries.is_empty()),
            "{arguments:?}"
        );
    };
    let project = drive.join("project.toml");
    let project = project.to_str().unwrap();
    for command in ["trajectory", "calibrate", "georeference"] {
        answers(&[command, project, "--out", out]);
    }
    answers(&["inspect", project]);
    let cloud = |name: &str| format!("{out}/cloud-{name}.laz");
    answers(&["compare", &cloud("left"), &cloud("right"), "--out", out]);
}

/// The text of a `calibration.toml` without its leading comments, which also judge the distances that
/// only a run evaluates.
fn mountings(out: &Path) -> String {
    let text = fs::read_to_string(out.join("calibration.toml")).unwrap();
    let (_, tables) = text.split_once("[[scanner]]").unwrap();
    tables.to_owned()
}

#[test]
fn calibrate_writes_the_same_calibration_as_run() {
    let (_temp, drive) = simulated();
    // The simulated ground is too small for larger surfels.
    rewrite_project(&drive, |text| format!("{text}\n[joint]\nsurfel_m = 0.2\n"));
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let (out, alone) = (drive.join("out"), drive.join("alone"));
    let whole: Value = serde_json::from_slice(&fs::read(out.join("result.json")).unwrap()).unwrap();
    let calibrated = |more: &[&str]| {
        let run = on_project(
            &drive,
            "calibrate",
            &[more, &["--out", alone.to_str().unwrap()]].concat(),
        );
        assert_eq!(run.code, 0, "{}", run.err);
        run.out
    };
    let document = |more: &[&str]| -> Value {
        serde_json::from_str(&calibrated(&[more, &["--json"]].concat())).unwrap()
    };
    let joint = document(&[]);
    assert_eq!(joint["calibration"]["method"], "joint");
    for key in ["scanners", "calibration", "two_steps", "trajectory"] {
        assert_eq!(
            timeless(joint[key].clone()),
            timeless(whole[key].clone()),
            "{key}"
        );
    }
    assert_eq!(mountings(&alone), mountings(&out));
    assert_eq!(
        fs::read(alone.join("mounting.csv")).unwrap(),
        fs::read(out.join("mounting.csv")).unwrap()
    );
    let sentence = "These are the values of the joint adjustment";
    let page = fs::read_to_string(alone.join("calibration.html")).unwrap();
    assert!(page.contains(sentence));

    let two_step = document(&["--method", "two-step"]);
    assert_eq!(two_step["calibration"]["method"], "two-step");
    assert!(two_step["calibration"].get("joint").is_none());
    rewrite_project(&drive, |text| {
        text.replace("[calibration]", "[calibration]\nmethod = \"two-step\"")
    });
    let from_project = document(&[]);
    assert_eq!(
        timeless(from_project["scanners"].clone()),
        timeless(two_step["scanners"].clone())
    );
    // The option goes before the project.
    assert!(calibrated(&["--method", "joint"]).contains(sentence));
    let page = fs::read_to_string(alone.join("calibration.html")).unwrap();
    assert!(page.contains(sentence));
    assert_eq!(mountings(&alone), mountings(&out));
}

#[test]
fn a_project_that_cannot_be_calibrated_is_refused_before_the_work() {
    let refused = |edit: &dyn Fn(&Path), expected: &[&str]| {
        let (_temp, drive) = simulated();
        edit(&drive);
        for command in ["calibrate", "run"] {
            let start = Instant::now();
            let run = on_project(&drive, command, &["--quiet"]);
            assert_eq!(run.code, 1, "{}", run.err);
            assert_eq!(run.err.matches("error: ").count(), 1, "{}", run.err);
            for expected in expected {
                assert!(run.err.contains(expected), "{expected}: {}", run.err);
            }
            assert!(!drive.join("out/result.json").exists());
            assert!(start.elapsed() < Duration::from_secs(60));
        }
    };
    refused(
        &|drive| {
            rewrite_project(drive, |text| {
                let all = r#"fixed = ["tx", "ty", "tz", "rx", "ry", "rz"]"#;
                text.replace("[[scanner]]", &format!("[[scanner]]\n{all}"))
            });
        },
        &[
            "project.toml",
            "all parameters of all scanners are fixed",
            "remedy: ",
        ],
    );
    refused(
        &|drive| {
            let far = "east_m, north_m, up_m\n100, 0, 0\n101, 1, 0\n";
            fs::write(drive.join("far.csv"), far).unwrap();
            rewrite_project(drive, |text| text.replace("../tls.laz", "far.csv"));
        },
        // The simulated field ends within 10 m.
        &["far.csv", "do not overlap", "the gap is 9", "remedy: "],
    );
    refused(
        &|drive| fs::write(drive.join("out"), "a file").unwrap(),
        &["out: found a file, expected a folder"],
    );
}

#[test]
fn variants_of_a_project_run() {
    let (_temp, drive) = simulated();
    let project = fs::read_to_string(drive.join("project.toml")).unwrap();
    let variant = |edit: &dyn Fn(&str) -> String| {
        rewrite_project(&drive, |_| edit(&project));
        let run = on_project(&drive, "run", &["--json"]);
        assert_eq!(run.code, 0, "{}", run.err);
        serde_json::from_str::<Value>(&run.out).unwrap()
    };
    let between = |text: &str, from: &str, to: &str, instead: &str| {
        let (start, end) = (text.find(from).unwrap(), text.find(to).unwrap());
        format!("{}{instead}{}", &text[..start], &text[end..])
    };

    let poses = "[trajectory]\nfile = \"truth/trajectory.csv\"\n";
    let result = variant(&|text| between(text, "[imu]", "[[scanner]]", poses));
    // With exact poses the mounting comes out close to the scenario's.
    let height = &result["scanners"]["left"]["body_from_scanner"]["translation_m"][2];
    assert!((height.as_f64().unwrap() - 0.587).abs() < 0.005, "{height}");
    // Poses without standard deviations are not adjusted.
    let joint = &result["calibration"]["joint"];
    let refused = joint["refused"].as_str().unwrap();
    assert!(refused.contains("no standard deviations"), "{refused}");
    assert!(joint["decided"].is_null());
    assert_eq!(result["calibration"]["method"], "two-step");

    let result = variant(&|text| between(text, "[reference]", "[calibration]", ""));
    assert_eq!(
        result["scanners"]["left"]["unobservable"],
        serde_json::json!(["tz"])
    );
    assert!(result["scanners"]["left"]["sigma"]["translation_m"][2].is_null());
    assert!(result["evaluation"]["left-right"]["m3c2_rmse_m"].is_f64());

    let result = variant(&|text| {
        let right = text.rfind("[[scanner]]").unwrap();
        let reference = text.find("[reference]").unwrap();
        format!("{}{}", &text[..right], &text[reference..])
    });
    assert_eq!(result["scanners"].as_object().unwrap().len(), 1);
    let relative = &result["calibration"]["relative"];
    assert_eq!(relative.as_object().unwrap().len(), 0);

    let result =
        variant(&|text| text.replace("name = \"left\"", "name = \"left\"\nfixed = [\"tx\"]"));
    let left = &result["scanners"]["left"];
    assert_eq!(left["body_from_scanner"]["translation_m"][0], 1.2);
    assert!(left["sigma"]["translation_m"][0].is_null());

    let result = variant(&|text| {
        text.replace(
            "[calibration]",
            "[calibration]\nmethod = \"paper\"\nmax_iterations = 5",
        )
    });
    assert_eq!(result["calibration"]["scales"][0]["iterations"], 5);
    assert_eq!(result["calibration"]["method"], "paper");
    assert!(result["calibration"].get("joint").is_none());
    assert_eq!(result["calibration"]["relative"]["right"]["first"], "left");
}

#[test]
fn inspect_reports_on_every_file_it_is_given() {
    let (temp, drive) = simulated();
    let notes = temp.path().join("notes.txt");
    fs::write(&notes, "dear diary,\nit rained\n").unwrap();
    let profiles = drive.join("left.bin");
    let run = boresight(&[
        "inspect",
        notes.to_str().unwrap(),
        profiles.to_str().unwrap(),
    ]);
    assert_eq!(run.code, 1);
    assert!(run.out.contains("notes.txt, line 1: found"), "{}", run.out);
    assert!(run.out.contains("Gocator"), "{}", run.out);
}
