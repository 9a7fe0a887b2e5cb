//! The robot: its size and motion, its scanners, and how rigid its frame is.

use std::f64::consts::TAU;

use super::super::scenario::Scenario;
use super::super::sensors::{DeformationSettings, ScannerKind, ScannerSettings};
use super::draws::Draws;
use super::extent::Extent;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{EulerConvention, Mat3, Rotation, Vec3, so3};

/// Fastest speed over the ground, m/s.
const FASTEST_M_S: f64 = 5.0;

/// Lateral acceleration in turns, at most, m/s².
const LATERAL_M_S2: f64 = 1.5;

/// Rate of turn, at most, rad/s.
const TURN_RAD_S: f64 = 1.0;

/// Standard deviations of the initial mountings: a tape measure and a drawing, metres and degrees.
const INITIAL_SIGMAS: (f64, f64) = (0.02, 1.5);

/// Distance between profiles at the speed of the scan, at most, relative to the distance from the ground.
const APART: f64 = 0.04;

/// Shortest range of a profile scanner, relative to its distance from the ground.
const NEAREST: f64 = 0.3;

/// Spread of the heights of the scanners above the ground, as a share.
const SPREAD: f64 = 0.1;

/// Draws size and motion of the robot; returns the height of the scanners above the ground, metres.
pub(super) fn body(draws: &mut Draws, extent: &Extent, scenario: &mut Scenario) -> f64 {
    let motion = &mut scenario.motion;
    motion.imu_height_m = draws.log_uniform((0.6, 3.0));
    let standoff_m = motion.imu_height_m * draws.uniform((0.4, 1.0));
    motion.transit_speed_m_s = draws.log_uniform((extent.slowest_m_s, FASTEST_M_S));
    motion.scan_speed_m_s =
        (motion.transit_speed_m_s * draws.uniform((0.4, 1.0))).max(extent.slowest_m_s);
    motion.rest_s = draws.log_uniform((2.0, 30.0));
    let tightest_m = motion.transit_speed_m_s.powi(2) / LATERAL_M_S2;
    let slowest_m = motion.transit_speed_m_s / TURN_RAD_S;
    // Down to turns on the spot.
    motion.turn_radius_m = draws
        .log_uniform((0.05, 3.0))
        .max(tightest_m)
        .max(slowest_m);
    motion.wheelbase_track_m = [0, 1].map(|_| motion.imu_height_m * draws.uniform((0.6, 1.2)));
    motion.wheel_wavelength_m = draws.uniform((0.15, 0.6));
    motion.suspension_hz = draws.uniform((0.8, 4.0));
    motion.suspension_damping = draws.uniform((0.2, 0.7));
    standoff_m
}

/// Draws the scanners and what they measure.
pub(super) fn scanners(draws: &mut Draws, standoff_m: f64, scenario: &mut Scenario) {
    let count = match draws.uniform((0.0, 1.0)) {
        x if x < 0.25 => 1,
        x if x < 0.7 => 2,
        x if x < 0.85 => 3,
        _ => 4,
    };
    let with_lidar = draws.chance(0.2);
    let lowest_m = scenario.motion.imu_height_m;
    scenario.scanners = (0..count)
        .map(|index| {
            let is_lidar = with_lidar && index + 1 == count;
            let up_m = standoff_m * draws.uniform((1.0 - SPREAD, 1.0 + SPREAD));
            let side = if index % 2 == 0 { -1.0 } else { 1.0 };
            let translation_m = [
                standoff_m * draws.uniform((-0.3, 0.8)),
                side * standoff_m * draws.uniform((0.05, 0.5)),
                lowest_m - up_m,
            ];
            let rotation = if is_lidar {
                lidar_rotation(draws)
            } else {
                fan_rotation(draws, side)
            };
            scanner(draws, index, is_lidar, translation_m, rotation)
        })
        .collect();
    profiles(draws, standoff_m, scenario);
    let lidar = &mut scenario.lidar;
    lidar.rate_hz = draws.pick(&[5.0, 10.0, 20.0]);
    lidar.rings = draws.pick(&[1.0, 8.0, 16.0]) as usize;
    lidar.columns = draws.count(90, 360);
    lidar.range_m = [0.3, 12.0 * standoff_m];
    lidar.sigma_m = draws.log_uniform((0.002, 0.02));
    lidar.dropout = draws.uniform((0.0, 0.2));
}

/// A scanner with its true and initial mounting, in FRD.
fn scanner(
    draws: &mut Draws,
    index: usize,
    is_lidar: bool,
    translation_m: [f64; 3],
    rotation: Rotation,
) -> ScannerSettings {
    let (shift_m, turn_deg) = INITIAL_SIGMAS;
    let shift_m = draws.normals(shift_m);
    let turn = Vec3::from(draws.normals(turn_deg.to_radians()));
    let angles = |rotation: &Rotation| euler_deg_from_rotation(EulerConvention::Bonn, rotation);
    ScannerSettings {
        name: format!("scanner-{}", index + 1),
        kind: if is_lidar {
            ScannerKind::Lidar
        } else {
            ScannerKind::Profile
        },
        translation_m,
        rotation_deg: angles(&rotation),
        initial_translation_m: std::array::from_fn(|k| translation_m[k] + shift_m[k]),
        initial_rotation_deg: angles(&(rotation * so3::exp(&turn))),
        latency_s: 0.0,
        range_offset_m: 0.0,
    }
}

/// A fan that looks down and somewhat to the other side and ahead: across, along or oblique to the drive, and with its
/// first ray on either side.
fn fan_rotation(draws: &mut Draws, side: f64) -> Rotation {
    let inwards = -side * draws.uniform((-10.0, 40.0)).to_radians().tan();
    let ahead = draws.uniform((-20.0, 25.0)).to_radians().tan();
    let view = Vec3::new(ahead, inwards, 1.0).normalize();
    let azimuth_deg = match draws.uniform((0.0, 1.0)) {
        x if x < 0.6 => 90.0 + draws.uniform((-8.0, 8.0)),
        x if x < 0.75 => draws.uniform((-8.0, 8.0)),
        _ => draws.uniform((0.0, 180.0)),
    };
    let upside_down = if draws.chance(0.4) { 180.0 } else { 0.0 };
    let (sin, cos) = f64::to_radians(azimuth_deg + upside_down).sin_cos();
    let level = Vec3::new(cos, sin, 0.0);
    let x = (level - view * view.dot(&level)).normalize();
    let z = -view;
    Rotation::from_matrix(&Mat3::from_columns(&[x, z.cross(&x), z]))
}

/// A spinning lidar whose axis leans in any direction.
fn lidar_rotation(draws: &mut Draws) -> Rotation {
    let lean = draws.uniform((10.0, 70.0)).to_radians();
    let [azimuth, spin] = [0, 1].map(|_| draws.uniform((0.0, TAU)));
    let axis = Vec3::new(azimuth.cos(), azimuth.sin(), 0.0);
    let upright = so3::exp(&(Vec3::x() * std::f64::consts::PI));
    so3::exp(&(axis * lean)) * upright * so3::exp(&(Vec3::z() * spin))
}

/// The slowest rate at which profiles are near enough to each other at the speed of the scan.
pub(super) fn slowest_profiles_hz(scenario: &Scenario) -> f64 {
    let standoff_m = scenario.profiles.range_m[0] / NEAREST;
    scenario.motion.scan_speed_m_s / (APART * standoff_m)
}

/// Draws the settings of all profile scanners.
fn profiles(draws: &mut Draws, standoff_m: f64, scenario: &mut Scenario) {
    scenario.profiles.range_m = [NEAREST * standoff_m, 2.2 * standoff_m];
    let slowest_hz = slowest_profiles_hz(scenario);
    let profiles = &mut scenario.profiles;
    profiles.rate_hz = draws.log_uniform((20.0, 200.0)).max(slowest_hz).min(500.0);
    profiles.width = draws.log_uniform((60.0, 1920.0)) as usize;
    profiles.fan_deg = draws.uniform((30.0, 90.0));
    let near_m = draws.log_uniform((2e-5, 3e-3));
    profiles.sigma_m = [near_m, near_m * draws.uniform((1.0, 2.0))];
    // A step above the noise would be an error of its own.
    profiles.step_m = draws.pick(&[0.0, 1e-5, 0.5 * near_m]);
    profiles.dropout = draws.uniform((0.0, 0.6)).powi(2);
    profiles.grazing_deg = draws.uniform((65.0, 85.0));
}

/// Draws whether the frame bends, warms up, moves or jumps.
pub(super) fn frame(draws: &mut Draws, scenario: &mut Scenario) {
    let kind = draws.uniform((0.0, 1.0));
    let bend = &mut scenario.deformation;
    let share = draws.log_uniform((0.05, 0.5));
    let walk_m = draws.log_uniform((2e-4, 2e-3));
    let still = DeformationSettings {
        enabled: true,
        rotation_deg_per_deg: 0.0,
        shift_m_per_deg: 0.0,
        shift_m_per_m_s2: 0.0,
        drift_deg: 0.0,
        drift_m: 0.0,
        ..bend.clone()
    };
    if kind < 0.6 {
        return;
    }
    let compliant = DeformationSettings {
        rotation_deg_per_deg: share * bend.rotation_deg_per_deg,
        shift_m_per_deg: share * bend.shift_m_per_deg,
        shift_m_per_m_s2: share * bend.shift_m_per_m_s2,
        ..still.clone()
    };
    *bend = if kind < 0.75 {
        compliant
    } else if kind < 0.85 {
        DeformationSettings {
            walk_m,
            // A frame of about a metre.
            walk_deg: walk_m.to_degrees(),
            walk_correlation_s: draws.log_uniform((3.0, 60.0)),
            walk_together: draws.chance(0.5),
            ..still
        }
    } else if kind < 0.95 {
        DeformationSettings {
            drift_m: walk_m,
            drift_deg: walk_m.to_degrees(),
            ..compliant
        }
    } else {
        DeformationSettings {
            jump_m: draws.log_uniform((1e-3, 1e-2)),
            ..still
        }
    };
}
