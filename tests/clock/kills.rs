//! Killed processes leave complete files, and the next run finishes their work.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use boresight::output::Staging;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::common::results::{EXACT, results};
use crate::common::{names, on_project, project_of_logs, rewrite_project, simulated};

/// Number of hidden files and folders in `out`.
#[cfg(unix)]
fn hidden(out: &Path) -> usize {
    names(out)
        .iter()
        .filter(|name| name.starts_with('.'))
        .count()
}

/// Kills or interrupts `count` runs at moments from their start to shortly after their end: each result is then the
/// old file or the new one, complete.
#[cfg(unix)]
fn killed_runs_leave_old_or_new_files(count: u32) {
    let (_temp, drive) = simulated();
    let out = drive.join("out");
    let start = Instant::now();
    let run = on_project(&drive, "run", &[]);
    let took = start.elapsed();
    assert_eq!(run.code, 0, "{}", run.err);
    let (old, old_files) = (results(&out), drive.join("old"));
    fs::rename(&out, &old_files).unwrap();
    // These changes alter every result.
    rewrite_project(&drive, |text| {
        text.replace("sigma_m = 0.005", "sigma_m = 0.02")
            .replace("translation_m = [1.2,", "translation_m = [1.21,")
    });
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let new = results(&out);
    for (name, bytes) in &old {
        assert!(bytes != &new[name], "{name} is unchanged");
    }

    let mut leftovers = 0;
    for step in 0..count {
        for name in EXACT.iter().chain(&["result.json", "report.html"]) {
            fs::copy(old_files.join(name), out.join(name)).unwrap();
        }
        let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .args([
                "run",
                drive.join("project.toml").to_str().unwrap(),
                "--quiet",
                "--fresh",
            ])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(took.mul_f64(1.1 * f64::from(step + 1) / f64::from(count + 1)));
        if step % 2 == 0 {
            child.kill().unwrap();
        } else {
            let pid = child.id().to_string();
            // The run may have ended already.
            let _ = Command::new("kill")
                .args(["-INT", &pid])
                .stderr(Stdio::null())
                .status();
        }
        child.wait().unwrap();
        leftovers += usize::from(hidden(&out) > 0);
        let present = results(&out);
        for (name, bytes) in &present {
            let is_complete = bytes == &old[name] || bytes == &new[name];
            assert!(
                is_complete,
                "step {step}: {name} is neither the old nor the new one"
            );
        }
        if present["result.json"] == new["result.json"] {
            assert!(
                present == new,
                "step {step}: result.json describes files that are not there"
            );
        }
    }

    // The next undisturbed run removes the temporary files of the killed ones.
    assert!(leftovers > 0, "no run was killed while it worked");
    assert_eq!(on_project(&drive, "run", &[]).code, 0);
    assert!(results(&out) == new);
    assert_eq!(hidden(&out), 0);
}

#[cfg(unix)]
#[test]
fn a_killed_run_leaves_old_or_new_files() {
    killed_runs_leave_old_or_new_files(3);
}

#[cfg(unix)]
#[test]
#[ignore = "just acceptance"]
fn a_dozen_killed_runs_leave_old_or_new_files() {
    killed_runs_leave_old_or_new_files(12);
}

/// The next run after a kill continues from there, and gives the results of an undisturbed run.
#[cfg(unix)]
#[test]
#[ignore = "just acceptance"]
fn the_runs_after_a_hundred_kills_give_the_results_of_an_undisturbed_run() {
    let (_temp, drive) = simulated();
    let (undisturbed, out) = (drive.join("undisturbed"), drive.join("out"));
    // The shortest of three, so that kills do not come after the end.
    let full_run = |_| {
        let begun = Instant::now();
        let out = undisturbed.to_str().unwrap();
        let run = on_project(&drive, "run", &["--fresh", "--out", out]);
        assert_eq!(run.code, 0, "{}", run.err);
        begun.elapsed()
    };
    let took = (0..3).map(full_run).min().unwrap();
    let expected = results(&undisturbed);
    let random = &mut ChaCha8Rng::seed_from_u64(1);
    let mut killed = 0;
    for number in 0..100 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .args(["run", drive.join("project.toml").to_str().unwrap()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(took.mul_f64(random.random_range(0.0..1.0)));
        killed += usize::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(on_project(&drive, "run", &[]).code, 0);
        assert!(results(&out) == expected, "after kill {number}");
        assert_eq!(hidden(&out), 0);
        fs::remove_dir_all(&out).unwrap();
        fs::remove_dir_all(drive.join("out.finished")).unwrap();
    }
    println!("{killed} of 100 were still working");
    assert!(killed > 80);
}

/// A killed run leaves the old file or the new one, byte for byte.
#[test]
fn a_killed_trajectory_leaves_the_old_or_the_new_file() {
    let folder = project_of_logs();
    let project = folder.path().join("project.toml");
    let result = folder.path().join("out/trajectory.csv");
    let text = fs::read_to_string(&project).unwrap();
    let other = text.replace("[prism]", "[prism]\nsigma_m = 0.02");
    let full_run = || {
        let start = Instant::now();
        let run = on_project(folder.path(), "trajectory", &[]);
        assert_eq!(run.code, 0, "{}", run.err);
        (fs::read(&result).unwrap(), start.elapsed())
    };
    fs::write(&project, &other).unwrap();
    let (new, _) = full_run();
    fs::write(&project, &text).unwrap();
    let (old, took) = full_run();
    assert_ne!(old, new);

    fs::write(&project, &other).unwrap();
    let (mut count_old, mut count_new, mut step) = (0, 0, 0);
    // Until a dozen have ended: beside others, a run may take several times as long as the one that was timed.
    while count_new < 12 && step < 200 {
        fs::write(&result, &old).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .args(["trajectory", project.to_str().unwrap(), "--quiet"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // From the start to well after the end, at intervals shorter than a write.
        std::thread::sleep(took.mul_f64(f64::from(step) * 1.5 / 40.0));
        child.kill().unwrap();
        child.wait().unwrap();
        let present = fs::read(&result).unwrap();
        if present == old {
            count_old += 1;
        } else {
            assert!(
                present == new,
                "neither the old nor the new file at step {step}"
            );
            count_new += 1;
        }
        step += 1;
    }
    assert!(
        count_old > 0 && count_new > 0,
        "{count_old} old, {count_new} new: no kill in between"
    );

    // The next undisturbed run removes the temporary files of the killed ones.
    full_run();
    let left = names(&folder.path().join("out"));
    assert!(left.iter().all(|name| !name.starts_with('.')), "{left:?}");
}

/// Set for the child process that [`results_are_complete_after_a_kill_at_any_moment`] starts from its own binary.
const CHILD: &str = "BORESIGHT_TEST_OUTPUT_FOLDER";

fn write_results_until_killed(dir: &Path) -> ! {
    let mut i = 0;
    loop {
        i += 1;
        let staging = Staging::new(dir, &[], &["result.json"]).unwrap();
        let body = format!("{}\n", i % 10).repeat(200_000);
        fs::write(staging.path("cloud.txt"), &body).unwrap();
        fs::write(staging.path("result.json"), &body).unwrap();
        staging.commit().unwrap();
    }
}

#[test]
fn results_are_complete_after_a_kill_at_any_moment() {
    if let Some(dir) = std::env::var_os(CHILD) {
        write_results_until_killed(Path::new(&dir));
    }
    let dir = tempfile::tempdir().unwrap();
    let mut complete = 0;
    for k in 0..25 {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "kills::results_are_complete_after_a_kill_at_any_moment",
            ])
            .env(CHILD, dir.path())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(15 + 7 * k));
        child.kill().unwrap();
        child.wait().unwrap();
        for name in ["cloud.txt", "result.json"] {
            let Ok(text) = fs::read_to_string(dir.path().join(name)) else {
                continue;
            };
            complete += 1;
            assert_eq!(text.len(), 400_000, "{name}");
            assert!(text.lines().all(|line| line == &text[..1]), "{name}");
        }
    }
    assert!(
        complete > 0,
        "every child was killed before it wrote anything"
    );
    drop(Staging::new(dir.path(), &[], &["result.json"]).unwrap());
    let left = names(dir.path());
    assert!(left.iter().all(|name| !name.starts_with('.')), "{left:?}");
}
