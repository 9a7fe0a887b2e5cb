//! Consistency of the poses' errors with their covariances over many simulated drives.
//!
//! `cargo run --release --features examples --example consistency -- 50` prints, for position (3 degrees of freedom),
//! tilt (2) and yaw (1), the mean normalised squared error at 20 epochs over the drives, and the
//! number of epochs within the 95 % band of χ²; then the same for the constants. An optional second
//! argument is the first seed, 0 by default: `-- 50 50` runs 50 drives different from those of `-- 50`.

use boresight::simulation::{Drive, Scenario, Scene};
use boresight::trajectory::Constant;
use boresight::{Error, Result};
use std::collections::BTreeMap;

#[path = "../tests/common/consistency.rs"]
mod consistency;
use consistency::{EPOCHS, band, squares_at_epochs, twin};

const LATENCY_S: f64 = 0.03;
const OFFSET_DEG: f64 = 1.5;

/// Errors of a constant in standard deviations.
#[derive(Default)]
struct Errors {
    sum: f64,
    squares: f64,
    count: usize,
    undetermined: usize,
}

fn main() -> Result<()> {
    let argument = |place| std::env::args().nth(place).and_then(|n| n.parse().ok());
    let drives: u64 = argument(1).unwrap_or(50);
    let first: u64 = argument(2).unwrap_or(0);
    let mut scenario = Scenario::demo();
    let scene = Scene::new(&scenario);
    let paths: Vec<Drive> = (0..scenario.drives.len())
        .map(|index| Drive::new(&scenario, &scene, index, 0.0))
        .collect();
    let mut sums = [[0.0; EPOCHS]; 3];
    let mut constants: BTreeMap<String, Errors> = BTreeMap::new();
    for seed in first..first + drives {
        let index = seed as usize % paths.len();
        scenario.seed = 100 + seed;
        scenario.prism.latency_s = 0.0;
        scenario.heading.mounting_offset_deg = 0.0;
        let (plain, truth) = twin(&scenario, &paths[index], index);
        let squares = squares_at_epochs(&plain.try_estimate()?, &truth)
            .ok_or_else(|| Error::data("a covariance is not positive", "report this"))?;
        for (epoch, squares) in squares.into_iter().enumerate() {
            for (sum, square) in sums.iter_mut().zip(squares) {
                sum[epoch] += square / drives as f64;
            }
        }
        scenario.prism.latency_s = LATENCY_S;
        scenario.heading.mounting_offset_deg = OFFSET_DEG;
        let (mut disturbed, _) = twin(&scenario, &paths[index], index);
        disturbed.settings.estimate = vec![
            Constant::TimeOffset(0),
            Constant::LeverArm(0),
            Constant::HeadingOffset,
            Constant::Gravity,
            Constant::ImuNoiseScale,
        ];
        let found = disturbed.try_estimate()?;
        let arm = scenario.lever_arm_m();
        for constant in &found.solution.constants {
            let truth = match constant.name.as_str() {
                "prism.time_offset" => -LATENCY_S,
                "prism.lever_arm.x" => arm.x,
                "prism.lever_arm.y" => arm.y,
                "prism.lever_arm.z" => arm.z,
                "heading.mounting_offset" => OFFSET_DEG.to_radians(),
                "frame.gravity" => scenario.gravity_m_s2,
                _ => 1.0,
            };
            let entry = constants.entry(constant.name.clone()).or_default();
            match constant.sigma {
                Some(sigma) => {
                    let error = (constant.value - truth) / sigma;
                    entry.sum += error;
                    entry.squares += error * error;
                    entry.count += 1;
                }
                None => entry.undetermined += 1,
            }
        }
    }
    for ((name, degrees), means) in [("position", 3.0), ("tilt", 2.0), ("yaw", 1.0)]
        .iter()
        .zip(&sums)
    {
        let [low, high] = band(*degrees, drives as f64, 1.96);
        let inside = means.iter().filter(|m| (low..=high).contains(*m)).count();
        let grand = means.iter().sum::<f64>() / EPOCHS as f64;
        println!(
            "{name}: mean {grand:.3} of {degrees}, {inside} of {EPOCHS} epochs within {low:.2} to \
             {high:.2}: {means:.2?}"
        );
    }
    for (name, errors) in constants {
        let n = errors.count.max(1) as f64;
        let [low, high] = band(1.0, n, 1.96);
        println!(
            "{name}: mean square {:.3}, band {low:.2} to {high:.2}, mean {:+.2} ± {:.2}, {} \
             determined, {} not",
            errors.squares / n,
            errors.sum / n,
            n.sqrt().recip(),
            errors.count,
            errors.undetermined
        );
    }
    Ok(())
}
