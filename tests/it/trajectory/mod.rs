//! The trajectory stage on simulated drives with ground truth and on a recorded flight with a reference.

mod constants;
mod doubts;
mod faults;
mod faulty;
mod logs_as_they_come;
mod nees;
mod online;
mod online_cli;
mod pose_case;
mod pose_case_faults;
mod recorded_flight;
mod rover;
mod steps;
mod units;

use crate::common::consistency::{Logs, Truth, rms, twin};
use boresight::geometry::{Rotation, Vec3};
use boresight::progress::Silent;
use boresight::simulation::{Drive, Scenario, Scene};
use boresight::trajectory::{Tested, Trajectory, estimate_tested};
use nalgebra::Quaternion;

fn vec3(row: &[f64], first: usize) -> Vec3 {
    Vec3::new(row[first], row[first + 1], row[first + 2])
}

/// The logs of the demo's first drive with this seed and a change, and the true pose at each sample of the IMU.
fn drawn(seed: u64, change: impl Fn(&mut Scenario)) -> (Logs, Vec<Truth>) {
    let mut scenario = Scenario::demo();
    scenario.seed = seed;
    change(&mut scenario);
    let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
    twin(&scenario, &drive, 0)
}

fn tested(logs: &Logs) -> Tested {
    let tested = estimate_tested(&logs.motion(), &logs.settings, true, &Silent);
    tested.expect("an estimate")
}

/// Quaternion in the order w, x, y, z.
fn quaternion(row: &[f64], w: usize) -> Rotation {
    Rotation::from_quaternion(Quaternion::new(row[w], row[w + 1], row[w + 2], row[w + 3]))
}

fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

/// Largest differences in position (m) and attitude (rad) between poses at the same times.
fn difference(a: &Trajectory, b: &Trajectory) -> (f64, f64) {
    let mut largest = (0.0f64, 0.0f64);
    for (a, b) in a.poses().iter().zip(b.poses()) {
        assert!(
            (a.time_s - b.time_s).abs() < 1e-6,
            "{} {}",
            a.time_s,
            b.time_s
        );
        let (pa, pb) = (a.world_from_body, b.world_from_body);
        let apart_m = (pa.translation_m - pb.translation_m).norm();
        largest.0 = largest.0.max(apart_m);
        largest.1 = largest.1.max(pa.rotation.angle_to(&pb.rotation));
    }
    largest
}

/// Largest relative difference between the standard deviations of poses at the same times.
fn difference_of_sigmas(a: &Trajectory, b: &Trajectory) -> f64 {
    let nodes = a.poses().iter().zip(b.poses());
    nodes
        .map(|(a, b)| {
            let (a, b) = (a.sigma.expect("sigma"), b.sigma.expect("sigma"));
            let position = a.position_m.component_div(&b.position_m).add_scalar(-1.0);
            let rotation = a.rotation_rad.component_div(&b.rotation_rad);
            position.amax().max(rotation.add_scalar(-1.0).amax())
        })
        .fold(0.0, f64::max)
}
