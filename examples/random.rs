//! Draws drives at random, runs each as a user would, and compares the results with the truth: the figure of ranks in
//! docs/joint.md.
//!
//! `cargo run --release --features examples --example random -- 20 1`

#[path = "../tests/common/against_truth.rs"]
mod against_truth;
#[path = "../tests/common/moving.rs"]
mod moving;
#[path = "../tests/common/random_drive.rs"]
mod random_drive;
#[path = "../tests/common/random_series.rs"]
mod random_series;
#[path = "../tests/common/ranks.rs"]
mod ranks;

use std::path::Path;

use boresight::Result;
use boresight::error::Error;
use boresight::simulation::Extent;
use random_drive::{Draw, with_fault, without_fault};
use random_series::Series;

const USAGE: &str = "random [SEEDS] [FIRST] [tiny] [faulty]";

/// The results of the drives, and the figure.
const FOLDER: &str = "out/random";
/// Those of tiny drives.
const TINY: &str = "out/random-tiny";

fn main() -> Result<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_faulty = arguments.pop_if(|last| last == "faulty").is_some();
    let is_tiny = arguments.pop_if(|last| last == "tiny").is_some();
    let (extent, folder) = if is_tiny {
        (Extent::TINY, TINY)
    } else {
        (Extent::FULL, FOLDER)
    };
    let (draw, folder): (Box<Draw>, String) = if is_faulty {
        (Box::new(with_fault(extent)), format!("{folder}-faulty"))
    } else {
        (Box::new(without_fault(extent)), folder.to_owned())
    };
    let numbers = arguments.iter().map(|argument| {
        let wrong = |_| Error::data(format!("{argument}: not a number"), USAGE);
        argument.parse().map_err(wrong)
    });
    let numbers = numbers.collect::<Result<Vec<u64>>>()?;
    let seeds = numbers.first().copied().unwrap_or(20);
    let first = numbers.get(1).copied().unwrap_or(1);
    let folder = Path::new(&folder);
    let series = Series::run(first..first + seeds, &draw, folder)?;
    print!("{}", series.summary());
    let file = folder.join("ranks.svg");
    std::fs::write(&file, ranks::figure(&series.ranks())).map_err(|e| Error::io(&file, e))?;
    println!("{}", file.display());
    Ok(())
}
