//! Simulates drives by seed, adjusts each in two steps and in one piece, and compares both with the
//! truth: the tables of docs/joint.md.
//!
//! `cargo run --release --example joint -- 30 1 --case reference`

mod cases;
mod summary;

#[path = "../../tests/common/joint_drive.rs"]
mod joint_drive;

use boresight::Result;
use boresight::error::Error;
use boresight::joint::Rung;
use boresight::trajectory::Nodes;
use cases::Options;
use joint_drive::Run;
use summary::Summary;

const USAGE: &str = "joint [SEEDS] [FIRST] [--case NAME]… [--set KEY=VALUE]… [--nodes imu] \
                     [--surfel METRES] [--mounting RUNG] [--from-truth] [--eigen]";

fn main() -> Result<()> {
    let arguments = Arguments::read()?;
    for name in &arguments.cases {
        let mut summary = Summary::new(name);
        for seed in arguments.first..arguments.first + arguments.seeds {
            let setup = cases::setup(name, seed, &arguments.options)?;
            let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
            match Run::new(&setup, folder.path()) {
                Ok(run) => {
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
    options: Options,
}

impl Arguments {
    fn read() -> Result<Self> {
        let mut found = Self {
            seeds: 1,
            first: 1,
            cases: Vec::new(),
            eigen: false,
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
