//! No command replaces a file that boresight did not write, unless `--force` is given.

use std::fs;
use std::path::Path;

use crate::common::{boresight_at, project_of_logs};

const MINE: &str = "mine";

/// Runs a command that would write `name`, which exists: it refuses and writes nothing, and replaces it with `--force`.
fn assert_refuses(folder: &Path, arguments: &[&str], name: &str) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, MINE).unwrap();
    let run = boresight_at(folder, arguments);
    assert_eq!(run.code, 1, "{arguments:?}: {}{}", run.out, run.err);
    let file = path.file_name().unwrap().to_str().unwrap();
    assert!(
        run.err.contains(&format!("{file} exists")) && run.err.contains("--force"),
        "{arguments:?}: {}",
        run.err
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), MINE, "{arguments:?}");
    let run = boresight_at(folder, &[arguments, &["--force"]].concat());
    assert_eq!(run.code, 0, "{arguments:?}: {}{}", run.out, run.err);
    assert_ne!(fs::read(&path).unwrap(), MINE.as_bytes(), "{arguments:?}");
}

fn cloud(path: &Path) {
    let point = |i: u32| format!("{},{},{}\n", i % 30, i / 30, i % 7);
    let rows: String = (0..900).map(point).collect();
    fs::write(path, format!("x,y,z\n{rows}")).unwrap();
}

#[test]
fn files_of_the_user_are_kept() {
    let temp = project_of_logs();
    let folder = temp.path();
    cloud(&folder.join("a.csv"));
    assert_refuses(folder, &["convert", "a.csv", "b.ply"], "b.ply");
    assert_refuses(folder, &["convert", "a.csv", "sub/b.laz"], "sub/b.laz");
    assert_refuses(folder, &["salvage", "imu.csv", "--out", "s"], "s/imu.csv");
    let thin = ["thin", "a.csv", "--voxel-m", "2", "--out", "t"];
    assert_refuses(folder, &thin, "t/a-thinned.laz");
    let features = ["features", "a.csv", "--out", "f"];
    assert_refuses(folder, &features, "f/a-features.laz");
    let compare = ["compare", "a.csv", "a.csv", "--out", "c"];
    assert_refuses(folder, &compare, "c/compare.html");
    let trajectory = ["trajectory", "project.toml", "--out", "p"];
    assert_refuses(folder, &trajectory, "p/trajectory.csv");
    assert_refuses(folder, &["man", "m"], "m/boresight-run.1");
}

#[test]
fn drives_are_replaced_on_request_only() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let scenario = std::env::current_dir()
        .unwrap()
        .join("tests/data/tiny_scenario.toml");
    let simulate = [
        "simulate",
        "--scenario",
        scenario.to_str().unwrap(),
        "--out",
        "s",
    ];
    fs::create_dir_all(folder.join("s/drive-1")).unwrap();
    fs::write(folder.join("s/drive-1/imu.csv"), MINE).unwrap();
    let run = boresight_at(folder, &simulate);
    assert!(
        run.code == 1 && run.err.contains("drive-1 exists"),
        "{}",
        run.err
    );
    assert_eq!(
        fs::read_to_string(folder.join("s/drive-1/imu.csv")).unwrap(),
        MINE
    );
    fs::remove_dir_all(folder.join("s")).unwrap();
    assert_refuses(folder, &simulate, "s/tls.laz");
    // Drives that boresight wrote are data, too.
    let run = boresight_at(folder, &simulate);
    assert!(run.code == 1 && run.err.contains("--force"), "{}", run.err);
}

#[test]
fn results_of_boresight_are_replaced_and_those_of_others_beside_them_are_not() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    cloud(&folder.join("a.csv"));
    // A folder of its own.
    let thin = |out| ["thin", "a.csv", "--voxel-m", "2", "--out", out];
    for _ in 0..2 {
        let run = boresight_at(folder, &thin("own"));
        assert_eq!(run.code, 0, "{}", run.err);
    }
    // A folder of the user, in which boresight may replace what it wrote, also after other commands.
    fs::create_dir(folder.join("mixed")).unwrap();
    fs::write(folder.join("mixed/m3c2.csv"), MINE).unwrap();
    let features = ["features", "a.csv", "--out", "mixed"];
    for arguments in [&thin("mixed")[..], &features, &thin("mixed")] {
        let run = boresight_at(folder, arguments);
        assert_eq!(run.code, 0, "{}", run.err);
    }
    let compare = ["compare", "a.csv", "a.csv", "--out", "mixed"];
    assert_refuses(folder, &compare, "mixed/m3c2.csv");
    // A log that is not one of boresight.
    fs::create_dir(folder.join("logged")).unwrap();
    fs::write(folder.join("logged/log.txt"), MINE).unwrap();
    let run = boresight_at(folder, &thin("logged"));
    assert!(run.code == 0 && run.err.contains("log.txt"), "{}", run.err);
    assert_eq!(
        fs::read_to_string(folder.join("logged/log.txt")).unwrap(),
        MINE
    );
}
