//! Simulates drives with different seeds, adjusts each in one piece and in two steps, and compares
//! both with the truth.
//!
//! `cargo run --release --example joint -- 30 1`

use std::path::Path;
use std::time::Instant;

use boresight::Result;
use boresight::joint::{ChainMotion, JointDrive, JointInput, JointSettings, Scans, adjust};
use boresight::pipeline::stages;
use boresight::progress::Silent;
use boresight::simulation::Scenario;

#[path = "../tests/common/demo_drive.rs"]
mod demo_drive;
use demo_drive::DemoDrive;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let seeds: u64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(1);
    let first: u64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(1);
    let surfel_m: f64 = args.next().and_then(|n| n.parse().ok()).unwrap_or(0.05);
    for seed in first..first + seeds {
        let folder = std::env::temp_dir().join(format!("boresight-joint-{seed}"));
        run(seed, &folder, surfel_m)?;
        let _ = std::fs::remove_dir_all(&folder);
    }
    Ok(())
}

fn run(seed: u64, folder: &Path, surfel_m: f64) -> Result<()> {
    let scenario = Scenario {
        seed,
        ..Scenario::demo()
    };
    let mut scenario = scenario;
    if std::env::var("SMOOTH").is_ok() {
        scenario.soil.sigmas_m = vec![0.016, 0.008, 0.004, 0.001, 0.0002, 0.0, 0.0];
    }
    let drive = DemoDrive::simulate(scenario, folder)?;
    let project = &drive.project;
    let samples = stages::samples(project, &drive.own.trajectory, &Silent)?;
    let begun = Instant::now();
    let two = if std::env::var("START").is_ok() {
        let mut found = stages::mountings(project);
        for (mounting, truth) in found.iter_mut().zip(&drive.truth) {
            let off = boresight::geometry::Vec3::new(0.001, -0.0005, 0.0003);
            mounting.body_from_scanner = truth.perturbed(&off, &(off * 1.5));
        }
        found
    } else {
        stages::calibration(
            project,
            &project.calibration,
            &drive.own,
            &samples,
            &drive.reference,
            &Silent,
        )?
        .mountings
    };
    println!("two steps {:.1} s", begun.elapsed().as_secs_f64());
    for sensor in &drive.own.solution.as_ref().unwrap().sensors {
        println!("alone {} {:?}", sensor.name, sensor.variance_component);
    }
    let begun = Instant::now();
    let mut settings = JointSettings::default();
    if std::env::var("SHIFT").is_err() {
        settings.reference.shift_m = 0.0;
        settings.reference.tilt_rad = 0.0;
    }
    let known: &[_] = if std::env::var("NOREF").is_ok() {
        &[]
    } else {
        &drive.reference
    };
    let posterior = drive.own.covariance.as_ref().unwrap();
    let input = JointInput {
        mountings: two.clone(),
        known: None,
        estimate_latency: vec![false; 2],
        drives: vec![JointDrive {
            name: "drive".into(),
            motion: Box::new(ChainMotion::new(posterior, vec!["prism".into()], &[])),
            scans: Scans {
                samples: samples.iter().collect(),
            },
        }],
        reference: known,
    };
    let joint = adjust(&input, &settings, surfel_m, &Silent)?;
    println!(
        "reference {:?} {:?} {:?}",
        joint.reference, joint.view, joint.regions
    );
    println!(
        "contradictions {:?} {:?}",
        boresight::joint::contradictions(&joint),
        joint.drives[0].positions
    );
    println!(
        "joint {:.1} s, {} iterations, {} rows, {} surfels, {} unknowns, {}",
        begun.elapsed().as_secs_f64(),
        joint.iterations,
        joint.rows,
        joint.surfels,
        joint.unknowns,
        joint.stop
    );
    for group in &joint.groups {
        println!("  {group:?}");
    }
    for scanner in 0..2 {
        let truth = &drive.truth[scanner];
        for (name, mounting) in [("two", &two), ("joint", &joint.mountings)] {
            let (turn, shift) = mounting[scanner].body_from_scanner.perturbation_from(truth);
            let shift = shift * 1e3;
            let turn = turn.map(f64::to_degrees);
            println!(
                "{name:6} {:8.3} {:8.3} {:8.3} mm {:8.4} {:8.4} {:8.4} deg",
                shift.x, shift.y, shift.z, turn.x, turn.y, turn.z
            );
        }
        let s = |i: usize| joint.covariance[(6 * scanner + i, 6 * scanner + i)].sqrt();
        println!(
            "sigma  {:8.3} {:8.3} {:8.3} mm {:8.4} {:8.4} {:8.4} deg",
            s(0) * 1e3,
            s(1) * 1e3,
            s(2) * 1e3,
            s(3).to_degrees(),
            s(4).to_degrees(),
            s(5).to_degrees()
        );
    }
    let error = nalgebra::DVector::from_iterator(
        12,
        (0..2).flat_map(|i| {
            let (turn, shift) = joint.mountings[i]
                .body_from_scanner
                .perturbation_from(&drive.truth[i]);
            [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
        }),
    );
    let normalised: Vec<String> = (0..12)
        .map(|i| format!("{:.2}", error[i] / joint.covariance[(i, i)].sqrt()))
        .collect();
    let square = error.dot(&joint.covariance.clone().cholesky().unwrap().solve(&error));
    println!(
        "seed {seed} normalised {} chi-square {square:.1}",
        normalised.join(" ")
    );
    // The right scanner in the frame of the left: its error and covariance, in body axes.
    let arm = drive.truth[1].translation_m - drive.truth[0].translation_m;
    let mut relative = nalgebra::DMatrix::<f64>::zeros(6, 12);
    for i in 0..6 {
        relative[(i, i)] = -1.0;
        relative[(i, 6 + i)] = 1.0;
    }
    let turn = boresight::geometry::so3::hat(&arm);
    relative.view_mut((0, 3), (3, 3)).copy_from(&turn);
    let spread = nalgebra::SymmetricEigen::new({
        let d = nalgebra::DMatrix::from_fn(12, 12, |i, j| {
            let s = |k: usize| joint.covariance[(k, k)].sqrt();
            joint.covariance[(i, j)] / (s(i) * s(j))
        });
        d
    });
    for k in 0..12 {
        let v = spread.eigenvectors.column(k);
        let e: f64 = (0..12)
            .map(|i| v[i] * error[i] / joint.covariance[(i, i)].sqrt())
            .sum();
        let parts: Vec<String> = v.iter().map(|x| format!("{x:.2}")).collect();
        println!(
            "   eigen {:.2e} normalised {:.2}: {}",
            spread.eigenvalues[k],
            e / spread.eigenvalues[k].sqrt(),
            parts.join(" ")
        );
    }
    let error = &relative * error;
    let covariance = &relative * &joint.covariance * relative.transpose();
    let sigma = |i: usize| covariance[(i, i)].sqrt();
    println!(
        "relative {:.3} {:.3} {:.3} mm {:.4} {:.4} {:.4} deg, sigmas {:.1} {:.1} {:.1} {:.1} {:.1} {:.1}",
        error[0] * 1e3,
        error[1] * 1e3,
        error[2] * 1e3,
        error[3].to_degrees(),
        error[4].to_degrees(),
        error[5].to_degrees(),
        error[0] / sigma(0),
        error[1] / sigma(1),
        error[2] / sigma(2),
        error[3] / sigma(3),
        error[4] / sigma(4),
        error[5] / sigma(5)
    );
    let error = |poses: &boresight::trajectory::Trajectory| {
        let (mut sum, mut count) = (0.0, 0.0);
        for pose in poses.poses() {
            if let Some(truth) = drive.exact.trajectory.pose_at(pose.time_s) {
                sum += (pose.world_from_body.translation_m - truth.translation_m).norm_squared();
                count += 1.0;
            }
        }
        1e3 * (sum / count as f64).sqrt()
    };
    println!(
        "poses {:.2} -> {:.2} mm",
        error(&drive.own.trajectory),
        error(&joint.drives[0].trajectory)
    );
    Ok(())
}
