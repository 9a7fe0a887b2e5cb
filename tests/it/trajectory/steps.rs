//! Positions that step and stay, found from the logs of simulated drives.

use super::{drawn, tested};
use crate::common::consistency::{Logs, Truth, error};
use boresight::geometry::Vec3;
use boresight::simulation::Scenario;
use boresight::trajectory::Tested;

/// The logs of six passes, and the true pose at each sample of the IMU.
fn drive(seed: u64, change: impl Fn(&mut Scenario)) -> (Logs, Vec<Truth>) {
    drawn(seed, |scenario| {
        scenario.drives[0].passes.truncate(6);
        change(scenario);
    })
}

/// Moves the positions from one share of the drive to another.
fn shift(logs: &mut Logs, from: f64, to: f64, by_m: Vec3) {
    let count = logs.prism.len() as f64;
    let range = (from * count) as usize..(to * count) as usize;
    logs.prism[range]
        .iter_mut()
        .for_each(|fix| fix.position_m += by_m);
}

/// Largest error of a position, metres.
fn worst_m(logs: &Logs, truth: &[Truth], tested: &Tested) -> f64 {
    let errors = logs.imu.iter().zip(truth).filter_map(|(sample, truth)| {
        let pose = tested.estimate.trajectory.pose_at(sample.time_s)?;
        Some(error(&pose, truth).0.norm())
    });
    errors.fold(0.0, f64::max)
}

fn gnss(scenario: &mut Scenario) {
    scenario.prism.sigma_m = 0.015;
}

fn lasting_gnss(scenario: &mut Scenario) {
    gnss(scenario);
    scenario.prism.sigma_correlated_m = 0.01;
}

/// Positions that are off from one share of a drive to another.
struct Fault {
    what: &'static str,
    from: f64,
    to: f64,
    by_m: Vec3,
}

fn prism(_: &mut Scenario) {}

const fn fault(what: &'static str, [from, to]: [f64; 2], [east, north, up]: [f64; 3]) -> Fault {
    Fault {
        what,
        from,
        to,
        by_m: Vec3::new(east, north, up),
    }
}

/// A bumped tripod and a block with a wrong fix.
#[test]
fn a_step_and_a_block_are_found_and_corrected() {
    assert_found(
        prism,
        [
            fault("prism, 3 cm", [0.5, 1.0], [0.02, -0.02, 0.01]),
            fault("block, 5 cm", [0.45, 0.55], [0.03, 0.03, 0.02]),
        ],
    );
}

/// A base that was changed, with errors as large as those of GNSS.
#[test]
#[ignore = "just acceptance"]
fn steps_of_an_antenna_are_found_and_corrected() {
    assert_found(
        gnss,
        [
            fault("GNSS, 8 cm", [0.4, 1.0], [0.05, 0.06, -0.02]),
            fault("GNSS, 30 cm", [0.6, 1.0], [-0.2, 0.1, 0.2]),
        ],
    );
}

fn assert_found(change: fn(&mut Scenario), faults: [Fault; 2]) {
    let (clean, truth) = drive(91, change);
    let clean_m = worst_m(&clean, &truth, &tested(&clean));
    for fault in faults {
        let (what, by_m) = (fault.what, fault.by_m);
        let mut logs = clean.clone();
        shift(&mut logs, fault.from, fault.to, by_m);
        let first = (fault.from * logs.prism.len() as f64) as usize;
        let tested = tested(&logs);
        let worst_m = worst_m(&logs, &truth, &tested);
        println!(
            "{what}: {worst_m:.4} m, clean {clean_m:.4} m, {:?}",
            tested.steps
        );
        let is_block = fault.to < 1.0;
        assert_eq!(tested.steps.len(), 1 + usize::from(is_block), "{what}");
        let mut in_order: Vec<_> = tested.steps.iter().collect();
        in_order.sort_by_key(|step| step.record);
        assert!(in_order[0].record.abs_diff(first + 1) <= 1, "{what}");
        for axis in 0..3 {
            let miss_m = in_order[0].step_m[axis] - by_m[axis];
            assert!(
                miss_m.abs() < 4.0 * in_order[0].sigma_m[axis],
                "{what}: {miss_m}"
            );
        }
        assert!(tested.doubts.is_empty(), "{what}: {:?}", tested.doubts);
        // Beyond the error of a clean drive there is that of the step.
        assert!(
            worst_m < clean_m + 4.0 * in_order[0].sigma_m.amax(),
            "{what}"
        );
    }
}

#[test]
fn a_clean_drive_has_no_steps() {
    assert_no_steps(1..2);
}

#[test]
#[ignore = "just acceptance"]
fn clean_drives_have_no_steps() {
    assert_no_steps(2..13);
}

fn assert_no_steps(seeds: std::ops::Range<u64>) {
    for seed in seeds {
        for change in [prism, gnss, lasting_gnss] {
            let (logs, _) = drive(seed, change);
            let steps = tested(&logs).steps;
            assert!(steps.is_empty(), "seed {seed}: {steps:?}");
        }
    }
}
