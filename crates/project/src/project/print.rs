//! Writes a checked project as a file that reads back as the same project.

use super::checked::{
    Logs, Motion, OtherDrive, PosesFile, PositionLog, Project, Reference, Scanner,
};
use super::resolve::{AUTO, TIME_OFFSET, arcsec_to_radians};
use super::shapes::{Files, Numbers};
use super::units::TimeUnit;
use super::written::{self, ObservationKind, Written};
use crate::calibration::{Method, PARAMETER_NAMES};
use crate::error::{Error, Result};
use crate::geometry::euler::{euler_deg_from_rotation, rotation_from_euler_deg};
use crate::joint::{COMPLIANCE, Compliance, MountingMotion, ReferenceSigma, Rung};
use crate::sensor::Observations;
use crate::trajectory::{ImuNoise, PositionKind, PositionSettings};

/// See [`Project::to_toml`].
pub(super) fn project(project: &Project, voxel_sizes_m: Option<&[f64]>) -> Result<String> {
    print(&written(project, voxel_sizes_m))
}

/// See [`super::scanners_to_toml`].
pub(super) fn scanners(scanners: &[Scanner]) -> Result<String> {
    let scanner = scanners.iter().map(scanner).collect();
    print(&written::Mountings { scanner })
}

fn print<T: serde::Serialize>(value: &T) -> Result<String> {
    toml::to_string(value).map_err(|error| {
        Error::data(
            format!("the project cannot be written as TOML: {error}"),
            "use file and folder names that are valid UTF-8",
        )
    })
}

fn written(project: &Project, voxel_sizes_m: Option<&[f64]>) -> Written {
    let calibration = &project.calibration;
    let comparison = &project.comparison;
    let mut written = Written {
        frame: written::Frame {
            body: Some(project.axes),
            origin_m: project.origin_m.map(Into::into),
            crs: project.crs.as_ref().map(|crs| crs.name().to_owned()),
            ..Default::default()
        },
        scanner: project.scanners.iter().map(scanner).collect(),
        reference: project
            .reference
            .as_ref()
            .map(|reference| write_reference(reference, &project.joint.reference)),
        calibration: written::Calibration {
            voxel_sizes_m: Some(match voxel_sizes_m {
                Some(sizes) => sizes.to_vec().into(),
                None if project.has_auto_scales => AUTO.into(),
                None => calibration.voxel_sizes_m.clone().into(),
            }),
            neighbours: Some(calibration.neighbours),
            method: Some(method(project)),
            max_iterations: Some(calibration.max_iterations),
            pass_gap_s: Some(calibration.pass_gap_s),
        },
        joint: written::Joint {
            surfel_m: project.joint.surfel_m,
            max_iterations: Some(project.joint.max_iterations),
            mounting: Some(mounting_motion(&project.joint.mounting)),
        },
        bending: project.bending.as_ref().map(|bending| written::Bending {
            file: bending.log.path.clone(),
            time_offset_s: Some(bending.log.time_offset_s),
            columns: bending.columns.clone(),
        }),
        drive: project.drives.iter().map(other_drive).collect(),
        evaluation: project.evaluations.iter().map(other_drive).collect(),
        comparison: written::Comparison {
            core_spacing_m: Some(comparison.core_spacing_m),
            normal_radii_m: Some(comparison.normal_radii_m.clone()),
            cylinder_radius_m: Some(comparison.cylinder_radius_m),
            max_distance_m: Some(comparison.max_distance_m),
            registration_error_m: Some(comparison.registration_error_m),
            aggregation: Some(comparison.aggregation),
            detection: Some(comparison.detection),
            one_sided: Some(comparison.one_sided),
            min_points: Some(comparison.min_points),
        },
        acceptance: written::Acceptance {
            sigma_translation_m: Some(project.acceptance.sigma_translation_m),
            sigma_rotation_deg: Some(degrees(project.acceptance.sigma_rotation_rad)),
            distance_m: Some(project.acceptance.distance_m),
            coverage: Some(project.acceptance.coverage),
        },
        report: written::Report {
            title: project.imprint.title.clone(),
            author: project.imprint.author.clone(),
            organisation: project.imprint.organisation.clone(),
            logo: project.imprint.logo.clone(),
        },
        ..Default::default()
    };
    let mut trajectory = match &project.motion {
        Motion::Logs(logs) => {
            write_logs(logs, &mut written);
            write_estimation(logs)
        }
        Motion::Poses(poses) => written::Trajectory {
            correlation_s: Some(project.joint.correlation_s),
            ..write_poses(poses)
        },
    };
    trajectory.max_sigma_position_m = project.limits.position_m;
    trajectory.max_sigma_rotation_deg = project.limits.rotation_rad.map(degrees);
    written.trajectory = Some(trajectory);
    written
}

fn method(project: &Project) -> written::Method {
    match project.calibration.method {
        _ if project.is_joint => written::Method::Joint,
        Method::TwoStep | Method::Joint => written::Method::TwoStep,
        Method::Paper => written::Method::Paper,
    }
}

fn mounting_motion(motion: &MountingMotion) -> written::MountingMotion {
    match motion.most {
        _ if motion.least < motion.most => written::MountingMotion::Auto,
        Rung::Rigid => written::MountingMotion::Rigid,
        Rung::Compliance => written::MountingMotion::Compliance,
        Rung::SlowKnots => written::MountingMotion::SlowKnots,
        Rung::DenseKnots => written::MountingMotion::DenseKnots,
    }
}

/// Assumed standard deviations are not written, so that they remain assumptions when the file is read.
fn write_reference(reference: &Reference, sigma: &ReferenceSigma) -> written::Reference {
    written::Reference {
        file: reference.path.clone(),
        sigma_m: (!sigma.assumed).then_some(sigma.shift_m),
        sigma_deg: (!sigma.assumed).then(|| degrees(sigma.tilt_rad)),
        sigma_surface_m: sigma.surface_m,
    }
}

fn other_drive(other: &OtherDrive) -> written::OtherDrive {
    written::OtherDrive {
        name: other.name.clone(),
        project: other.project.clone(),
    }
}

fn write_poses(poses: &PosesFile) -> written::Trajectory {
    written::Trajectory {
        file: Some(Files(poses.paths().cloned().collect())),
        time_offset_s: Some(poses.time_offset_s),
        sigma_position_m: poses.sigma_position_m,
        sigma_rotation_deg: poses.sigma_rotation_rad.map(degrees),
        ..Default::default()
    }
}

fn write_estimation(logs: &Logs) -> written::Trajectory {
    let settings = &logs.settings;
    let names = settings.estimate.iter();
    let names = names.map(|constant| constant.name(&settings.positions).into());
    let estimate = if logs.estimates_doubted {
        "auto".into()
    } else {
        toml::Value::Array(names.collect())
    };
    written::Trajectory {
        nodes: Some(settings.nodes),
        estimate: Some(estimate),
        zero_velocity: Some(settings.zero_velocity),
        ..Default::default()
    }
}

fn write_prism(log: &PositionLog, settings: &PositionSettings) -> written::Prism {
    let mut prism = written::Prism {
        name: Some(settings.name.clone()),
        file: log.path.clone(),
        time_offset_s: Some(log.time_offset_s),
        sigma_m: Some(Numbers(settings.sigma_m.into())),
        sigma_correlated_m: Some(Numbers(settings.sigma_correlated_m.into())),
        correlation_s: Some(settings.correlation_s),
        lever_arm_m: settings.lever_arm_m.into(),
        sigma_lever_arm_m: Some(settings.sigma_lever_arm_m),
        loss: Some(settings.loss),
        station_m: settings.station_m.map(Into::into),
        ..Default::default()
    };
    match &log.observations {
        Observations::AsFound => {}
        Observations::Cartesian => prism.observations = Some(ObservationKind::Cartesian),
        Observations::Polar(station) => {
            prism.observations = Some(ObservationKind::Polar);
            prism.station_orientation_deg = Some(degrees(station.orientation_rad));
            prism.vertical_angle = Some(station.vertical);
            prism.reflector_constant_m = Some(station.reflector_constant_m);
            prism.sigma_distance_m = Some(station.sigma_distance_m);
            prism.sigma_distance_ppm = Some(station.sigma_distance_ppm);
            let arcsec = preimage(station.sigma_angle_rad, arcsec_to_radians);
            prism.sigma_angle_arcsec = Some(arcsec);
            prism.sigma_m = Some(Numbers([station.sigma_prism_m; 3]));
        }
    }
    prism
}

fn write_gnss(log: &PositionLog, settings: &PositionSettings) -> written::Gnss {
    let noise = &log.by_quality;
    written::Gnss {
        name: Some(settings.name.clone()),
        file: log.path.clone(),
        time_offset_s: Some(log.time_offset_s),
        sigma_m: Some(Numbers(settings.sigma_m.into())),
        sigma_float_m: Some(Numbers(noise.float_m.into())),
        sigma_differential_m: Some(Numbers(noise.differential_m.into())),
        sigma_single_m: Some(Numbers(noise.single_m.into())),
        sigma_correlated_m: Some(Numbers(settings.sigma_correlated_m.into())),
        correlation_s: Some(settings.correlation_s),
        lever_arm_m: settings.lever_arm_m.into(),
        sigma_lever_arm_m: Some(settings.sigma_lever_arm_m),
        loss: Some(settings.loss),
    }
}

fn write_logs(logs: &Logs, written: &mut Written) {
    let settings = &logs.settings;
    let noise = &settings.imu;
    written.frame.gravity_m_s2 = Some(settings.gravity_m_s2);
    written.frame.grid_convergence_deg = Some(degrees(settings.heading.grid_convergence_rad));
    // The instability if it gives exactly the random walk in use, else the random walk itself.
    let gyro = datasheet(noise.gyro_bias_walk, ImuNoise::gyro_bias_walk);
    let accel = datasheet(noise.accel_bias_walk, ImuNoise::accel_bias_walk);
    written.imu = Some(written::Imu {
        file: logs.imu.path.clone(),
        time_offset_s: Some(logs.imu.time_offset_s),
        accel_unit: Some(logs.imu_units.accel),
        gyro_unit: Some(logs.imu_units.gyro),
        gyro_noise_deg_sqrt_h: Some(preimage(noise.gyro_density, ImuNoise::gyro_density)),
        accel_noise_ug_sqrt_hz: Some(preimage(noise.accel_density, ImuNoise::accel_density)),
        gyro_bias_instability_deg_h: gyro,
        accel_bias_instability_ug: accel,
        gyro_bias_walk_rad_s_sqrt_s: gyro.is_none().then_some(noise.gyro_bias_walk),
        accel_bias_walk_m_s2_sqrt_s: accel.is_none().then_some(noise.accel_bias_walk),
    });
    for (log, position) in logs.positions.iter().zip(&settings.positions) {
        match position.kind {
            PositionKind::Prism => written.prism.0.push(write_prism(log, position)),
            PositionKind::Gnss => written.gnss.0.push(write_gnss(log, position)),
        }
    }
    written.heading = logs.heading.as_ref().map(|heading| written::Heading {
        file: heading.path.clone(),
        time_offset_s: Some(heading.time_offset_s),
        sigma_deg: Some(degrees(settings.heading.sigma_rad)),
        sigma_pitch_deg: Some(degrees(settings.heading.pitch_sigma_rad)),
        sigma_correlated_deg: Some(degrees(settings.heading.sigma_correlated_rad)),
        correlation_s: Some(settings.heading.correlation_s),
        mounting_offset_deg: Some(degrees(settings.heading.mounting_offset_rad)),
        loss: Some(settings.heading.loss),
    });
}

fn compliance(compliance: &Compliance) -> written::Compliance {
    let turns = |all: &[f64; COMPLIANCE]| {
        let turn = |row: usize, load: usize| preimage(all[6 * load + row], f64::to_radians);
        std::array::from_fn(|row| std::array::from_fn(|load| turn(row, load)))
    };
    let shifts = |all: &[f64; COMPLIANCE]| {
        std::array::from_fn(|row| std::array::from_fn(|load| all[6 * load + 3 + row]))
    };
    written::Compliance {
        reference_load_g: compliance.mean_load,
        shift_m_per_g: shifts(&compliance.by_load),
        turn_deg_per_g: turns(&compliance.by_load),
        sigma_shift_m_per_g: shifts(&compliance.sigma),
        sigma_turn_deg_per_g: turns(&compliance.sigma),
    }
}

fn scanner(scanner: &Scanner) -> written::Scanner {
    let rotation = &scanner.body_from_scanner.rotation;
    let angles = euler_deg_from_rotation(scanner.convention, rotation);
    // The angles as typed if they give exactly the same rotation, else the quaternion.
    let rotation_deg = (0..DIGITS)
        .map(|digits| angles.map(|angle| rounded(angle, digits)))
        .find(|angles| {
            rotation_from_euler_deg(scanner.convention, *angles).coords == rotation.coords
        });
    let fixed: Vec<String> = PARAMETER_NAMES
        .iter()
        .zip(scanner.fixed)
        .filter(|(_, fixed)| *fixed)
        .map(|(name, _)| (*name).to_owned())
        .collect();
    written::Scanner {
        name: scanner.name.clone(),
        profiles: Files(scanner.profiles.clone()),
        time_offset_s: Some(scanner.time_offset_s),
        point_time_field: scanner.point_times.field.clone(),
        point_time_unit: scanner.point_times.unit_s.and_then(TimeUnit::of_length_s),
        translation_m: scanner.body_from_scanner.translation_m.into(),
        rotation_deg,
        quaternion_xyzw: rotation_deg.is_none().then(|| {
            let q = rotation.coords;
            [q.x, q.y, q.z, q.w]
        }),
        rotation_convention: Some(scanner.convention),
        fixed: (!fixed.is_empty()).then_some(fixed),
        estimate: (scanner.estimate_time_offset).then(|| vec![TIME_OFFSET.to_owned()]),
        compliance: scanner.compliance.as_ref().map(compliance),
    }
}

/// Decimal digits after the first that distinguish any two f64.
const DIGITS: usize = 17;

fn rounded(value: f64, digits: usize) -> f64 {
    let rounded: f64 = format!("{value:.digits$e}").parse().unwrap_or(value);
    rounded + 0.0 // -0 becomes 0
}

fn degrees(angle_rad: f64) -> f64 {
    preimage(angle_rad, f64::to_radians)
}

/// The shortest decimal that the linear `unit` maps exactly to `value`; if there is no such f64, the
/// nearest one.
fn preimage(value: f64, unit: fn(f64) -> f64) -> f64 {
    let guess = value / unit(1.0);
    (0..DIGITS)
        .map(|digits| rounded(guess, digits))
        .chain([guess.next_up(), guess.next_down()])
        .find(|candidate| unit(*candidate) == value)
        .unwrap_or(guess)
}

/// The decimal of at most ten digits that `unit` maps exactly to `value`, if there is one.
fn datasheet(value: f64, unit: fn(f64) -> f64) -> Option<f64> {
    let candidate = preimage(value, unit);
    (unit(candidate) == value && rounded(candidate, 9) == candidate).then_some(candidate)
}
