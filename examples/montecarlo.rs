//! Simulates drives with different seeds, calibrates them and compares the errors with the sigmas.
//!
//! `cargo run --release --example montecarlo -- 20` prints one line per seed and kind of run, then
//! the share of errors inside the 95 % bounds.

use std::path::Path;

use boresight::calibration::Calibration;
use boresight::geometry::{EulerConvention, so3};
use boresight::pipeline::stages::{self, Poses};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Scenario, simulate};
use boresight::trajectory::Trajectory;
use boresight::{Result, format};

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let seeds: u64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(10);
    let first: u64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(1);
    let mut inside = [(0, 0); 3];
    for seed in first..first + seeds {
        let folder = std::env::temp_dir().join(format!("boresight-montecarlo-{seed}"));
        for (kind, calibration) in run(seed, &folder)?.into_iter().enumerate() {
            let name = ["estimated poses", "no reference", "exact poses"][kind];
            let (covered, all) = print_errors(seed, name, &calibration);
            inside[kind].0 += covered;
            inside[kind].1 += all;
        }
        println!("running totals inside 95 %: {inside:?}");
        let _ = std::fs::remove_dir_all(&folder);
    }
    Ok(())
}

/// Calibrates with estimated poses, without the reference, and with exact poses.
fn run(seed: u64, folder: &Path) -> Result<[Calibration; 3]> {
    let mut scenario = Scenario {
        seed,
        ..Scenario::demo()
    };
    scenario.drives.truncate(1);
    let files = simulate(&scenario, folder, &Silent)?;
    let project = Project::read(&files.drives[0].project)?;
    let reference = stages::reference(&project, &Silent)?;
    let poses = stages::poses(&project, &Silent)?;
    let truth = format::read_trajectory(&files.drives[0].folder.join("truth/trajectory.csv"))?;
    let exact = Poses::from_file(Trajectory::new(truth)?);
    pose_errors(&poses, &exact);
    let calibrate = |poses: &Poses, reference: &[_]| {
        let samples = stages::samples(&project, &poses.trajectory, &Silent)?;
        stages::calibration(
            &project,
            &project.calibration,
            poses,
            &samples,
            reference,
            &Silent,
        )
    };
    Ok([
        calibrate(&poses, &reference)?,
        calibrate(&poses, &[])?,
        calibrate(&exact, &reference)?,
    ])
}

/// Prints the root mean square errors of the poses, absolute and normalised.
fn pose_errors(poses: &Poses, exact: &Poses) {
    let mut sums = [[0.0; 2]; 6];
    let nodes = poses.trajectory.nodes();
    for node in nodes {
        let (Some(truth), Some(sigma)) = (exact.trajectory.pose_at(node.time_s), node.sigma) else {
            continue;
        };
        let shift = node.world_from_body.translation_m - truth.translation_m;
        let turn = so3::log(&(node.world_from_body.rotation * truth.rotation.inverse()));
        for axis in 0..3 {
            for (row, error, sigma) in [
                (axis, shift[axis], sigma.position_m[axis]),
                (3 + axis, turn[axis], sigma.rotation_rad[axis]),
            ] {
                sums[row][0] += error * error;
                sums[row][1] += (error / sigma).powi(2);
            }
        }
    }
    let rms = |x: f64| (x / nodes.len() as f64).sqrt();
    let shown: Vec<String> = sums
        .iter()
        .enumerate()
        .map(|(row, [raw, normalised])| {
            let unit = if row < 3 {
                rms(*raw) * 1e3
            } else {
                rms(*raw).to_degrees()
            };
            format!("{unit:.4} ({:.2} sigma)", rms(*normalised))
        })
        .collect();
    println!(
        "pose errors, mm east north up, degrees about them: {}",
        shown.join(", ")
    );
}

/// Prints errors and sigmas of one calibration; returns how many errors are inside 95 %, and of how
/// many.
fn print_errors(seed: u64, name: &str, calibration: &Calibration) -> (usize, usize) {
    let convention = EulerConvention::Bonn;
    let truth = Scenario::demo().true_mountings();
    let (mut covered, mut all) = (0, 0);
    for (scanner, mounting) in calibration.mountings.iter().enumerate() {
        let sigmas = calibration.sigmas(scanner, convention);
        let found = &mounting.body_from_scanner;
        let shift = found.translation_m - truth[scanner].translation_m;
        let angles = |pose: &boresight::geometry::BodyFromScanner| {
            boresight::geometry::euler::euler_deg_from_rotation(convention, &pose.rotation)
        };
        let (a, b) = (angles(found), angles(&truth[scanner]));
        let mut line = format!("seed {seed} {name} {}:", mounting.name);
        for parameter in 0..6 {
            let (error, unit) = if parameter < 3 {
                (shift[parameter] * 1e3, 1e3)
            } else {
                (a[parameter - 3] - b[parameter - 3], 1f64.to_degrees())
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
