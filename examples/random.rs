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
use random_series::Series;

const USAGE: &str = "random [SEEDS] [FIRST]";

/// The results of the drives, and the figure.
const FOLDER: &str = "out/random";

fn main() -> Result<()> {
    let numbers = std::env::args().skip(1).map(|argument| {
        let wrong = |_| Error::data(format!("{argument}: not a number"), USAGE);
        argument.parse().map_err(wrong)
    });
    let numbers = numbers.collect::<Result<Vec<u64>>>()?;
    let seeds = numbers.first().copied().unwrap_or(20);
    let first = numbers.get(1).copied().unwrap_or(1);
    let folder = Path::new(FOLDER);
    let series = Series::run(first..first + seeds, folder)?;
    print!("{}", series.summary());
    let file = folder.join("ranks.svg");
    std::fs::write(&file, ranks::figure(&series.ranks())).map_err(|e| Error::io(&file, e))?;
    println!("{}", file.display());
    Ok(())
}
