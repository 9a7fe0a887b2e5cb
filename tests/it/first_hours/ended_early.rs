//! Runs that fail after minutes of computing keep and show what they computed, and the next call goes on.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use boresight::format::read_cloud;
use boresight::pipeline::{self, Options, Placement};
use boresight::progress::{Progress, Silent};
use boresight::project::{Project, mountings};
use serde_json::Value;

use crate::common::{names, on_project, rewrite_project, simulated};

/// Puts obstacles into the folder in which results are written, when a stage begins, and keeps the warnings.
struct Obstacles {
    stage: &'static str,
    names: &'static [&'static str],
    out: PathBuf,
    warnings: Mutex<Vec<String>>,
}

impl Obstacles {
    fn new(stage: &'static str, names: &'static [&'static str], out: &Path) -> Self {
        Self {
            stage,
            names,
            out: out.to_owned(),
            warnings: Mutex::default(),
        }
    }

    /// All warnings.
    fn warned(&self) -> String {
        self.warnings.lock().unwrap().join("\n")
    }
}

impl Progress for Obstacles {
    fn begin(&self, stage: &str, _total: u64) {
        let staging = || {
            let folders = names(&self.out).into_iter();
            let mut folders = folders.map(|name| self.out.join(name));
            folders.find(|path| path.is_dir() && path.to_string_lossy().contains(".staging-"))
        };
        if stage == self.stage {
            for name in self.names {
                // A folder where a file shall be written fails as a full disk does, for every user.
                let _ = fs::create_dir_all(staging().unwrap().join(name));
            }
        }
    }
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
    fn say(&self, _message: &str) {}
    fn warn(&self, message: &str) {
        self.warnings.lock().unwrap().push(message.to_owned());
    }
}

fn options(out: &Path) -> Options {
    Options {
        out: out.to_owned(),
        seed: None,
        fresh: false,
        kept: Vec::new(),
    }
}

/// The files of a complete run, without the folder of figures and the log.
const ALL: [&str; 9] = [
    "calibration.toml",
    "cloud-left.laz",
    "cloud-right.laz",
    "mounting.csv",
    "project.toml",
    "report.html",
    "report.kept",
    "result.json",
    "trajectory.csv",
];

/// The results in a folder.
fn results(out: &Path) -> Vec<String> {
    let mut names = names(out);
    names.retain(|name| out.join(name).is_file() && name != "log.txt");
    names
}

fn result(out: &Path) -> Value {
    serde_json::from_slice(&fs::read(out.join("result.json")).unwrap()).unwrap()
}

#[test]
fn clouds_that_cannot_be_written_do_not_keep_back_the_calibration() {
    let (_temp, drive) = simulated();
    let out = drive.join("out");
    let project = Project::read(&drive.join("project.toml")).unwrap();
    let obstacles = Obstacles::new("georeferencing", &["cloud-right.laz"], &out);
    let error = pipeline::run(&project, &options(&out), &obstacles).unwrap_err();
    assert!(error.to_string().contains("cloud-right.laz"), "{error}");
    let kept: Vec<&str> = ALL
        .into_iter()
        .filter(|name| !name.starts_with("cloud-"))
        .collect();
    assert_eq!(results(&out), kept);
    let scanners = mountings(&out.join("calibration.toml")).unwrap().scanners;
    assert_eq!(scanners.len(), 2);
    let warned = obstacles.warned();
    for expected in [
        "calibration.toml, project.toml",
        "the same command goes on",
        "mounting  ",
    ] {
        assert!(warned.contains(expected), "{expected}: {warned}");
    }
    let result = result(&out);
    assert_eq!(result["error"], error.to_string());
    assert!(result["headline"].is_object() || result["headline"].is_string());
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("The run ended early"));

    // The next call repeats only what failed, and its results replace those of the failure.
    let again = pipeline::run(&project, &options(&out), &Silent).unwrap();
    let reused = "Finished by an earlier run: reference, trajectory, sample, check placement, calibrate, \
                  adjust jointly, calibrate without reference (";
    assert!(again.summary.contains(reused), "{}", again.summary);
    assert_eq!(results(&out), ALL);
    let result = self::result(&out);
    assert_eq!(result.get("error"), None);
    let same = mountings(&out.join("calibration.toml")).unwrap().scanners;
    assert_eq!(same, scanners);
}

#[test]
fn a_result_that_cannot_be_written_does_not_keep_back_the_others() {
    let (_temp, drive) = simulated();
    let out = drive.join("out");
    let project = Project::read(&drive.join("project.toml")).unwrap();
    pipeline::run(&project, &options(&out), &Silent).unwrap();
    let obstructed: [(&str, &[&str]); 4] = [
        ("calibration.toml", &["calibration.toml"]),
        ("report.html", &["report.html"]),
        ("result.json", &["result.json"]),
        ("trajectory.csv", &["trajectory.csv"]),
    ];
    for (name, names) in obstructed {
        fs::remove_dir_all(&out).unwrap();
        let obstacles = Obstacles::new("comparing inputs with earlier runs", names, &out);
        let error = pipeline::run(&project, &options(&out), &obstacles).unwrap_err();
        assert!(error.to_string().contains(name), "{name}: {error}");
        let others: Vec<&str> = ALL.into_iter().filter(|other| *other != name).collect();
        assert_eq!(results(&out), others, "without {name}");
        assert!(obstacles.warned().contains("mounting  "), "{name}");
        pipeline::run(&project, &options(&out), &Silent).unwrap();
        assert_eq!(results(&out), ALL, "after {name}");
    }
}

#[test]
fn a_folder_in_the_place_of_a_result_keeps_back_nothing_else() {
    let (_temp, drive) = simulated();
    let out = drive.join("out");
    for name in ["cloud-left.laz", "figures", "report.html"] {
        let _ = fs::remove_dir_all(&out);
        fs::create_dir_all(&out).unwrap();
        match name {
            "figures" => fs::write(out.join(name), "a file of the user").unwrap(),
            _ => fs::create_dir_all(out.join(name).join("of the user")).unwrap(),
        }
        let run = on_project(&drive, "run", &["--force"]);
        run.assert_failed_with(&[name, "mounting  "]);
        let mut expected: Vec<&str> = ALL.into_iter().filter(|other| *other != name).collect();
        if name == "figures" {
            expected.insert(3, name);
        }
        assert_eq!(results(&out), expected, "{name}");
    }
}

#[test]
fn a_scanner_that_cannot_be_placed_keeps_back_no_other_cloud() {
    let (_temp, drive) = simulated();
    let out = drive.join("out");
    let rows = (0..2000).map(|i| format!("{},0.1,1.0\n", 36_010.0 + 0.01 * f64::from(i)));
    let rows: String = rows.collect();
    fs::write(
        drive.join("right.csv"),
        format!("time_s,x_m,z_m\n{rows}36030.0,wide,1.0\n"),
    )
    .unwrap();
    rewrite_project(&drive, |text| text.replace("right.bin", "right.csv"));
    let run = on_project(&drive, "georeference", &[]);
    let kept = "what the run computed before is in ";
    run.assert_failed_with(&["right.csv, line 2002", "wide", kept, "cloud-left.laz"]);
    assert!(!run.err.contains("goes on from there"), "{}", run.err);
    assert_eq!(results(&out), ["cloud-left.laz"]);
    let whole = read_cloud(&out.join("cloud-left.laz")).unwrap();
    assert!(whole.points.len() > 10_000, "{}", whole.points.len());

    // A cloud of an earlier run is not taken for one of this.
    rewrite_project(&drive, |text| text.replace("right.csv", "right.bin"));
    assert_eq!(on_project(&drive, "georeference", &[]).code, 0);
    let project = Project::read(&drive.join("project.toml")).unwrap();
    let obstacles = Obstacles::new("georeferencing", &["cloud-right.laz"], &out);
    let placement = Placement::new(&project, None, None).unwrap();
    let error = pipeline::georeference(&placement, &options(&out), &obstacles).unwrap_err();
    assert!(error.to_string().contains("cloud-right.laz"), "{error}");
    let warned = obstacles.warned();
    for expected in [
        &format!("{kept}{}: cloud-left.laz", out.display()),
        "by an earlier run: ",
    ] {
        assert!(warned.contains(expected), "{expected}: {warned}");
    }
    assert_eq!(results(&out), ["cloud-left.laz", "cloud-right.laz"]);
}

#[test]
fn a_calibration_that_fails_leaves_the_trajectory() {
    let (_temp, drive) = simulated();
    rewrite_project(&drive, |text| text.replace("../tls.laz", "far.csv"));
    let far = "east_m,north_m,up_m\n900,900,0\n901,900,0\n900,901,0\n";
    fs::write(drive.join("far.csv"), far).unwrap();
    let run = on_project(&drive, "run", &[]);
    run.assert_failed_with(&[
        "do not overlap",
        "report.html, report.kept",
        "the same command goes on from there",
    ]);
    let out = drive.join("out");
    assert_eq!(
        results(&out),
        ["report.html", "report.kept", "trajectory.csv"]
    );
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("The run ended early"));
}

#[test]
fn clouds_of_an_earlier_run_are_not_taken_for_those_of_one_that_failed() {
    let (_temp, drive) = simulated();
    assert_eq!(on_project(&drive, "run", &[]).code, 0);
    rewrite_project(&drive, |text| {
        let evaluation = "[[evaluation]]\nname = \"other\"\nproject = \"../other/project.toml\"\n";
        format!(
            "{}\n{evaluation}",
            text.replace("neighbours = 20", "neighbours = 21")
        )
    });
    // An evaluation drive whose positions do not overlap with the IMU shows only when its turn comes.
    let other = drive.with_file_name("other");
    fs::create_dir(&other).unwrap();
    for name in names(&drive)
        .iter()
        .filter(|name| drive.join(name).is_file())
    {
        fs::copy(drive.join(name), other.join(name)).unwrap();
    }
    let late = "time_s,east_m,north_m,up_m\n90000,0,0,0\n90001,0,0,0\n";
    fs::write(other.join("prism.csv"), late).unwrap();
    rewrite_project(&other, |text| {
        text.split("\n[[evaluation]]").next().unwrap().to_owned()
    });
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 1, "{}", run.err);
    assert!(!run.err.contains("of an earlier run"), "{}", run.err);
    assert_eq!(results(&drive.join("out")), ALL);
    let result = result(&drive.join("out"));
    // The comparisons of the calibration drive are kept.
    assert!(
        result["error"].is_string() && result["evaluation"].is_object(),
        "{result}"
    );

    let far = "east_m,north_m,up_m\n900,900,0\n901,900,0\n900,901,0\n";
    fs::write(drive.join("far.csv"), far).unwrap();
    rewrite_project(&drive, |text| text.replace("../tls.laz", "far.csv"));
    let run = on_project(&drive, "run", &[]);
    run.assert_failed_with(&["by an earlier run: ", "cloud-left.laz, cloud-right.laz"]);
}
