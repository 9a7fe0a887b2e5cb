//! `boresight trajectory --online` on complete logs, on logs that grow, and on standard input.

use super::rover::rover_drive;
use boresight::format;
use boresight::sensor::PoseRecord;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const BOUND_M: f64 = 1e-6;

/// A day, seconds.
const DAY_S: f64 = 86_400.0;

/// How often a run says that the times of a log started again, and that a log lies on the other side of a start than
/// that of the IMU.
#[derive(Clone, Copy, Default)]
struct Starts {
    again: usize,
    sides: usize,
}

/// Writes a project of a simulated minute, less what `cut` removes of it, that begins at a time of day; the times start
/// again at midnight.
fn project(folder: &Path, begin_s: f64, cut: impl Fn(&mut super::Logs)) -> super::Logs {
    let (mut logs, _) = rover_drive(1);
    cut(&mut logs);
    let of_day = |time_s: &mut f64| *time_s = (*time_s + begin_s) % DAY_S;
    logs.imu.iter_mut().for_each(|s| of_day(&mut s.time_s));
    logs.prism.iter_mut().for_each(|f| of_day(&mut f.time_s));
    logs.heading.iter_mut().for_each(|h| of_day(&mut h.time_s));
    format::write_imu(&folder.join("imu.csv"), &logs.imu).expect("written");
    format::write_positions(&folder.join("prism.csv"), &logs.prism).expect("written");
    format::write_heading(&folder.join("heading.csv"), &logs.heading).expect("written");
    let noise = logs.settings.imu;
    let arm = logs.settings.positions[0].lever_arm_m;
    let text = format!(
        "[frame]\nbody = \"FLU\"\norigin_m = [0.5, 0.25, 0]\n[imu]\nfile = \"imu.csv\"\n\
         gyro_noise_deg_sqrt_h = {}\naccel_noise_ug_sqrt_hz = {}\n\
         gyro_bias_walk_rad_s_sqrt_s = {}\naccel_bias_walk_m_s2_sqrt_s = {}\n\
         [prism]\nfile = \"prism.csv\"\nlever_arm_m = [{}, {}, {}]\nsigma_m = 0.004\n\
         [heading]\nfile = \"heading.csv\"\nsigma_deg = {}\n",
        noise.gyro_density.to_degrees() * 60.0,
        noise.accel_density / 9.806_65e-6,
        noise.gyro_bias_walk,
        noise.accel_bias_walk,
        arm.x,
        arm.y,
        arm.z,
        0.01f64.to_degrees(),
    );
    std::fs::write(folder.join("project.toml"), text).expect("written");
    logs
}

fn boresight(folder: &Path, out: &str, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_boresight"));
    command
        .args(["trajectory", "project.toml", "--out", out])
        .args(flags)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// The answer of a run that names these starts.
fn text(output: &Output, starts: Starts) -> String {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    let count = |sentence: &str| stderr.matches(sentence).count();
    assert_eq!(count("the times start again"), starts.again, "{stderr}");
    assert_eq!(count("lie on both sides"), starts.sides, "{stderr}");
    String::from_utf8(output.stdout.clone()).expect("text")
}

/// Largest distance between poses at the same times.
fn apart_m(a: &[PoseRecord], b: &[PoseRecord]) -> f64 {
    assert_eq!(a.len(), b.len());
    let distances = a.iter().zip(b).map(|(a, b)| {
        assert_eq!(a.time_s, b.time_s);
        let (a, b) = (a.world_from_body, b.world_from_body);
        (a.translation_m - b.translation_m).norm()
    });
    distances.fold(0.0, f64::max)
}

fn poses(folder: &Path, file: &str) -> Vec<PoseRecord> {
    format::read_trajectory(&folder.join(file)).expect("poses")
}

#[test]
fn replayed_followed_and_piped_logs_give_the_same_trajectory() {
    let drive = assert_all_ways_agree(0.0, Starts::default(), |_| {});
    drive.assert_growing_and_batch_are_the_same(Starts::default());
}

#[test]
fn replayed_followed_and_piped_logs_agree_past_midnight() {
    // The logs of the IMU, the prism and the headings.
    let starts = Starts { again: 3, sides: 0 };
    let drive = assert_all_ways_agree(DAY_S - 30.0, starts, |_| {});
    drive.assert_growing_and_batch_are_the_same(starts);
}

#[test]
fn a_sensor_that_begins_after_midnight_joins_an_imu_that_began_before() {
    let starts = Starts { again: 2, sides: 1 };
    assert_all_ways_agree(DAY_S - 2.0, starts, |logs| {
        logs.prism.retain(|fix| fix.time_s > 2.5);
    });
}

#[test]
fn sensors_that_began_before_midnight_join_an_imu_that_begins_after() {
    let starts = Starts { again: 2, sides: 2 };
    assert_all_ways_agree(DAY_S - 2.0, starts, |logs| {
        logs.imu.retain(|sample| sample.time_s > 2.5);
    });
}

/// A drive on which replayed, piped and followed logs agree.
struct Drive {
    folder: tempfile::TempDir,
    newest: Vec<PoseRecord>,
    /// Without and with `--online`.
    batch: Vec<PoseRecord>,
    whole: Vec<PoseRecord>,
}

/// A drive that begins at a time of day, as a whole and online in all ways.
fn assert_all_ways_agree(begin_s: f64, starts: Starts, cut: impl Fn(&mut super::Logs)) -> Drive {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path();
    let logs = project(folder, begin_s, cut);
    let continued_s = |time_s: f64| time_s + if time_s < begin_s { DAY_S } else { 0.0 };
    let first_s = continued_s(logs.imu[0].time_s);
    let fixes = logs.prism.iter();
    let fixes = fixes
        .filter(|fix| continued_s(fix.time_s) > first_s)
        .count() as u64;
    let output = boresight(folder, "batch", &[]).output();
    text(&output.expect("it runs"), starts);
    let output = boresight(folder, "replay", &["--online", "--json"]).output();
    let answer = text(&output.expect("it runs"), starts);
    let answer: serde_json::Value = serde_json::from_str(&answer).expect("one document");
    let updates = answer["online"]["updates"].as_u64().expect("a number");
    assert!((fixes - 40..=fixes).contains(&updates), "{updates}");
    assert!(answer["online"]["update_ms_median"].as_f64() > Some(0.0));
    assert!(answer["trajectory"]["sensors"][0]["name"].is_string());
    // As many as there are records.
    assert!(answer["trajectory"].get("residuals").is_none());
    let batch = poses(folder, "batch/trajectory.csv");
    let whole = poses(folder, "replay/trajectory.csv");
    let newest = poses(folder, "replay/online.csv");
    assert_eq!(newest.len() as u64, updates);
    assert!(newest.iter().all(|pose| pose.sigma.is_some()));

    assert_piped_is_the_same(folder, &logs, begin_s, starts, &newest, &whole);
    // Whole logs, which are read in pieces, are followed as they are replayed.
    let output = boresight(folder, "read", &["--online", "--follow", "--idle-s", "0.2"]).output();
    let answer = text(&output.expect("it runs"), starts);
    let rows = answer.lines().filter(|line| !line.starts_with('#')).count();
    assert_eq!(rows, newest.len() + 1);
    assert!(apart_m(&whole, &poses(folder, "read/trajectory.csv")) < BOUND_M);
    Drive {
        folder: temporary,
        newest,
        batch,
        whole,
    }
}

/// The same records, merged, through standard input.
fn assert_piped_is_the_same(
    folder: &Path,
    logs: &super::Logs,
    begin_s: f64,
    starts: Starts,
    newest: &[PoseRecord],
    whole: &[PoseRecord],
) {
    let mut lines: Vec<(f64, usize, String)> = Vec::new();
    for s in &logs.imu {
        let (w, a) = (s.gyro_rad_s, s.accel_m_s2);
        let line = format!(
            "imu,{},{},{},{},{},{},{}",
            s.time_s, w.x, w.y, w.z, a.x, a.y, a.z
        );
        lines.push((s.time_s, 0, line));
    }
    for h in &logs.heading {
        let line = format!("heading,{},{}", h.time_s, h.heading_rad.to_degrees());
        lines.push((h.time_s, 1, line));
    }
    for f in &logs.prism {
        let p = f.position_m;
        lines.push((
            f.time_s,
            2,
            format!("prism,{},{},{},{}", f.time_s, p.x, p.y, p.z),
        ));
    }
    let continued_s = |time_s: f64| time_s + if time_s < begin_s { DAY_S } else { 0.0 };
    lines.sort_by(|a, b| (continued_s(a.0).total_cmp(&continued_s(b.0))).then(a.1.cmp(&b.1)));
    let lines: Vec<String> = lines.into_iter().map(|(.., line)| line).collect();
    let mut child = boresight(folder, "piped", &["--online", "--stdin"])
        .stdin(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut stdin = child.stdin.take().expect("a pipe");
    let all = lines.join("\n");
    let writer = std::thread::spawn(move || writeln!(stdin, "# merged\n\n{all}"));
    let answer = text(&child.wait_with_output().expect("it ends"), starts);
    writer.join().expect("no panic").expect("written");
    let rows: Vec<&str> = answer
        .lines()
        .filter(|line| !line.starts_with('#'))
        .collect();
    assert!(rows[0].starts_with("time_s,east_m"));
    assert_eq!(rows.len(), newest.len() + 1);
    for (row, pose) in rows[1..].iter().zip(newest) {
        let x: Vec<f64> = row
            .split(',')
            .map(|x| x.parse().expect("a number"))
            .collect();
        assert_eq!(x.len(), 14);
        assert_eq!(
            (x[0], x[1]),
            (pose.time_s, pose.world_from_body.translation_m.x)
        );
    }
    assert!(apart_m(whole, &poses(folder, "piped/trajectory.csv")) < BOUND_M);

    let mut child = boresight(folder, "bad", &["--online", "--stdin"])
        .stdin(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin
        .write_all(b"imu,0,0,0,0,0,0,9.81\nlidar,1,2\n")
        .expect("written");
    drop(stdin);
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(1));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        stderr.contains("stdin, line 2") && stderr.contains("`lidar`"),
        "{stderr}"
    );
}

impl Drive {
    /// The same logs, followed while they are written in pieces that end inside lines.
    fn assert_growing_and_batch_are_the_same(&self, starts: Starts) {
        let (folder, newest, batch) = (self.folder.path(), &self.newest, &self.batch);
        assert!(apart_m(batch, &self.whole) < BOUND_M);
        let names = ["imu.csv", "prism.csv", "heading.csv"];
        let whole = names.map(|name| std::fs::read(folder.join(name)).expect("a log"));
        for (name, bytes) in names.iter().zip(&whole) {
            std::fs::write(folder.join(name), &bytes[..bytes.len() / 50]).expect("written");
        }
        let child = boresight(
            folder,
            "followed",
            &["--online", "--follow", "--idle-s", "2"],
        )
        .spawn()
        .expect("it runs");
        for part in 1..50 {
            for (name, bytes) in names.iter().zip(&whole) {
                let (from, to) = (bytes.len() * part / 50, bytes.len() * (part + 1) / 50);
                let mut log = std::fs::OpenOptions::new()
                    .append(true)
                    .open(folder.join(name))
                    .expect("a log");
                log.write_all(&bytes[from..to]).expect("written");
            }
            std::thread::sleep(Duration::from_millis(15));
        }
        let answer = text(&child.wait_with_output().expect("it ends"), starts);
        // Logs written in pieces run ahead of each other, which adds or drops some poses.
        let rows = answer.lines().filter(|line| !line.starts_with('#')).count();
        assert!(rows.abs_diff(newest.len() + 1) < newest.len() / 3, "{rows}");
        assert!(apart_m(batch, &poses(folder, "followed/trajectory.csv")) < BOUND_M);
        assert!(!folder.join("followed/new-rows.csv").exists());
    }
}

#[test]
fn a_last_line_without_a_line_end_is_reported() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path();
    project(folder, 0.0, |_| {});
    let path = folder.join("prism.csv");
    let text = std::fs::read_to_string(&path).expect("a log");
    std::fs::write(&path, text.trim_end()).expect("written");
    let output = boresight(folder, "cut", &["--online", "--follow", "--idle-s", "0.2"]).output();
    let output = output.expect("it runs");
    assert!(output.status.success());
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        stderr.contains("prism.csv: the last line has no end"),
        "{stderr}"
    );
}
