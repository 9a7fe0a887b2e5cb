//! Accidents, tested with the real binary: files that claim too much, pipes, full disks, Ctrl-C.

use std::fmt::Write;
use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{self, boresight, names};

/// Asserts that a command fails within seconds, with a short message that contains `expected`.
fn assert_refused_quickly(arguments: &[&str], expected: &[&str]) {
    let begun = Instant::now();
    let run = boresight(arguments);
    assert!(begun.elapsed() < Duration::from_secs(10));
    assert!(run.err.len() < 4000, "{} bytes", run.err.len());
    run.assert_failed_with(expected);
}

#[test]
fn an_extended_record_that_claims_a_terabyte_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    // A LAS 1.4 header without points, and one extended record.
    let mut bytes = vec![0; 375 + 60];
    bytes[..4].copy_from_slice(b"LASF");
    (bytes[24], bytes[25]) = (1, 4);
    bytes[94..96].copy_from_slice(&375u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375u32.to_le_bytes());
    (bytes[104], bytes[105]) = (6, 30);
    bytes[235..243].copy_from_slice(&375u64.to_le_bytes());
    bytes[243..247].copy_from_slice(&1u32.to_le_bytes());
    bytes[375 + 20..375 + 28].copy_from_slice(&(1u64 << 40).to_le_bytes());
    fs::write(&path, bytes).unwrap();
    let path = path.to_str().unwrap();
    assert_refused_quickly(
        &["inspect", path],
        &["byte 375", "extended record of 1099511627776 bytes"],
    );
}

#[test]
fn compressed_points_that_the_file_cannot_hold_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = common::data("readers").join("las/autzen.laz");
    let mut bytes = fs::read(source).unwrap();
    bytes[107..111].copy_from_slice(&100_000_000u32.to_le_bytes());
    let path = folder.path().join("claims.laz");
    fs::write(&path, bytes).unwrap();
    assert_refused_quickly(
        &["inspect", path.to_str().unwrap()],
        &["100000000 points of 34 bytes in a file of 2490 bytes"],
    );
}

#[test]
fn compressed_points_that_would_fill_the_memory_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.pcd");
    // Two megabytes that unpack to 176 megabytes of equal bytes: a literal, and copies of it.
    let copies = 2_000_000 / 3;
    let unpacked = 1 + 264 * copies;
    let points = unpacked / 12;
    let mut body = vec![0, 0];
    for _ in 0..copies {
        body.extend([0xe0, 0xff, 0]);
    }
    let mut bytes = format!(
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {points}\nHEIGHT 1\n\
         POINTS {points}\nDATA binary_compressed\n"
    )
    .into_bytes();
    bytes.extend((body.len() as u32).to_le_bytes());
    bytes.extend((12 * points as u32).to_le_bytes());
    bytes.extend(body);
    fs::write(&path, bytes).unwrap();
    assert_refused_quickly(
        &["inspect", path.to_str().unwrap()],
        &["bytes that unpack to", "binary"],
    );
}

#[test]
fn a_panic_of_a_decoder_prints_no_trace() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(common::data("readers").join("las/autzen.laz")).unwrap();
    let path = folder.path().join("damaged.laz");
    // Every third byte of the compression record: some of these make the decoder panic.
    let start = whole
        .windows(13)
        .position(|w| w == b"laszip encode")
        .unwrap_or(227);
    for at in (start..start + 90).step_by(3) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0xff;
        fs::write(&path, bytes).unwrap();
        let run = boresight(&["inspect", path.to_str().unwrap()]);
        assert!(!run.err.contains("panicked"), "byte {at}: {}", run.err);
        assert!(run.err.len() < 2000, "byte {at}: {}", run.err);
    }
}

#[test]
fn only_a_part_of_a_long_wrong_value_is_quoted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("project.toml");
    let long = "\"x\", ".repeat(300_000);
    fs::write(&path, format!("[calibration]\nvoxel_sizes_m = [{long}]\n")).unwrap();
    assert_refused_quickly(&["run", path.to_str().unwrap()], &["project.toml, line 2"]);
}

#[test]
fn twenty_thousand_scanners_are_too_many() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("project.toml");
    let mut text = "[trajectory]\nfile = \"a.csv\"\n".to_owned();
    for i in 0..20_000 {
        let _ = writeln!(
            text,
            "[[scanner]]\nname = \"s{i}\"\nprofiles = \"a.bin\"\ntranslation_m = [0, 0, 0]\n\
             rotation_deg = [0, 0, 0]"
        );
    }
    fs::write(&path, text).unwrap();
    assert_refused_quickly(
        &["run", path.to_str().unwrap()],
        &["20000 scanners", "1000 at most"],
    );
}

#[test]
#[cfg(unix)]
fn a_pipe_instead_of_a_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe.csv");
    let made = Command::new("mkfifo").arg(&path).status().unwrap();
    assert!(made.success());
    let path = path.to_str().unwrap();
    assert_refused_quickly(
        &["inspect", path],
        &["found a pipe or a device, expected a file"],
    );
    assert_refused_quickly(
        &["run", path],
        &["found a pipe or a device, expected a file"],
    );
}

#[test]
#[cfg(target_os = "linux")]
fn the_error_of_a_full_disk_says_so() {
    use boresight::format::CloudWriter;
    use boresight::geometry::Vec3;
    // Writing to this device always fails as on a full disk; the link gives it a name with an extension.
    let folder = tempfile::tempdir().unwrap();
    for name in ["full.laz", "full.las"] {
        let path = folder.path().join(name);
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let write = || {
            let mut writer = CloudWriter::create(&path, Vec3::zeros())?;
            for i in 0..300_000 {
                writer.write(&Vec3::new(f64::from(i) * 1e-3, 0.0, 0.0), 0.0, 0.0, 0)?;
            }
            writer.finish()
        };
        let error = write().unwrap_err().to_string();
        assert!(error.contains("No space left on device"), "{name}: {error}");
    }
}

#[test]
fn simulated_drives_are_replaced_only_with_force() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let scenario = folder.path().join("tiny.toml");
    fs::write(&scenario, common::TINY_SCENARIO).unwrap();
    let target = format!("{out}/drives");
    let simulate = [
        "simulate",
        "--scenario",
        scenario.to_str().unwrap(),
        "--out",
        &target,
    ];
    assert_eq!(boresight(&simulate).code, 0);
    let again = boresight(&simulate);
    assert_eq!(again.code, 1);
    assert!(
        again.err.contains("--force to replace them"),
        "{}",
        again.err
    );
    assert_eq!(boresight(&[&simulate[..], &["--force"]].concat()).code, 0);
}

/// Ctrl-C ends the run soon, with a message and without incomplete files.
#[test]
#[cfg(unix)]
fn an_interrupted_run_says_so_and_leaves_no_incomplete_files() {
    let (_temp, drive) = common::simulated();
    let out = drive.join("out");
    let child = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .args(["run", drive.join("project.toml").to_str().unwrap()])
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // The run has begun once its output folder exists.
    let begun = Instant::now();
    while !out.is_dir() && begun.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let interrupted = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(interrupted.unwrap().success());
    let ended = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(130), "{text}");
    assert!(
        text.contains("stopping") && text.contains("cancelled"),
        "{text}"
    );
    let left = names(&out);
    assert!(
        left.iter().all(|name| !name.starts_with(".staging")),
        "{left:?}"
    );
}

#[test]
#[cfg(unix)]
fn a_closed_pipe_ends_following_without_an_error() {
    let folder = common::project_of_logs();
    let project = folder.path().join("project.toml");
    let command = format!(
        "{} trajectory {} --online --follow --idle-s 1 | head -n 1 > /dev/null; exit ${{PIPESTATUS[0]}}",
        env!("CARGO_BIN_EXE_boresight"),
        project.display()
    );
    let run = Command::new("bash")
        .args(["-c", &command])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(0), "{text}");
    assert!(!text.contains("error"), "{text}");
}
