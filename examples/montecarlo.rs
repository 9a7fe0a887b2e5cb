//! Simulates drives with different seeds, calibrates them and compares the errors with the sigmas.
//!
//! `cargo run --release --features examples --example montecarlo -- 20` prints one line per seed and kind of run, then
//! the share of errors inside the 95 % bounds.

use std::path::Path;

use boresight::Result;
use boresight::calibration::Calibration;
use boresight::geometry::{EulerConvention, Vec3};
use boresight::pipeline::stages::EstimatedPoses;
use boresight::simulation::Scenario;

#[path = "../tests/common/consistency.rs"]
mod consistency;
#[path = "../tests/common/demo_drive.rs"]
mod demo_drive;
use consistency::{PoseErrors, rms};
use demo_drive::{DemoDrive, calibrate};

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let seeds: u64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(10);
    let first: u64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(1);
    let mut inside = [(0, 0); 3];
    for seed in first..first + seeds {
        let folder = std::env::temp_dir().join(format!("boresight-montecarlo-{seed}"));
        for (total, (covered, all)) in inside.iter_mut().zip(run(seed, &folder)?) {
            total.0 += covered;
            total.1 += all;
        }
        println!("running totals inside 95 %: {inside:?}");
        let _ = std::fs::remove_dir_all(&folder);
    }
    Ok(())
}

/// Calibrates with estimated poses, without the reference, and with exact poses. Returns for each the number
/// of errors inside 95 % and the number of all errors.
fn run(seed: u64, folder: &Path) -> Result<[(usize, usize); 3]> {
    let scenario = Scenario {
        seed,
        ..Scenario::demo()
    };
    let drive = DemoDrive::simulate(scenario, folder)?;
    print_pose_errors(&drive.estimated, &drive.exact);
    let settings = &drive.project.calibration;
    let runs = [
        ("estimated poses", &drive.estimated, &drive.reference[..]),
        ("no reference", &drive.estimated, &[]),
        ("exact poses", &drive.exact, &drive.reference),
    ];
    let mut inside = [(0, 0); 3];
    for (inside, (name, poses, reference)) in inside.iter_mut().zip(runs) {
        let found = calibrate(&drive.project, settings, poses, reference)?;
        *inside = print_errors(&format!("seed {seed} {name}"), &drive, &found);
    }
    Ok(inside)
}

/// Prints the root mean square errors of the poses, absolute and normalised.
fn print_pose_errors(poses: &EstimatedPoses, exact: &EstimatedPoses) {
    let mut errors = PoseErrors::default();
    for node in poses.trajectory().poses() {
        if let Some(truth) = exact.trajectory().pose_at(node.time_s) {
            errors.add(node, &(truth.translation_m, truth.rotation));
        }
    }
    let shown: Vec<String> = (0..6)
        .map(|i| {
            let of_axis = |all: &[Vec3]| rms(all.iter().map(|error| error[i % 3]));
            let error = match i {
                0..3 => of_axis(&errors.shift) * 1e3,
                _ => of_axis(&errors.turn).to_degrees(),
            };
            format!("{error:.4} ({:.2} sigma)", errors.normalised()[i])
        })
        .collect();
    println!(
        "pose errors, mm east north up, degrees about them: {}",
        shown.join(", ")
    );
}

/// Prints errors and sigmas of one calibration. Returns the number of errors inside 95 % and the number of all
/// errors.
fn print_errors(name: &str, drive: &DemoDrive, calibration: &Calibration) -> (usize, usize) {
    let (mut covered, mut all) = (0, 0);
    for (scanner, mounting) in calibration.mountings.iter().enumerate() {
        let sigmas = calibration.sigmas(scanner, EulerConvention::Bonn);
        let errors = drive.errors(calibration, scanner);
        let mut line = format!("{name} {}:", mounting.name);
        for parameter in 0..6 {
            let (error, unit) = match parameter {
                0..3 => (errors[parameter] * 1e3, 1e3),
                _ => (errors[parameter], 1f64.to_degrees()),
            };
            match sigmas[parameter] {
                Some(sigma) => {
                    let sigma = sigma * unit;
                    line.push_str(&format!(" {error:.3}±{sigma:.3}"));
                    all += 1;
                    covered += usize::from(error.abs() < 1.96 * sigma);
                }
                None => line.push_str(&format!(" {error:.3} held")),
            }
        }
        println!("{line}");
    }
    let iterations: Vec<usize> = calibration
        .scales
        .iter()
        .map(|scale| scale.iterations)
        .collect();
    let seconds: f64 = calibration.scales.iter().map(|scale| scale.seconds).sum();
    let smallest = calibration
        .observability
        .shares
        .first()
        .copied()
        .unwrap_or(f64::NAN);
    let constancy = calibration.constancy.as_ref().map(|c| c.ratio);
    println!(
        "  iterations {iterations:?}, {seconds:.1} s, smallest eigenvalue share {smallest:.1e}, residuals {constancy:?} times expected"
    );
    (covered, all)
}
