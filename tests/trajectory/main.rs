//! The trajectory stage against simulated drives with truth and a recorded flight with reference.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/consistency.rs"]
mod consistency;
mod constants;
mod faults;
mod faulty;
mod logs_as_they_come;
mod nees;
mod online;
mod online_cli;
mod pose_case;
mod pose_case_faults;
mod recorded_flight;
mod rover;
mod twin;
mod units;

use boresight::geometry::{Rotation, Vec3};
use boresight::progress::Silent;
use boresight::sensor::{HeadingFix, ImuSample, PositionFix};
use boresight::trajectory::TrajectorySettings;
use boresight::trajectory::{Estimate, MotionLogs, estimate};
use nalgebra::Quaternion;
use std::path::Path;

/// The numbers of a CSV file, without its header and comments.
fn numbers(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).expect("readable file");
    text.lines()
        .filter(|line| {
            !line.is_empty() && !line.starts_with(|c: char| c.is_alphabetic() || c == '#')
        })
        .map(|line| {
            line.split(',')
                .map(|x| x.trim().parse().expect("a number"))
                .collect()
        })
        .collect()
}

fn vec3(row: &[f64], first: usize) -> Vec3 {
    Vec3::new(row[first], row[first + 1], row[first + 2])
}

/// Quaternion from w, x, y, z.
fn quaternion(row: &[f64], w: usize) -> Rotation {
    Rotation::from_quaternion(Quaternion::new(row[w], row[w + 1], row[w + 2], row[w + 3]))
}

/// The number after `"key":` in a flat JSON file.
fn json_number(text: &str, key: &str) -> f64 {
    let (_, rest) = text
        .split_once(&format!("\"{key}\":"))
        .expect("the key is there");
    let end = rest.find([',', '\n', '}']).expect("the value ends");
    rest[..end].trim().parse().expect("a number")
}

/// What `estimate` takes.
struct Logs {
    imu: Vec<ImuSample>,
    prism: Vec<PositionFix>,
    heading: Vec<HeadingFix>,
    settings: TrajectorySettings,
}

impl Logs {
    fn estimate(&self) -> Estimate {
        self.try_estimate().expect("a trajectory")
    }

    fn try_estimate(&self) -> boresight::Result<Estimate> {
        let logs = MotionLogs {
            imu: &self.imu,
            positions: std::slice::from_ref(&self.prism),
            heading: &self.heading,
        };
        estimate(&logs, &self.settings, &Silent)
    }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(s, n), x| (s + x * x, n + 1));
    (sum / f64::from(count)).sqrt()
}

fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}
