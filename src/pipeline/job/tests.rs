//! Tests of jobs of three small stages that a second job continues.

use std::cell::RefCell;
use std::fs;

use tempfile::TempDir;

use super::*;
use crate::pipeline::inputs::Inputs;
use crate::progress::Silent;

/// The stages, in order.
const ALL: [&str; 3] = ["read", "scale up", "write"];
/// The file that the last stage writes.
const RESULT: &str = "number.txt";
const WARNING: &str = "numbers are scaled";

/// A folder with an input.
struct Case(TempDir);

/// The outcome of a job.
struct Ran {
    /// The stages that were run and not reused.
    stages: Vec<&'static str>,
    warnings: Vec<String>,
}

impl Case {
    fn new() -> Self {
        let case = Self(tempfile::tempdir().unwrap());
        fs::write(case.input(), "7").unwrap();
        case
    }

    fn input(&self) -> PathBuf {
        self.0.path().join("input.txt")
    }

    fn out(&self) -> PathBuf {
        self.0.path().join("out")
    }

    /// The folder of finished stages.
    fn finished(&self) -> PathBuf {
        self.0.path().join("out.finished")
    }

    /// The kept result of a stage, without the files that it wrote.
    fn stage(&self, name: &str) -> PathBuf {
        let start = name.replace(' ', "-") + "-";
        let names = self.kept();
        let is_result = |name: &&String| name.starts_with(&start) && !name.contains(RESULT);
        self.finished().join(names.iter().find(is_result).unwrap())
    }

    fn kept(&self) -> Vec<String> {
        let entries = fs::read_dir(self.finished()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.collect()
    }

    /// Runs the stages; `meddle` is called within each of them and may change the input.
    fn run_and(&self, factor: f64, fresh: bool, meddle: impl Fn(&str)) -> Result<Ran> {
        let inputs = Inputs::read(vec![self.input()], &Silent)?;
        let input_key = Key::default().with(&inputs.hash(&self.input()));
        let factor_key = input_key.clone().with(&factor);
        let options = Options {
            out: self.out(),
            seed: None,
            fresh,
            kept: Vec::new(),
        };
        let job = Job::new(&options, &[self.input()], &[RESULT], &Silent)?;
        let finished = Finished::beside(&self.out(), inputs, fresh);
        let mut job = job.with_finished(finished);
        let stages = RefCell::new(Vec::new());
        let ran = |stage| {
            meddle(stage);
            stages.borrow_mut().push(stage);
        };
        let number = job.once("read", &input_key, |_| {
            ran("read");
            Ok(fs::read_to_string(self.input()).unwrap().trim().to_owned())
        })?;
        let scaled = job.once("scale up", &factor_key, |progress| {
            ran("scale up");
            progress.warn(WARNING);
            Ok(factor * number.parse::<f64>().unwrap())
        })?;
        let path = job.path(RESULT);
        job.once_writing("write", &[RESULT.to_owned()], &factor_key, |_| {
            ran("write");
            fs::write(&path, scaled.to_string()).unwrap();
            Ok(())
        })?;
        job.warn_of_changes();
        let warnings = job.warnings().to_vec();
        job.commit()?;
        Ok(Ran {
            stages: stages.into_inner(),
            warnings,
        })
    }

    /// Runs the stages with this factor; returns those that were run. Files and warnings must be the same whether
    /// stages were run or reused.
    fn run(&self, factor: f64) -> Vec<&'static str> {
        let ran = self.run_and(factor, false, |_| ()).unwrap();
        let written = fs::read_to_string(self.out().join(RESULT)).unwrap();
        let number: f64 = fs::read_to_string(self.input())
            .unwrap()
            .trim()
            .parse()
            .unwrap();
        assert_eq!(written, (factor * number).to_string());
        assert_eq!(ran.warnings, [WARNING]);
        ran.stages
    }
}

#[test]
fn finished_stages_are_reused() {
    let case = Case::new();
    assert_eq!(case.run(2.0), ALL);
    assert_eq!(case.run(2.0), [""; 0]);
    // The results are restored even if only the kept stages remain.
    fs::remove_dir_all(case.out()).unwrap();
    assert_eq!(case.run(2.0), [""; 0]);
    assert_eq!(case.run_and(2.0, true, |_| ()).unwrap().stages, ALL);
}

#[test]
fn every_single_stage_that_is_missing_is_run_again() {
    let case = Case::new();
    case.run(2.0);
    for stage in ALL {
        fs::remove_file(case.stage(stage)).unwrap();
        fs::remove_dir_all(case.out()).unwrap();
        assert_eq!(case.run(2.0), [stage]);
    }
}

#[test]
fn incomplete_or_changed_files_are_not_used() {
    let case = Case::new();
    case.run(2.0);
    type Damage = fn(&mut Vec<u8>);
    let damages: [(&str, Damage); 4] = [
        ("a bit", |bytes| {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
        }),
        ("the end", |bytes| bytes.truncate(bytes.len() - 1)),
        ("everything", Vec::clear),
        ("more", |bytes| bytes.extend(b"more")),
    ];
    for stage in ALL {
        for (what, damage) in damages {
            let path = case.stage(stage);
            let mut bytes = fs::read(&path).unwrap();
            damage(&mut bytes);
            fs::write(&path, bytes).unwrap();
            assert_eq!(case.run(2.0), [stage], "{what}");
        }
    }
    // A result that a user edits in place may be a hard link to the kept file.
    fs::write(case.out().join(RESULT), "13").unwrap();
    assert_eq!(case.run(2.0), ["write"]);
}

#[test]
fn stages_follow_their_keys() {
    let case = Case::new();
    case.run(2.0);
    assert_eq!(case.run(3.0), ["scale up", "write"]);
    // The content of a file counts, not its time.
    fs::write(case.input(), "7").unwrap();
    assert_eq!(case.run(3.0), [""; 0]);
    fs::write(case.input(), "8").unwrap();
    assert_eq!(case.run(3.0), ALL);
}

#[test]
fn nothing_but_stages_of_the_last_run_is_kept() {
    let case = Case::new();
    fs::create_dir(case.finished()).unwrap();
    let foreign = [
        "notes.txt",
        "read-0123.kept",
        "scan-d41d8cd98f00b204e9800998ecf8427e.laz",
    ];
    for name in foreign {
        fs::write(case.finished().join(name), "mine").unwrap();
    }
    case.run(2.0);
    let first = case.kept();
    // Three values and a file.
    assert_eq!(first.len(), foreign.len() + ALL.len() + 1, "{first:?}");
    case.run(3.0);
    let second = case.kept();
    assert_eq!(second.len(), first.len());
    // The reading stage is kept from the first run; the other two are new.
    let both = second.iter().filter(|name| first.contains(name)).count();
    assert_eq!(both, foreign.len() + 1, "{second:?}");
    for name in foreign {
        assert_eq!(fs::read(case.finished().join(name)).unwrap(), b"mine");
    }
}

#[test]
fn stages_that_cannot_be_kept_do_not_stop_a_job() {
    let case = Case::new();
    fs::write(case.finished(), "a file of the user").unwrap();
    assert_eq!(case.run(2.0), ALL);
    assert_eq!(case.run(2.0), ALL);
    assert_eq!(fs::read(case.finished()).unwrap(), b"a file of the user");
}

#[test]
fn stages_whose_input_changes_during_the_run_are_not_kept() {
    let case = Case::new();
    let meddle = |stage: &str| {
        if stage == "scale up" {
            fs::write(case.input(), "7 \n").unwrap();
        }
    };
    let ran = case.run_and(2.0, false, meddle).unwrap();
    assert_eq!(ran.stages, ALL);
    assert_eq!(ran.warnings.len(), 2, "{:?}", ran.warnings);
    let changed = "input.txt changed during this run";
    assert!(ran.warnings[1].contains(changed), "{:?}", ran.warnings);
    // The input has its former content again: the stage before the change is valid.
    fs::write(case.input(), "7").unwrap();
    assert_eq!(case.run(2.0), ["scale up", "write"]);
}

#[cfg(unix)]
#[test]
fn all_paths_to_a_folder_share_its_stages() {
    let case = Case::new();
    case.run(2.0);
    let link = case.0.path().join("link");
    std::os::unix::fs::symlink(case.out(), &link).unwrap();
    for out in [link, case.out().join("."), case.out().join("../out/")] {
        let inputs = Inputs::read(Vec::new(), &Silent).unwrap();
        let finished = Finished::beside(&out, inputs, false).unwrap();
        let folder = case.finished().canonicalize().unwrap();
        assert_eq!(finished.folder(), folder);
    }
}

#[test]
fn only_a_job_with_a_kept_stage_can_go_on() {
    let case = Case::new();
    let inputs = || Inputs::read(vec![case.input()], &Silent).unwrap();
    let options = Options {
        out: case.out(),
        seed: None,
        fresh: false,
        kept: Vec::new(),
    };
    let key = Key::default().with(&1.0);
    for (is_blocked, can_go_on) in [(true, false), (false, true)] {
        if is_blocked {
            fs::write(case.finished(), "a file of the user").unwrap();
        }
        let job = Job::new(&options, &[case.input()], &[RESULT], &Silent).unwrap();
        let mut job = job.with_finished(Finished::beside(&case.out(), inputs(), false));
        assert!(!job.can_go_on());
        job.once("read", &key, |_| Ok(7.0)).unwrap();
        assert_eq!(job.can_go_on(), can_go_on);
        fs::remove_file(case.finished()).unwrap_or_default();
    }
}
