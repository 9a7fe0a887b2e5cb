//! Basin of convergence: from which distances the calibration ends at the same minimum, and whether it reports
//! when it does not.
//!
//! `cargo run --release --features examples --example basin -- 100` starts a hundred times at each of three distances from the
//! result, in random directions, on a small simulated drive with and without its reference, and on the Truck. A
//! second argument selects the drives whose names contain it.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use boresight::Result;
use boresight::calibration::{Calibration, ScannerSample};
use boresight::geometry::{BodyFromScanner, Vec3, so3};
use boresight::judgement;
use boresight::pipeline::stages::{self, EstimatedPoses};
use boresight::pipeline::{OpenProject, Rig, start};
use boresight::progress::Silent;
use boresight::project::Project;
use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[allow(dead_code)]
#[path = "../tests/common/small_field.rs"]
mod field;
#[path = "../tests/common/moving.rs"]
mod moving;
#[path = "../tests/common/truck.rs"]
mod truck;

/// Distances of the starts: metres, degrees.
const STARTS: [(f64, f64); 3] = [(0.05, 2.0), (0.1, 5.0), (0.2, 10.0)];
/// Tolerances of the same minimum: metres, degrees. A scale ends when steps move points by less.
const SAME: (f64, f64) = (0.005, 0.1);

/// A drive that is ready to be calibrated.
struct Drive {
    name: &'static str,
    project: OpenProject,
    rig: Rig,
    poses: EstimatedPoses,
    samples: Vec<ScannerSample>,
    reference: Vec<Vec3>,
}

impl Drive {
    fn read(name: &'static str, project: Project) -> Result<Self> {
        let project = OpenProject::new(&project);
        let poses = stages::poses(&project, &Silent)?;
        let rig = Rig::new(&project);
        Ok(Self {
            name,
            samples: stages::samples(&project, &rig, poses.trajectory(), &Silent)?,
            reference: stages::reference(&project, &Silent)?,
            poses,
            rig,
            project,
        })
    }

    /// The calibration from these mountings, and the codes of its warnings.
    fn from(&self, start: &[BodyFromScanner]) -> Result<(Calibration, Vec<String>)> {
        let (project, rig) = (&self.project, self.rig.with_poses(start));
        let (trajectory, samples) = (self.poses.trajectory(), self.samples.as_slice());
        let start = start::start(project, &rig, trajectory, samples, &self.reference, &Silent);
        let found = stages::calibration(
            project,
            &start.rig.mountings,
            &start.rig.settings(project),
            &self.poses,
            samples,
            &self.reference,
            &Silent,
        )?;
        let marked = judgement::first_placement(&start.first)
            .into_iter()
            .filter(|v| v.severity.is_marked());
        let mut said: Vec<String> = marked.map(|v| v.code).collect();
        let other = found
            .minimum
            .as_ref()
            .and_then(|minimum| minimum.alternative.as_ref());
        said.extend(other.map(|_| "calibration.minimum".into()));
        said.extend((!found.converged).then(|| "calibration.convergence".into()));
        Ok((found, said))
    }

    fn basin(&self, starts: usize) -> Result<()> {
        let (calibration, said) = self.from(&self.rig.poses())?;
        println!("{}: from the project's start {said:?}", self.name);
        let result = calibration.poses();
        let held = calibration.observability.unobservable.iter();
        let held: Vec<DVector<f64>> = held.map(|held| held.direction.clone()).collect();
        let fixed = self.project.scanners.iter().map(|s| s.fixed[0]);
        let fixed: Vec<bool> = fixed.collect();
        for (shift_m, turn_deg) in STARTS {
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let (mut same, mut said_so, mut quiet) = (0, 0, 0);
            for number in 0..starts {
                let poses = result.iter().zip(&fixed).map(|(pose, is_fixed)| {
                    let shift = direction(&mut random) * if *is_fixed { 0.0 } else { shift_m };
                    let turn = so3::exp(&(direction(&mut random) * turn_deg.to_radians()));
                    BodyFromScanner::new(turn * pose.rotation, pose.translation_m + shift)
                });
                let (found, said) = self.from(&poses.collect::<Vec<_>>())?;
                let off = apart(&found.poses(), &result, &held);
                if off.0 < SAME.0 && off.1 < SAME.1 {
                    same += 1;
                    continue;
                }
                if said.is_empty() {
                    quiet += 1
                } else {
                    said_so += 1
                }
                println!("  {number}: {:.3} m, {:.2}° off, {said:?}", off.0, off.1);
            }
            println!(
                "{}: {same} of {starts} from {shift_m} m and {turn_deg}° end at the same minimum, {said_so} \
                 others say so, {quiet} do not",
                self.name
            );
        }
        Ok(())
    }
}

/// The largest distances of two results in metres and degrees, without directions that are unobservable.
fn apart(
    found: &[BodyFromScanner],
    result: &[BodyFromScanner],
    held: &[DVector<f64>],
) -> (f64, f64) {
    let change = found.iter().zip(result).flat_map(|(a, b)| {
        let (turn, shift) = a.perturbation_from(b);
        [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
    });
    let mut change = DVector::from_vec(change.collect());
    for direction in held {
        change -= direction * (direction.dot(&change) / direction.norm_squared());
    }
    let scanners = change.as_slice().chunks(6);
    scanners.fold((0.0, 0.0), |worst: (f64, f64), scanner| {
        let length = |part: &[f64]| Vec3::from_column_slice(part).norm();
        let (shift_m, turn) = (length(&scanner[..3]), length(&scanner[3..]));
        (worst.0.max(shift_m), worst.1.max(turn.to_degrees()))
    })
}

/// A random unit vector, uniform over the sphere.
fn direction(random: &mut ChaCha8Rng) -> Vec3 {
    loop {
        let vector = Vec3::from_fn(|_, _| random.random_range(-1.0..1.0));
        if (0.1..1.0).contains(&vector.norm()) {
            return vector.normalize();
        }
    }
}

fn main() -> Result<()> {
    let starts = std::env::args().nth(1).and_then(|n| n.parse().ok());
    let starts = starts.unwrap_or(100);
    let wanted = std::env::args().nth(2).unwrap_or_default();
    let folder = std::env::temp_dir().join("boresight-basin");
    let field = field::Field::new(&folder, 1, |_| ());
    let project = Project::read(&field.folder.join("project.toml"))?;
    let twin = Drive::read("twin", project)?;
    let known = Vec3::from(truck::KNOWN_DEG);
    let truck = Drive::read("Truck", truck::project(known, Path::new(&folder)))?;
    let mut alone = Drive::read("twin without its reference", twin.project.clone())?;
    alone.reference.clear();
    for drive in [twin, truck, alone] {
        if drive.name.contains(&wanted) {
            drive.basin(starts)?;
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
    Ok(())
}
