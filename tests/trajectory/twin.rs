//! Drives of the simulated robot over its field, with truth at the nodes.

use super::Logs;
use super::consistency::settings_of;
use boresight::geometry::{Rotation, Vec3};
use boresight::simulation::{Drive, Scenario, simulate_heading, simulate_imu, simulate_prism};

/// The logs of a drive with settings that know its sensors, and the true poses.
pub fn twin(scenario: &Scenario, drive: &Drive, index: usize) -> (Logs, Vec<(Vec3, Rotation)>) {
    let imu = simulate_imu(scenario, drive, index);
    let truth = imu.truth.iter().map(|record| {
        let pose = record.world_from_body;
        (pose.translation_m, pose.rotation)
    });
    let truth = truth.collect();
    let logs = Logs {
        imu: imu.samples,
        prism: simulate_prism(scenario, drive, index),
        heading: simulate_heading(scenario, drive, index),
        settings: settings_of(scenario),
    };
    (logs, truth)
}
