//! Draws drives at random, runs each as a user would, and compares the results with the truth: the ranks of
//! docs/joint.md.
//!
//! `cargo run --release --features examples --example random -- 20 1`

#[path = "../tests/common/against_truth.rs"]
mod against_truth;
#[path = "../tests/common/moving.rs"]
mod moving;
#[path = "../tests/common/random_drive.rs"]
mod random_drive;

use boresight::Result;
use boresight::error::Error;
use random_drive::{Ended, Way};

const USAGE: &str = "random [SEEDS] [FIRST]";

fn main() -> Result<()> {
    let numbers = std::env::args().skip(1).map(|argument| {
        let wrong = |_| Error::data(format!("{argument}: not a number"), USAGE);
        argument.parse().map_err(wrong)
    });
    let numbers = numbers.collect::<Result<Vec<u64>>>()?;
    let seeds = numbers.first().copied().unwrap_or(20);
    let first = numbers.get(1).copied().unwrap_or(1);
    let mut all = Vec::new();
    for seed in first..first + seeds {
        let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
        let ended = Ended::of_seed(seed, folder.path())?;
        println!("{seed}: {}\n    {}", ended.drawn(), ended.line());
        all.push(ended);
    }
    let count = |what: fn(&Ended) -> bool| all.iter().filter(|ended| what(ended)).count();
    println!(
        "{} drives: {} joint, {} two steps, {} stopped; {} quietly wrong",
        all.len(),
        count(|ended| matches!(ended.way, Way::Joint(_))),
        count(|ended| matches!(ended.way, Way::TwoSteps(_))),
        count(|ended| matches!(ended.way, Way::Stopped(_))),
        count(Ended::is_quietly_wrong),
    );
    Ok(())
}
