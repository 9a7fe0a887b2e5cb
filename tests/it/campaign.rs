//! Campaigns, tested with the real binary.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{self, Run, boresight, copy_drive, files, simulated};
use boresight::format::read_cloud;
use serde_json::Value;

const PLOTS: [&str; 2] = ["p1", "p2"];
const DATES: [&str; 3] = ["2025-05-01", "2025-05-08", "2025-05-15"];

/// A campaign of two plots on three dates, all with the tiny drive, and the temporary folder that contains it.
fn campaign(more: &str) -> (tempfile::TempDir, PathBuf) {
    let (temp, drive) = simulated();
    let root = temp.path().join("campaign");
    fs::create_dir_all(&root).unwrap();
    fs::copy(drive.join("../tls.laz"), root.join("tls.laz")).unwrap();
    for (date, plot) in DATES.iter().flat_map(|date| PLOTS.map(|plot| (date, plot))) {
        copy_drive(&drive, &root.join(date).join(plot));
    }
    let text =
        format!("[campaign]\ndrives = \"{{date}}/{{plot}}/project.toml\"\ntile_m = 2.0\n{more}");
    let path = root.join("campaign.toml");
    fs::write(&path, text).unwrap();
    (temp, path)
}

fn run(path: &Path, out: &Path, more: &[&str]) -> Run {
    let arguments = [
        "campaign",
        path.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    boresight(&[&arguments, more].concat())
}

/// All files below a folder with their bytes, without those that contain times.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = files(folder);
    files.retain(|path, _| {
        let name = path.file_name().unwrap();
        !["work.json", "log.txt", "campaign.html"]
            .map(OsStr::new)
            .contains(&name)
    });
    files
}

fn list(out: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(out.join("campaign.json")).unwrap()).unwrap()
}

fn folder_of(out: &Path, start: &str) -> PathBuf {
    let mut entries = fs::read_dir(out.join("items"))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    entries
        .find(|path| {
            path.file_name()
                .unwrap()
                .to_string_lossy()
                .starts_with(start)
        })
        .unwrap()
}

#[test]
fn a_corrupt_drive_fails_alone_and_is_computed_once_it_is_repaired() {
    let (temp, path) = campaign("");
    let root = path.parent().unwrap();
    let out = root.join("out");
    let broken = root.join(DATES[1]).join("p2/right.bin");
    let whole = fs::read(&broken).unwrap();
    fs::write(&broken, &whole[..whole.len() / 2]).unwrap();
    let first = run(&path, &out, &["--workers", "2"]);
    assert_eq!(first.code, 1, "{}", first.err);
    // The drive itself, and the changes to it and from it.
    assert!(
        first
            .out
            .contains("7 done, 0 kept from before; 10 items: 3 failed"),
        "{}",
        first.out
    );
    assert!(first.out.contains("right.bin, byte"), "{}", first.out);
    let page = fs::read_to_string(out.join("campaign.html")).unwrap();
    for part in [
        "drive p2 2025-05-08",
        "right.bin, byte",
        "not tried, as it needs drive p2 2025-05-08",
    ] {
        assert!(page.contains(part), "{part}");
    }
    // The failed drive has no folder.
    assert!(!fs::read_dir(out.join("items")).unwrap().any(|entry| {
        entry
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with("drive_p2_2025-05-08")
    }));
    fs::write(&broken, &whole).unwrap();
    let second = run(&path, &out, &["--workers", "2"]);
    assert_eq!(second.code, 0, "{}", second.err);
    assert!(
        second
            .out
            .contains("3 done, 7 kept from before; 10 items: 0 failed"),
        "{}",
        second.out
    );
    assert_eq!(list(&out)["failed"], 0);

    // Another folder and one worker give the same bytes.
    let other = temp.path().join("other");
    let third = run(&path, &other, &["--workers", "1"]);
    assert_eq!(third.code, 0, "{}", third.err);
    let (one, two) = (content(&out), content(&other));
    assert_eq!(
        one.keys().collect::<Vec<_>>(),
        two.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in &one {
        assert!(*bytes == two[name], "{} differs", name.display());
    }

    // The tiles contain the points that `georeference` writes.
    let result: Value = serde_json::from_slice(
        &one[&folder_of(&out, "drive_p1_2025-05-01")
            .strip_prefix(&out)
            .unwrap()
            .join("result.json")],
    )
    .unwrap();
    let tiles = result["tiles"].as_array().unwrap();
    assert!(tiles.len() > 1);
    let folder = folder_of(&out, "drive_p1_2025-05-01").join("tiles");
    let points: usize = tiles
        .iter()
        .map(|tile| {
            read_cloud(&folder.join(tile["file"].as_str().unwrap()))
                .unwrap()
                .points
                .len()
        })
        .sum();
    let project = root.join(DATES[0]).join("p1/project.toml");
    let placed = temp.path().join("placed");
    let done = boresight(&[
        "georeference",
        project.to_str().unwrap(),
        "--out",
        placed.to_str().unwrap(),
    ]);
    assert_eq!(done.code, 0, "{}", done.err);
    let clouds = ["left", "right"]
        .map(|name| read_cloud(&placed.join(format!("cloud-{name}.laz"))).unwrap());
    assert_eq!(
        points,
        clouds.iter().map(|cloud| cloud.points.len()).sum::<usize>()
    );
    assert_eq!(result["points"], points);

    // There is no change between dates with the same drive.
    let change: Value = serde_json::from_slice(
        &one[&folder_of(&out, "change_p1_2025-05-15")
            .strip_prefix(&out)
            .unwrap()
            .join("result.json")],
    )
    .unwrap();
    assert_eq!(change["change"]["m3c2_rmse_m"], 0.0);
}

#[test]
fn a_killed_campaign_continues_where_it_was() {
    let (_temp, path) = campaign("compare_with_before = false\n");
    let out = path.with_file_name("out");
    let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .args(["campaign", path.to_str().unwrap(), "--workers", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let is_done = |path: PathBuf| path.join("result.json").exists();
    let finished = || {
        let folders = fs::read_dir(out.join("items")).into_iter().flatten();
        folders
            .filter(|entry| is_done(entry.as_ref().unwrap().path()))
            .count()
    };
    let begun = Instant::now();
    while finished() < 2 {
        assert!(begun.elapsed() < Duration::from_secs(120) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    // The results on the disk are complete; the process of the current item ends without its parent.
    let before = finished();
    let again = run(&path, &out, &[]);
    assert_eq!(again.code, 0, "{}", again.err);
    assert!(again.out.contains("6 items: 0 failed"), "{}", again.out);
    assert!(!again.out.starts_with("6 done"), "{before}: {}", again.out);
    let leftovers = |folder: &Path| {
        let names = common::names(folder);
        names
            .into_iter()
            .filter(|name| name.starts_with(".staging"))
            .count()
    };
    assert_eq!(
        common::names(&out.join("items"))
            .iter()
            .map(|name| leftovers(&out.join("items").join(name)))
            .sum::<usize>(),
        0
    );
}

#[cfg(target_os = "linux")]
#[test]
fn an_item_that_runs_out_of_memory_says_so() {
    let (_temp, path) = campaign("compare_with_before = false\n");
    let out = path.with_file_name("out");
    let run = run(&path, &out, &["--memory-mb", "24", "--workers", "2"]);
    assert_eq!(run.code, 1, "{}", run.err);
    assert!(
        run.out.contains("out of memory: 24 MB are not enough"),
        "{}{}",
        run.out,
        run.err
    );
    let page = fs::read_to_string(out.join("campaign.html")).unwrap();
    assert!(page.contains("--memory-mb"));
    // With so little memory, its threads would wait for each other for ever.
    let run = self::run(&path, &out, &["--memory-mb", "5", "--workers", "1"]);
    assert_eq!(run.code, 1, "{}", run.err);
    assert!(run.err.contains("5 MB for an item with"), "{}", run.err);
}

#[test]
fn mistakes_in_one_drive_leave_the_others_and_mistakes_in_the_campaign_are_reported() {
    let (_temp, path) = campaign("calibration = \"{date}.toml\"\ncompare_with_before = false\n");
    let root = path.parent().unwrap();
    let out = root.join("out");
    // A calibration for one date only; one project with a mistyped key.
    let project = fs::read_to_string(root.join(DATES[0]).join("p1/project.toml")).unwrap();
    let scanners = project
        .split_once("[[scanner]]")
        .unwrap()
        .1
        .split("[reference]")
        .next()
        .unwrap();
    fs::write(
        root.join("2025-05-01.toml"),
        format!("# not usable\n[[scanner]]{scanners}"),
    )
    .unwrap();
    let mistyped = root.join(DATES[0]).join("p2/project.toml");
    fs::write(&mistyped, project.replace("[imu]", "[imo]")).unwrap();
    let run = run(&path, &out, &[]);
    assert_eq!(run.code, 1, "{}", run.err);
    assert!(run.out.contains("1 done"), "{}", run.out);
    // With mountings that are marked as not usable, the result is not usable either.
    let result = fs::read(folder_of(&out, "drive_p1").join("result.json")).unwrap();
    let result: Value = serde_json::from_slice(&result).unwrap();
    assert_eq!(result["headline"], "unusable");
    assert!(
        run.out.contains("2025-05-01/p2/project.toml, line"),
        "{}",
        run.out
    );
    assert!(
        run.out
            .contains("no file `{date}.toml` for plot p1 on 2025-05-08"),
        "{}",
        run.out
    );

    fs::write(&path, "[campaign]\ndrives = \"{date}/{plot}/drive.toml\"\n").unwrap();
    let none = boresight(&["campaign", path.to_str().unwrap()]);
    none.assert_failed_with(&["no file and no folder that matches `{date}/{plot}/drive.toml`"]);
    let missing = boresight(&["campaign", root.join("none.toml").to_str().unwrap()]);
    missing.assert_failed_with(&["none.toml"]);
}

#[test]
fn drives_can_be_folders_with_a_project_template_and_a_calibration_is_an_item() {
    let (_temp, path) = campaign("");
    let root = path.parent().unwrap();
    let text = fs::read_to_string(root.join(DATES[0]).join("p1/project.toml")).unwrap();
    // The drift watch needs more spots of the ground than coarse voxels leave.
    let text = text
        .replace("\"left.bin\"", "\"*ft.bin\"")
        .replace("voxel_sizes_m = [0.1]", "voxel_sizes_m = [0.05]");
    fs::write(root.join("robot.toml"), text).unwrap();
    let drive = root.join(DATES[0]).join("p1");
    copy_drive(&drive, &root.join("boards/20250501"));
    for date in DATES {
        for plot in PLOTS {
            fs::remove_file(root.join(date).join(plot).join("project.toml")).unwrap();
        }
    }
    fs::remove_dir_all(root.join(DATES[1])).unwrap();
    fs::remove_dir_all(root.join(DATES[2])).unwrap();
    fs::write(
        &path,
        "[campaign]\ndrives = \"{date}/{plot}\"\nproject = \"robot.toml\"\n\
         calibration_project = \"boards/{date}/project.toml\"\nreference = \"tls.laz\"\ndrift = true\n",
    )
    .unwrap();
    let out = root.join("out");
    let run = run(&path, &out, &[]);
    assert_eq!(run.code, 0, "{}{}", run.out, run.err);
    assert!(run.out.contains("5 done"), "{}", run.out);
    let result: Value = serde_json::from_str(
        &fs::read_to_string(folder_of(&out, "drive_p1").join("result.json")).unwrap(),
    )
    .unwrap();
    // The drive uses the calibrated mountings: millimetres from the reference, not centimetres.
    let rmse_m = result["agreement"][0]["m3c2_rmse_m"].as_f64().unwrap();
    assert!(rmse_m < 0.02, "{rmse_m}");
    let page = fs::read_to_string(out.join("campaign.html")).unwrap();
    assert!(page.contains("2 drives of 2 plots on 1 date") && page.contains("Drift watch"));
}
