//! A run goes on from the stages that an earlier one finished, and ends with the same bytes.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::results::{assert_same, results};
use crate::common::{change_project, names, on_project, rewrite_project, simulated};
use boresight::pipeline::{self, Options};
use boresight::progress::{Progress, Silent};
use boresight::project::Project;
use serde_json::Value;

/// What a run says of the stages that it did not run.
const EARLIER: &str = "Finished by an earlier run: ";

/// Stages of a whole run of this drive, in order.
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

/// A drive, its results, and the stages kept beside them.
struct Case {
    _temp: tempfile::TempDir,
    drive: PathBuf,
}

impl Case {
    fn new() -> Self {
        let (kept, drive) = simulated();
        Self { _temp: kept, drive }
    }

    fn out(&self) -> PathBuf {
        self.drive.join("out")
    }

    fn finished(&self) -> PathBuf {
        self.drive.join("out.finished")
    }

    /// Runs the project; returns which stages it did not run.
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

    /// The kept stage of this name.
    fn stage(&self, name: &str) -> PathBuf {
        let is_it = |kept: &&String| {
            let stem = kept.strip_suffix(".kept").unwrap_or_default();
            stem.rsplit_once('-')
                .is_some_and(|(stage, _)| stage == name)
        };
        let all = names(&self.finished());
        self.finished().join(all.iter().find(is_it).unwrap())
    }

    /// Another drive of the same kind, beside this one.
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

/// Takes the last row off a table.
fn shorten(table: &Path) {
    let text = fs::read_to_string(table).unwrap();
    let shorter = text.trim_end().rsplit_once('\n').unwrap().0;
    fs::write(table, format!("{shorter}\n")).unwrap();
}

/// Results are whole files of their own, whatever becomes of what is kept.
fn remove_results(out: &Path) {
    fs::remove_dir_all(out).unwrap();
}

/// Which stages are found, and which are not, is tested where they are kept (`pipeline::job`, `pipeline::keys`).
#[test]
fn a_run_goes_on_from_what_an_earlier_one_finished() {
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
fn finished_stages_are_found_again() {
    let case = Case::new();
    assert_eq!(case.run(&[]), [""; 0]);
    let whole = results(&case.out());
    assert_eq!(case.run(&[]), ALL);
    assert_same(&results(&case.out()), &whole);
    // Also where nothing but the kept stages is left.
    remove_results(&case.out());
    assert_eq!(case.run(&["--threads", "1"]), ALL);
    assert_same(&results(&case.out()), &whole);
    assert_eq!(case.run(&["--fresh"]), [""; 0]);
    assert_same(&results(&case.out()), &whole);
}

#[test]
#[ignore = "just acceptance"]
fn every_single_stage_that_is_missing_is_run_again() {
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
fn what_is_not_whole_is_not_read() {
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
    // A cloud that somebody edits in place may be the very file that is kept.
    let cloud = case.out().join("cloud-left.laz");
    let mut bytes = fs::read(&cloud).unwrap();
    bytes[1000] ^= 1;
    fs::write(&cloud, bytes).unwrap();
    assert!(!case.run(&[]).contains(&"georeference".to_owned()));
    assert_same(&results(&case.out()), &whole);
}

#[test]
#[ignore = "just acceptance"]
fn stages_follow_their_inputs_and_settings() {
    let case = Case::new();
    case.run(&[]);
    let again = |expected: &[&str]| {
        let found = case.run(&[]);
        assert_eq!(found, expected);
        // As if nothing had been there.
        let whole = results(&case.out());
        case.run(&["--fresh"]);
        assert_same(&results(&case.out()), &whole);
    };
    // What only says how the result is judged.
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
    // The content of a file counts, not its name or time.
    let log = case.drive.join("prism.csv");
    let text = fs::read_to_string(&log).unwrap();
    fs::write(&log, &text).unwrap();
    again(&ALL);
    shorten(&log);
    again(&["reference"]);
}

#[test]
#[ignore = "just acceptance"]
fn nothing_but_stages_of_the_last_run_is_kept() {
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
    // Nine values and two clouds.
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
    // The size is stated.
    let kept = second
        .iter()
        .filter(|name| !foreign.contains(&name.as_str()));
    let bytes: u64 = kept
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
fn a_run_does_without_what_it_cannot_keep() {
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
fn other_drives_are_inputs_too() {
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
fn what_follows_from_files_that_change_is_said_and_not_kept() {
    let case = Case::new();
    let project = Project::read(&case.drive.join("project.toml")).unwrap();
    let options = Options {
        out: case.out(),
        seed: None,
        fresh: false,
    };
    let file = case.drive.join("prism.csv");
    let before = fs::read(&file).unwrap();
    let meddler = Meddler {
        stage: "joint adjustment",
        file: file.clone(),
    };
    let found = pipeline::run(&project, &options, &meddler).unwrap();
    let warnings = found.result["warnings"].as_array().unwrap();
    let changed = |warning: &&Value| {
        let text = warning.as_str().unwrap();
        text.contains("prism.csv changed during this run")
    };
    assert_eq!(warnings.iter().filter(changed).count(), 1, "{warnings:?}");
    // What it was is there again: stages before the change hold.
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
fn one_folder_has_one_set_of_stages_whatever_leads_to_it() {
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
