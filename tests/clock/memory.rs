//! Damaged files, and the memory that it takes to read them.

use std::path::Path;

use boresight::format::*;

use crate::common::data;
use crate::common::samples::*;

/// Reads a file with every reader; each must return data or an error.
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

/// Reads files of all formats, each cut off at 60 places and changed at 200; with `each` above 1, only at every n-th of
/// these.
fn damaged_files_are_errors(each: usize) {
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
        for k in (0..60).step_by(each) {
            // Densely in the header, then throughout the file.
            let n = if k < 30 {
                k * 13
            } else {
                whole.len() * (k - 30) / 30
            };
            std::fs::write(&path, &whole[..n.min(whole.len() - 1)]).unwrap();
            try_everything(&path);
        }
        for k in (0..200).step_by(each) {
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
    // The files are small: memory must not follow the sizes that they claim.
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
fn damaged_files_give_data_or_errors_within_bounded_memory() {
    damaged_files_are_errors(7);
}

#[test]
#[ignore = "just acceptance"]
fn files_damaged_at_260_places_give_data_or_errors_within_bounded_memory() {
    damaged_files_are_errors(1);
}
