mod files;
mod joint;
mod keys;
mod mistakes;

use std::path::{Path, PathBuf};

use super::*;
use crate::calibration::{CalibrationSettings, Method};
use crate::comparison::ComparisonSettings;
use crate::geometry::euler::rotation_from_euler_deg;
use crate::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Vec3};
use crate::sensor::{Observations, VerticalAngle};
use crate::trajectory::{Constant, Loss, Nodes, PositionKind};

/// The example of the documentation.
const EXAMPLE: &str = r#"[frame]
body = "FRD"
origin_m = [0.0, 0.0, 0.0]
grid_convergence_deg = 0.0
gravity_m_s2 = 9.81

[imu]
file = "imu.csv"
gyro_noise_deg_sqrt_h = 0.15            # angle random walk
accel_noise_ug_sqrt_hz = 57.0           # velocity random walk
gyro_bias_instability_deg_h = 7.0
accel_bias_instability_ug = 14.0

[prism]
file = "prism.csv"
sigma_m = 0.005
lever_arm_m = [0.10, 0.05, -0.55]       # prism in the body frame

[heading]
file = "heading.csv"
sigma_deg = 0.7
mounting_offset_deg = 0.0

# [trajectory]                          # instead of the three above
# file = "trajectory.csv"

[[scanner]]
name = "left"
profiles = "left.bin"
translation_m = [1.2, -0.5, 0.5]
rotation_deg = [-145.0, 0.0, 90.0]      # or quaternion_xyzw = [...]
rotation_convention = "bonn"            # or "zyx"
# fixed = ["tx", "ty", "tz"]            # parameters held at their values: tx ty tz rx ry rz

[reference]                             # optional
file = "tls.laz"

[calibration]
voxel_sizes_m = [0.05, 0.04, 0.03, 0.02, 0.01, 0.005]
neighbours = 50

[[evaluation]]                          # optional: other drives, judged with the parameters found here
name = "drive-2"
project = "../drive-2/project.toml"
"#;

/// Keys that the example leaves out.
const UNUSUAL: &str = r#"
frame = { body = "FLU", origin_m = [363000.0, 5.6e6, 60.0], crs = "EPSG:25832", grid_convergence_deg = -1.237 }

[imu]
file = "/logs/imu.csv"
time_offset_s = -0.0125
gyro_noise_deg_sqrt_h = 0.017
gyro_bias_walk_rad_s_sqrt_s = 1.2345678901e-6
accel_bias_walk_m_s2_sqrt_s = 3e-5

[prism]
file = "prism.csv"
time_offset_s = 0.2
lever_arm_m = [0, 0, 1]

[[scanner]]
name = "left"
profiles = ["a.bin", "b.bin"]
translation_m = [1.2, -0.5, 0.5]
quaternion_xyzw = [0.1, 0.2, 0.3, 0.9273618495495703]
time_offset_s = 0.001
fixed = ["tz", "tx"]

[[scanner]]
name = "right"
profiles = "r.bin"
translation_m = [1.259, 0.656, 0.585]
rotation_deg = [144.396, -0.346, 91.705]

[calibration]
voxel_sizes_m = [0.3, 0.1]
neighbours = 20
method = "paper"
max_iterations = 450
pass_gap_s = 10

[comparison]
core_spacing_m = 0.1
normal_radii_m = [0.1, 0.2]
cylinder_radius_m = 0.05
max_distance_m = 0.5
registration_error_m = 0.001

[report]
title = "Campaign of May"
author = "A. Surveyor"
organisation = "Institute of Geodesy"
logo = "logo.png"
"#;

const POSES: &str = r#"
[trajectory]
file = "trajectory.csv"
sigma_position_m = 0.0016
sigma_rotation_deg = 0.03
"#;

/// Several total stations and antennas, and all constants that can be estimated.
const SEVERAL: &str = r#"
[frame]
origin_m = [363000.0, 5.6e6, 60.0]

[imu]
file = "imu.csv"

[[prism]]
name = "front"
file = "front.csv"
lever_arm_m = [0.5, 0, 1]
station_m = [363010.5, 5600020.25, 61.5]
station_orientation_deg = 337.205145
vertical_angle = "elevation"
reflector_constant_m = 0.0231
sigma_m = 0.003
sigma_distance_m = 0.0006
sigma_distance_ppm = 1
sigma_angle_arcsec = 0.5
loss = "huber"

[[prism]]
name = "rear"
file = "rear.csv"
time_offset_s = 0.05
lever_arm_m = [-0.5, 0, 1]
station_m = [363000.0, 5600000.0, 61.0]
observations = "cartesian"
sigma_m = [0.004, 0.004, 0.006]
loss = "none"

[gnss]
file = "gnss.csv"
lever_arm_m = [0, 0.3, 1]
loss = "cauchy"

[heading]
file = "heading.csv"
sigma_deg = 0.2
sigma_pitch_deg = 0.4
loss = "none"

[trajectory]
nodes = "imu"
zero_velocity = false
estimate = ["front.incidence_bias", "rear.time_offset", "gnss.lever_arm", "heading.mounting_offset",
    "heading.time_offset", "frame.gravity", "imu.gyro_scale_factor", "imu.noise_scale"]
max_sigma_position_m = 0.02
max_sigma_rotation_deg = 0.3
"#;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn write(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("project.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn read(text: &str) -> Result<Project> {
    let folder = folder();
    Project::read(&write(folder.path(), text))
}

#[test]
fn the_example_is_understood() {
    let folder = folder();
    let project = Project::read(&write(folder.path(), EXAMPLE)).unwrap();
    assert_eq!(project.axes, BodyAxes::Frd);
    let Motion::Logs(logs) = &project.motion else {
        panic!("logs");
    };
    assert_eq!(logs.imu.path, folder.path().join("imu.csv"));
    assert_eq!(logs.heading.as_ref().unwrap().time_offset_s, 0.0);
    let settings = &logs.settings;
    assert_eq!(
        settings.positions[0].lever_arm_m,
        Vec3::new(0.10, 0.05, -0.55)
    );
    // By hand: 0.15°/√h = 0.15 · π/180 / 60 rad/√s; 57 µg = 57e-6 · 9.80665 m/s²; a bias walks by its
    // instability within 100 s, which is a tenth of it per √s. Rounded to five digits.
    let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    close(settings.imu.gyro_density, 4.3633e-5);
    close(settings.imu.accel_density, 5.5898e-4);
    close(settings.imu.gyro_bias_walk, 3.3937e-6);
    close(settings.imu.accel_bias_walk, 1.3729e-5);
    close(settings.heading.sigma_rad, 0.012217);
    let left = &project.scanners[0];
    assert_eq!(left.profiles, [folder.path().join("left.bin")]);
    assert_eq!(left.convention, EulerConvention::Bonn);
    let expected = rotation_from_euler_deg(EulerConvention::Bonn, [-145.0, 0.0, 90.0]);
    assert_eq!(left.body_from_scanner.rotation, expected);
    assert_eq!(left.fixed, [false; 6]);
    assert_eq!(project.calibration, CalibrationSettings::default());
    assert_eq!(project.comparison, ComparisonSettings::default());
    assert_eq!(project.evaluations[0].name, "drive-2");
}

#[test]
fn the_default_noise_is_that_of_the_example() {
    let bare: String = EXAMPLE
        .lines()
        .filter(|line| !line.contains("_noise_") && !line.contains("instability"))
        .map(|line| format!("{line}\n"))
        .collect();
    let (bare, full) = (read(&bare).unwrap(), read(EXAMPLE).unwrap());
    let (Motion::Logs(bare), Motion::Logs(full)) = (&bare.motion, &full.motion) else {
        panic!("logs");
    };
    assert_eq!(bare.settings, full.settings);
}

#[test]
fn several_position_sensors_are_understood() {
    let project = read(SEVERAL).unwrap();
    let Motion::Logs(logs) = &project.motion else {
        panic!("logs");
    };
    let settings = &logs.settings;
    let names: Vec<&str> = settings.positions.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["front", "rear", "gnss"]);
    let losses: Vec<Loss> = settings.positions.iter().map(|p| p.loss).collect();
    assert_eq!(losses, [Loss::Huber, Loss::None, Loss::Cauchy]);
    let Observations::Polar(station) = logs.positions[0].observations else {
        panic!("polar");
    };
    assert_eq!(station.vertical, VerticalAngle::Elevation);
    // 0.5″ = 0.5 · π / 648000 rad.
    assert!((station.sigma_angle_rad / 2.424_068_4e-6 - 1.0).abs() < 1e-7);
    assert_eq!(station.sigma_prism_m, 0.003);
    assert_eq!(logs.positions[1].observations, Observations::Cartesian);
    assert_eq!(logs.positions[1].time_offset_s, 0.05);
    assert_eq!(
        settings.positions[1].sigma_m,
        Vec3::new(0.004, 0.004, 0.006)
    );
    assert_eq!(settings.positions[2].kind, PositionKind::Gnss);
    assert_eq!(settings.positions[2].sigma_m, Vec3::new(0.02, 0.02, 0.04));
    assert_eq!(settings.nodes, Nodes::Imu);
    assert!(!settings.zero_velocity);
    assert_eq!(
        settings.estimate,
        [
            Constant::IncidenceBias(0),
            Constant::TimeOffset(1),
            Constant::LeverArm(2),
            Constant::HeadingOffset,
            Constant::HeadingTimeOffset,
            Constant::Gravity,
            Constant::GyroScale,
            Constant::ImuNoiseScale
        ]
    );
    assert_eq!(settings.heading.pitch_sigma_rad, 0.4_f64.to_radians());
    assert_eq!(project.limits.position_m, Some(0.02));
    assert_eq!(project.limits.rotation_rad, Some(0.3_f64.to_radians()));
}

#[test]
fn tracking_noise_has_no_default_if_instrument_noise_is_given() {
    let tracking = |keys: &str| {
        let instrument = format!("station_m = [1, 2, 3]\nstation_orientation_deg = 12\n{keys}\n");
        let text = UNUSUAL.replacen("[[scanner]]", &format!("{instrument}[[scanner]]"), 1);
        let project = read(&text).unwrap();
        let Motion::Logs(logs) = &project.motion else {
            panic!("logs");
        };
        let Observations::Polar(station) = logs.positions[0].observations else {
            panic!("polar");
        };
        station.sigma_prism_m
    };
    assert_eq!(tracking(""), 0.005);
    assert_eq!(tracking("sigma_angle_arcsec = 1"), 0.0);
    assert_eq!(tracking("sigma_angle_arcsec = 1\nsigma_m = 0.002"), 0.002);
}

#[test]
fn unusual_keys_are_understood() {
    let project = read(UNUSUAL).unwrap();
    let Motion::Logs(logs) = &project.motion else {
        panic!("logs");
    };
    assert_eq!(logs.imu.path, Path::new("/logs/imu.csv"));
    assert_eq!(logs.imu.time_offset_s, -0.0125);
    assert_eq!(logs.heading, None);
    assert_eq!(logs.settings.imu.accel_bias_walk, 3e-5);
    assert_eq!(project.scanners[0].profiles.len(), 2);
    assert_eq!(
        project.scanners[0].fixed,
        [true, false, true, false, false, false]
    );
    assert_eq!(project.calibration.method, Method::Paper);
}

#[test]
fn printed_projects_read_back_to_the_same_project() {
    let instrument = "station_m = [1, 2, 3]\nstation_orientation_deg = 12\n[[scanner]]";
    let polar = UNUSUAL.replacen("[[scanner]]", instrument, 1);
    let bounded = format!("{POSES}max_sigma_rotation_deg = 0.07\n");
    for text in [EXAMPLE, UNUSUAL, POSES, SEVERAL, &polar, &bounded] {
        let folder = folder();
        let path = write(folder.path(), text);
        let project = Project::read(&path).unwrap();
        let printed = project.to_toml().unwrap();
        write(folder.path(), &printed);
        assert_eq!(Project::read(&path).unwrap(), project, "{printed}");
    }
}

#[test]
fn printed_scanners_can_be_pasted_into_another_project() {
    let project = read(UNUSUAL).unwrap();
    let pasted = format!("{POSES}\n{}", scanners_to_toml(&project.scanners).unwrap());
    let pasted = read(&pasted).unwrap();
    assert_eq!(pasted.scanners, project.scanners);
}

#[test]
fn typed_values_are_printed_as_typed() {
    let printed = read(EXAMPLE).unwrap().to_toml().unwrap();
    for line in [
        "gyro_noise_deg_sqrt_h = 0.15",
        "accel_noise_ug_sqrt_hz = 57.0",
        "gyro_bias_instability_deg_h = 7.0",
        "accel_bias_instability_ug = 14.0",
        "sigma_deg = 0.7",
        "rotation_deg = [-145.0, 0.0, 90.0]",
    ] {
        assert!(
            printed.lines().any(|printed| printed == line),
            "{line}\n{printed}"
        );
    }
}

proptest::proptest! {
    /// Mountings without a short decimal form also read back bit for bit.
    #[test]
    fn every_mounting_reads_back(
        axis in proptest::array::uniform3(-3.0f64..3.0),
        translation in proptest::array::uniform3(-2.0f64..2.0),
        sigma in 1e-6f64..1.0,
    ) {
        let folder = folder();
        let path = write(folder.path(), UNUSUAL);
        let mut project = Project::read(&path).unwrap();
        let rotation = crate::geometry::so3::exp(&axis.into());
        project.scanners[1].body_from_scanner = BodyFromScanner::new(rotation, translation.into());
        write(folder.path(), &project.to_toml().unwrap());
        let back = Project::read(&path).unwrap();
        proptest::prop_assert_eq!(
            back.scanners[1].body_from_scanner.rotation.coords, rotation.coords
        );
        proptest::prop_assert_eq!(&back, &project);

        let poses = format!("[trajectory]\nfile = \"t\"\nsigma_rotation_deg = {sigma}\n");
        let project = Project::read(&write(folder.path(), &poses)).unwrap();
        write(folder.path(), &project.to_toml().unwrap());
        proptest::prop_assert_eq!(Project::read(&path).unwrap(), project);
    }
}
