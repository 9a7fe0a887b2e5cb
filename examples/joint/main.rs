//! Simulates drives with different seeds, adjusts each in two steps and jointly, and compares both results
//! with the truth: the tables of docs/joint.md.
//!
//! `cargo run --release --features examples --example joint -- 30 1 --case reference`

mod cases;
mod summary;

#[path = "../../tests/common/against_truth.rs"]
mod against_truth;
#[path = "../../tests/common/joint_drive.rs"]
mod joint_drive;
#[path = "../../tests/common/moving.rs"]
mod moving;

use std::path::{Path, PathBuf};

use boresight::Result;
use boresight::error::Error;
use boresight::format;
use boresight::joint::Rung;
use boresight::sensor::PoseRecord;
use boresight::trajectory::Nodes;
use cases::Options;
use joint_drive::Run;
use summary::Summary;

/// Interval of the poses that are written, seconds.
const STEP_S: f64 = 0.02;

const USAGE: &str = "joint [SEEDS] [FIRST] [--case NAME]… [--set KEY=VALUE]… [--nodes imu] \
                     [--surfel METRES] [--mounting RUNG] [--from-truth] [--eigen] [--scenario NAME|FILE] \
                     [--keep DIR]";

fn main() -> Result<()> {
    let arguments = Arguments::read()?;
    for name in &arguments.cases {
        let mut summary = Summary::new(name);
        for seed in arguments.first..arguments.first + arguments.seeds {
            let setup = cases::setup(name, seed, &arguments.options)?;
            let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
            match Run::new(&setup, folder.path()) {
                Ok(run) => {
                    if let Some(keep) = &arguments.keep {
                        write(keep, &run)?;
                    }
                    summary::print_seed(name, seed, &run);
                    if arguments.eigen {
                        summary::print_directions(&run);
                    }
                    summary.add(&run);
                }
                Err(error) => println!("{name} seed {seed}: {error}"),
            }
        }
        summary.print();
    }
    Ok(())
}

struct Arguments {
    seeds: u64,
    first: u64,
    cases: Vec<String>,
    eigen: bool,
    /// Folder for the poses and mountings by time of the last drive.
    keep: Option<PathBuf>,
    options: Options,
}

impl Arguments {
    fn read() -> Result<Self> {
        let mut found = Self {
            seeds: 1,
            first: 1,
            cases: Vec::new(),
            eigen: false,
            keep: None,
            options: Options::default(),
        };
        let wrong = |what: &str| Error::data(format!("{what}: not understood"), USAGE);
        let number = |text: &str| text.parse::<f64>().map_err(|_| wrong(text));
        let mut numbers = Vec::new();
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or_else(|| wrong(&argument));
            match argument.as_str() {
                "--case" => found.cases.push(value()?),
                "--set" => found.options.set.push(value()?),
                "--nodes" if value()? == "imu" => found.options.nodes = Nodes::Imu,
                "--surfel" => found.options.surfel_m = Some(number(&value()?)?),
                "--mounting" => found.options.mounting = Some(rung(&value()?)?),
                "--from-truth" => found.options.from_truth = true,
                "--eigen" => found.eigen = true,
                "--scenario" => found.options.scenario = Some(value()?),
                "--keep" => found.keep = Some(value()?.into()),
                other => numbers.push(other.parse().map_err(|_| wrong(other))?),
            }
        }
        if let Some(seeds) = numbers.first() {
            found.seeds = *seeds;
        }
        if let Some(first) = numbers.get(1) {
            found.first = *first;
        }
        if found.cases.is_empty() {
            found.cases.push("reference".into());
        }
        Ok(found)
    }
}

/// Writes `trajectory.csv` and `mounting.csv` at equal intervals.
fn write(folder: &Path, run: &Run) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let drive = &run.joint.drives[0];
    let (from_s, to_s) = drive.trajectory.span_s();
    let count = ((to_s - from_s) / STEP_S) as usize;
    let times_s = || (0..=count).map(|k| from_s + STEP_S * k as f64);
    let poses = times_s().filter_map(|t| Some(PoseRecord::new(t, drive.trajectory.pose_at(t)?)));
    let poses: Vec<PoseRecord> = poses.collect();
    format::write_trajectory(&folder.join("trajectory.csv"), &poses)?;
    let mut text = "time_s,scanner,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
    for (scanner, mounting) in run.joint.mountings.iter().enumerate() {
        let mean = &mounting.body_from_scanner;
        for time_s in times_s() {
            let moved = drive.bending.get(scanner);
            let now = moved.map_or(*mean, |moved| moved.offsets.apply(mean, time_s));
            let (t, q) = (now.translation_m, now.rotation);
            let row = [t.x, t.y, t.z, q.i, q.j, q.k, q.w].map(|x| format!("{x:.12}"));
            text += &format!("{time_s:.4},{},{}\n", mounting.name, row.join(","));
        }
    }
    let file = folder.join("mounting.csv");
    std::fs::write(&file, text).map_err(|e| Error::io(file, e))
}

fn rung(name: &str) -> Result<Rung> {
    let unknown = || {
        Error::data(
            format!("no rung {name}"),
            "rigid, compliance, slow-knots, dense-knots",
        )
    };
    let found = serde_json::from_value(name.into());
    found.map_err(|_| unknown())
}
