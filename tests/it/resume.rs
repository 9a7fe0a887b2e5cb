//! A run continues from the stages that an earlier run finished, and gives the same bytes.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::results::{assert_same, results};
use crate::common::{change_project, names, on_project, rewrite_project, simulated};
use boresight::pipeline::{self, Options};
use boresight::progress::{Progress, Silent};
use boresight::project::Project;
use serde_json::Value;

/// Beginning of the line that lists the stages that a run did not repeat.
const EARLIER: &str = "Finished by an earlier run: ";

/// The stages of a complete run of this drive, in order.
const ALL: [&str; 9] = [
    "reference",
    "trajectory",
    "sample",
    "check placement",
    "calibrate",
    "adjust jointly",
    "calibrate without reference",
    "georeference",
    "compare",
];

/// A drive, its results, and the stages stored beside them.
struct Case {
    _temp: tempfile::TempDir,
    drive: PathBuf,
}

impl Case {
    fn new() -> Self {
        let (temp, drive) = simulated();
        Self { _temp: temp, drive }
    }

    fn out(&self) -> PathBuf {
        self.drive.join("out")
    }

    fn finished(&self) -> PathBuf {
        self.drive.join("out.finished")
    }

    /// Runs the project; returns the stages that it did not repeat.
    fn run(&self, more: &[&str]) -> Vec<String> {
        let run = on_project(&self.drive, "run", more);
        assert_eq!(run.code, 0, "{}", run.err);
        let line = run.out.lines().find_map(|line| line.strip_prefix(EARLIER));
        let names = line.map_or("", |line| line.split(" (").next().unwrap());
        names
            .split(", ")
            .filter(|name| !name.is_empty())
            .map(str::to_owned)
            .collect()
    }

    /// The file of the stored stage with this name.
    fn stage(&self, name: &str) -> PathBuf {
        let is_it = |file: &&String| {
            let stem = file.strip_suffix(".kept").unwrap_or_default();
            stem.rsplit_once('-')
                .is_some_and(|(stage, _)| stage == name)
        };
        let all = names(&self.finished());
        self.finished().join(all.iter().find(is_it).unwrap())
    }

    /// A copy of the drive beside it.
    fn another(&self) -> PathBuf {
        let other = self.drive.with_file_name("drive-2");
        fs::create_dir(&other).unwrap();
        for name in names(&self.drive) {
            if self.drive.join(&name).is_file() {
                fs::copy(self.drive.join(&name), other.join(&name)).unwrap();
            }
        }
        other
    }
}

/// Removes the last row of a table.
fn shorten(table: &Path) {
    let text = fs::read_to_string(table).unwrap();
    let shorter = text.trim_end().rsplit_once('\n').unwrap().0;
    fs::write(table, format!("{shorter}\n")).unwrap();
}

/// Removes the results, which are independent of the stored stages.
fn remove_results(out: &Path) {
    fs::remove_dir_all(out).unwrap();
}

/// The modules that store stages test in detail which ones are reused (`pipeline::job`, `pipeline::keys`).
#[test]
fn a_run_continues_from_the_stages_that_an_earlier_one_finished() {
    let case = Case::new();
    assert_eq!(case.run(&[]), [""; 0]);
    let whole = results(&case.out());
    fs::remove_file(case.stage("calibrate")).unwrap();
    remove_results(&case.out());
    let others: Vec<&str> = ALL
        .into_iter()
        .filter(|name| *name != "calibrate")
        .collect();
    assert_eq!(case.run(&["--threads", "1"]), others);
    assert_same(&results(&case.out()), &whole);
    change_project(&case.drive, "neighbours = 20", "neighbours = 21");
    assert_eq!(case.run(&[]), ["reference", "trajectory"]);
}

#[test]
#[ignore = "just acceptance"]
fn finished_stages_are_not_repeated() {
    let case = Case::new();
    assert_eq!(case.run(&[]), [""; 0]);
    let whole = results(&case.out());
    assert_eq!(case.run(&[]), ALL);
    assert_same(&results(&case.out()), &whole);
    // Even if only the stored stages are left.
    remove_results(&case.out());
    assert_eq!(case.run(&["--threads", "1"]), ALL);
    assert_same(&results(&case.out()), &whole);
    assert_eq!(case.run(&["--fresh"]), [""; 0]);
    assert_same(&results(&case.out()), &whole);
}

#[test]
#[ignore = "just acceptance"]
fn each_missing_stage_is_run_again() {
    let case = Case::new();
    case.run(&[]);
    let whole = results(&case.out());
    for name in ALL {
        fs::remove_file(case.stage(&name.replace(' ', "-"))).unwrap();
        remove_results(&case.out());
        let others: Vec<&str> = ALL.into_iter().filter(|other| *other != name).collect();
        assert_eq!(case.run(&[]), others, "without {name}");
        assert_same(&results(&case.out()), &whole);
    }
}

#[test]
#[ignore = "just acceptance"]
fn damaged_stages_are_run_again() {
    let case = Case::new();
    case.run(&[]);
    let whole = results(&case.out());
    type Damage = fn(&Path);
    let damages: [(&str, Damage); 4] = [
        ("a bit", |path| {
            let mut bytes = fs::read(path).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            fs::write(path, bytes).unwrap();
        }),
        ("the end", |path| {
            let bytes = fs::read(path).unwrap();
            fs::write(path, &bytes[..bytes.len() - 1]).unwrap();
        }),
        ("everything", |path| fs::write(path, "").unwrap()),
        ("more", |path| {
            let bytes = fs::read(path).unwrap();
            fs::write(path, [bytes, b"more".to_vec()].concat()).unwrap();
        }),
    ];
    for (what, damage) in damages {
        damage(&case.stage("calibrate"));
        let again = case.run(&[]);
        assert!(!again.contains(&"calibrate".to_owned()), "{what}");
        assert_eq!(again.len(), ALL.len() - 1, "{what}");
        assert_same(&results(&case.out()), &whole);
    }
    // A cloud that is edited in place may be the same file as the stored one.
    let cloud = case.out().join("cloud-left.laz");
    let mut bytes = fs::read(&cloud).unwrap();
    bytes[1000] ^= 1;
    fs::write(&cloud, bytes).unwrap();
    assert!(!case.run(&[]).contains(&"georeference".to_owned()));
    assert_same(&results(&case.out()), &whole);
}

#[test]
#[ignore = "just acceptance"]
fn stages_are_run_again_if_their_inputs_or_settings_change() {
    let case = Case::new();
    case.run(&[]);
    let again = |expected: &[&str]| {
        assert_eq!(case.run(&[]), expected);
        // The results are those of a run from scratch.
        let whole = results(&case.out());
        case.run(&["--fresh"]);
        assert_same(&results(&case.out()), &whole);
    };
    // A setting that only affects how the result is judged.
    rewrite_project(&case.drive, |text| {
        format!("{text}\n[acceptance]\nsigma_translation_m = 0.1\n")
    });
    again(&ALL);
    rewrite_project(&case.drive, |text| {
        format!("{text}\n[comparison]\nmin_points = 3\n")
    });
    again(&ALL[..8]);
    change_project(&case.drive, "neighbours = 20", "neighbours = 21");
    again(&["reference", "trajectory"]);
    // Only the content of a file counts, not its name or time.
    let log = case.drive.join("prism.csv");
    let text = fs::read_to_string(&log).unwrap();
    fs::write(&log, &text).unwrap();
    again(&ALL);
    shorten(&log);
    again(&["reference"]);
}

#[test]
#[ignore = "just acceptance"]
fn only_stages_of_the_last_run_are_stored_and_other_files_are_left_alone() {
    let case = Case::new();
    fs::create_dir(case.finished()).unwrap();
    let foreign = [
        "notes.txt",
        "calibrate-0123.kept",
        "scan-d41d8cd98f00b204e9800998ecf8427e.laz",
    ];
    for name in foreign {
        fs::write(case.finished().join(name), "mine").unwrap();
    }
    case.run(&[]);
    let first = names(&case.finished());
    // A file for each of nine stages, and two clouds.
    assert_eq!(first.len(), foreign.len() + ALL.len() + 2, "{first:?}");
    change_project(&case.drive, "neighbours = 20", "neighbours = 21");
    let run = on_project(&case.drive, "run", &[]);
    let second = names(&case.finished());
    assert_eq!(second.len(), first.len());
    assert_eq!(
        second.iter().filter(|name| first.contains(name)).count(),
        foreign.len() + 2
    );
    for name in foreign {
        assert_eq!(
            fs::read_to_string(case.finished().join(name)).unwrap(),
            "mine"
        );
    }
    // The summary states the size.
    let stored = second
        .iter()
        .filter(|name| !foreign.contains(&name.as_str()));
    let bytes: u64 = stored
        .map(|name| fs::metadata(case.finished().join(name)).unwrap().len())
        .sum();
    let stated = format!(
        "out.finished ({:.1} MB), which may be removed",
        1e-6 * bytes as f64
    );
    assert!(run.out.contains(&stated), "{stated}: {}", run.out);
}

#[test]
#[ignore = "just acceptance"]
fn a_run_that_cannot_store_stages_warns_once_and_finishes() {
    let case = Case::new();
    fs::write(case.finished(), "a file of the user").unwrap();
    let run = on_project(&case.drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert_eq!(
        run.err
            .matches("finished stages are no longer kept")
            .count(),
        1,
        "{}",
        run.err
    );
    results(&case.out());
    assert_eq!(
        fs::read_to_string(case.finished()).unwrap(),
        "a file of the user"
    );
}

#[test]
#[ignore = "just acceptance"]
fn changes_to_other_drives_run_stages_again() {
    let case = Case::new();
    let other = case.another();
    rewrite_project(&case.drive, |text| {
        format!("{text}\n[[evaluation]]\nname = \"again\"\nproject = \"../drive-2/project.toml\"\n")
    });
    case.run(&[]);
    assert_eq!(case.run(&[]), [&ALL[..], &["evaluate again"]].concat());
    shorten(&other.join("prism.csv"));
    assert_eq!(case.run(&[]), ALL);
    change_project(&other, "sigma_m = 0.005", "sigma_m = 0.006");
    assert_eq!(case.run(&[]), ALL);
    let whole = results(&case.out());
    case.run(&["--fresh"]);
    assert_same(&results(&case.out()), &whole);

    change_project(&case.drive, "[[evaluation]]", "[[drive]]");
    let before = [
        "reference",
        "trajectory",
        "sample",
        "check placement",
        "calibrate",
    ];
    let two_steps = [&before[..], &["calibrate without reference"]].concat();
    assert_eq!(case.run(&[]), two_steps);
    shorten(&other.join("imu.csv"));
    assert_eq!(case.run(&[]), two_steps);
    let whole = results(&case.out());
    case.run(&["--fresh"]);
    assert_same(&results(&case.out()), &whole);
}

/// Appends to a file when a stage begins.
struct Meddler {
    stage: &'static str,
    file: PathBuf,
}

impl Progress for Meddler {
    fn begin(&self, stage: &str, _total: u64) {
        if stage == self.stage {
            let mut text = fs::read(&self.file).unwrap();
            text.extend_from_slice(b"\n");
            fs::write(&self.file, text).unwrap();
        }
    }
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
    fn say(&self, _message: &str) {}
    fn warn(&self, _message: &str) {}
}

#[test]
#[ignore = "just acceptance"]
fn an_input_that_changes_during_a_run_is_reported_and_later_stages_are_not_stored() {
    let case = Case::new();
    let project = Project::read(&case.drive.join("project.toml")).unwrap();
    let options = Options {
        out: case.out(),
        seed: None,
        fresh: false,
        kept: Vec::new(),
    };
    let file = case.drive.join("prism.csv");
    let before = fs::read(&file).unwrap();
    let meddler = Meddler {
        stage: "joint adjustment",
        file: file.clone(),
    };
    let outcome = pipeline::run(&project, &options, &meddler).unwrap();
    let warnings = outcome.result["warnings"].as_array().unwrap();
    let changed = |warning: &&Value| {
        let text = warning.as_str().unwrap();
        text.contains("prism.csv changed during this run")
    };
    assert_eq!(warnings.iter().filter(changed).count(), 1, "{warnings:?}");
    // With the original content restored, the stages before the change are valid.
    fs::write(&file, before).unwrap();
    let again = pipeline::run(&project, &options, &Silent).unwrap();
    let begin =
        "Finished by an earlier run: reference, trajectory, sample, check placement, calibrate (";
    assert!(again.summary.contains(begin), "{}", again.summary);
    assert!(
        !again.result["warnings"]
            .to_string()
            .contains("changed during")
    );
}

#[cfg(unix)]
#[test]
#[ignore = "just acceptance"]
fn a_folder_has_one_set_of_stages_whatever_path_leads_to_it() {
    let case = Case::new();
    case.run(&[]);
    let link = case.drive.join("link");
    std::os::unix::fs::symlink(case.out(), &link).unwrap();
    for out in [link, case.out().join("."), case.out().join("../out/")] {
        assert_eq!(case.run(&["--out", out.to_str().unwrap()]), ALL);
    }
    let folders = names(&case.drive);
    assert_eq!(
        folders
            .iter()
            .filter(|name| name.ends_with(".finished"))
            .count(),
        1
    );
}
