//! Damaged files and killed writers.

use std::path::Path;

use boresight::format::*;

use super::common::{data, names};
use super::samples::*;

/// Reads a file in every way; it must end, in data or in an error.
fn try_everything(path: &Path) {
    let _ = inspect(path);
    let _ = read_cloud(path);
    let _ = read_trajectory(path);
    let _ = all_points_unchecked(path);
    let _ = read_mounting(path);
    let _ = read_imu(path);
    let _ = read_heading(path);
    let _ = read_positions(path, &boresight::sensor::Observations::AsFound);
}

fn all_points_unchecked(path: &Path) -> boresight::Result<()> {
    let mut reader = open_profiles(path)?;
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk)? {}
    Ok(())
}

#[test]
fn damaged_files_are_errors_and_never_more() {
    let dir = tempfile::tempdir().unwrap();
    let mut samples = ["a.bin", "a.laz", "a.las"]
        .map(|name| dir.path().join(name))
        .to_vec();
    write_recording(&samples[0], 4);
    write_cloud(&samples[1], 2000);
    write_cloud(&samples[2], 200);
    for name in [
        "las/autzen.laz",
        "las/extrabytes.laz",
        "las/autzen.las",
        "pcd/pdal_autzen-utm.pcd",
        "e57/cry_tiny_spherical.e57",
        "e57/pdal_A4_moved.e57",
        "ptx_pts/test.pts",
        "ptx_pts/1.2-with-color.ptx",
        "trajectory/pdal_2-points.sbet",
    ] {
        samples.push(data("readers").join(name));
    }
    for sample in samples {
        let whole = std::fs::read(&sample).unwrap();
        let path = dir
            .path()
            .join(format!("damaged-{}", sample.file_name().unwrap().display()));
        for k in 0..60 {
            // Dense in the header, then all along the file.
            let n = if k < 30 {
                k * 13
            } else {
                whole.len() * (k - 30) / 30
            };
            std::fs::write(&path, &whole[..n.min(whole.len() - 1)]).unwrap();
            try_everything(&path);
        }
        for k in 0..200 {
            let mut bytes = whole.clone();
            let span = if k % 2 == 0 {
                whole.len().min(600)
            } else {
                whole.len()
            };
            let at = ((noise(k, 7) * 0.5 + 0.5) * span as f64) as usize;
            bytes[at.min(span - 1)] ^= if k % 3 == 0 { 0xff } else { 1 << (k % 8) };
            std::fs::write(&path, &bytes).unwrap();
            try_everything(&path);
        }
    }
    // The files are small; what they claim to hold must not have been believed.
    #[cfg(target_os = "linux")]
    {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let peak = status
            .lines()
            .find_map(|line| line.strip_prefix("VmHWM:"))
            .unwrap();
        let peak_kib: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
        println!("peak memory {peak_kib} KiB");
        assert!(peak_kib < 1_000_000, "{peak_kib} KiB");
    }
}

#[test]
fn a_truncated_recording_says_where() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bin");
    write_recording(&path, 3);
    let whole = std::fs::read(&path).unwrap();
    let length = whole.len() / 3;
    for n in (length + 1)..(2 * length) {
        std::fs::write(&path, &whole[..n]).unwrap();
        let error = all_points(&path).unwrap_err().to_string();
        assert!(
            error.contains(&format!("starts at byte {length}")),
            "{error}"
        );
    }
    let mut wide = whole.clone();
    wide[length + 52..length + 56].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&path, &wide).unwrap();
    let error = all_points(&path).unwrap_err().to_string();
    assert!(error.contains(&format!(
        "byte {}: found a profile of 4294967295",
        length + 52
    )));
}

/// Set for the child process that [`killed_at_any_moment_results_are_whole`] starts of itself.
const CHILD: &str = "BORESIGHT_TEST_OUTPUT_FOLDER";

fn write_results_until_killed(dir: &Path) -> ! {
    let mut i = 0;
    loop {
        i += 1;
        let staging = boresight::output::Staging::new(dir, &[], &["result.json"]).unwrap();
        let body = format!("{}\n", i % 10).repeat(200_000);
        std::fs::write(staging.path("cloud.txt"), &body).unwrap();
        std::fs::write(staging.path("result.json"), &body).unwrap();
        staging.commit().unwrap();
    }
}

#[test]
fn killed_at_any_moment_results_are_whole() {
    if let Some(dir) = std::env::var_os(CHILD) {
        write_results_until_killed(Path::new(&dir));
    }
    let dir = tempfile::tempdir().unwrap();
    let mut seen = 0;
    for k in 0..25 {
        let mut child = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "damage::killed_at_any_moment_results_are_whole"])
            .env(CHILD, dir.path())
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(15 + 7 * k));
        child.kill().unwrap();
        child.wait().unwrap();
        for name in ["cloud.txt", "result.json"] {
            let Ok(text) = std::fs::read_to_string(dir.path().join(name)) else {
                continue;
            };
            seen += 1;
            assert_eq!(text.len(), 400_000, "{name}");
            assert!(text.lines().all(|line| line == &text[..1]), "{name}");
        }
    }
    assert!(seen > 0, "no child came far enough to write anything");
    drop(boresight::output::Staging::new(dir.path(), &[], &["result.json"]).unwrap());
    let left = names(dir.path());
    assert!(left.iter().all(|name| !name.starts_with('.')), "{left:?}");
}
