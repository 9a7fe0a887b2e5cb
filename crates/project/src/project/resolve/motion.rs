//! Checks of the source of motion, logs or poses, and of the noise of the IMU.

use super::table::Table;
use super::{estimate, positions};
use crate::error::Result;
use crate::project::checked::{LogFile, Logs, Motion, PosesFile};
use crate::project::shapes::Files;
use crate::project::source::{Source, Step};
use crate::project::units::ImuUnits;
use crate::project::written::{self, Written};
use crate::trajectory::{HeadingSettings, ImuDatasheet, ImuNoise, PoseLimits, TrajectorySettings};

/// The source of motion: either poses or logs.
pub(super) fn motion(source: &Source, written: &Written) -> Result<Motion> {
    let given = [
        ("imu", written.imu.is_some()),
        ("prism", !written.prism.is_empty()),
        ("gnss", !written.gnss.is_empty()),
        ("heading", written.heading.is_some()),
    ];
    let empty = written::Trajectory::default();
    let trajectory = written.trajectory.as_ref().unwrap_or(&empty);
    if let Some(file) = &trajectory.file {
        if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
            return Err(source.error(
                &[Step::Key(name)],
                format!("[{name}] together with [trajectory] with a file"),
                "either a trajectory or the logs to estimate it from, not both",
            ));
        }
        return poses_file(source, file, trajectory).map(Motion::Poses);
    }
    let has_positions = !written.prism.is_empty() || !written.gnss.is_empty();
    match &written.imu {
        Some(imu) if has_positions => {
            let logs = logs(source, written, imu, trajectory)?;
            Ok(Motion::Logs(Box::new(logs)))
        }
        imu => {
            let mut missing = Vec::new();
            if imu.is_none() {
                missing.push("no [imu]");
            }
            if !has_positions {
                missing.push("no [prism] or [gnss]");
            }
            Err(source.error(
                &[],
                missing.join(" and "),
                "[imu] and [prism] or [gnss], or [trajectory] with a file",
            ))
        }
    }
}

/// Limits on the uncertainty of poses, which must be above 0.
pub(super) fn limits(source: &Source, written: &Written) -> Result<PoseLimits> {
    let table = Table::new(source, "trajectory");
    let bound = |key, value: Option<f64>| value.map(|x| table.positive(key, x)).transpose();
    let Some(trajectory) = &written.trajectory else {
        return Ok(PoseLimits::default());
    };
    Ok(PoseLimits {
        position_m: bound("max_sigma_position_m", trajectory.max_sigma_position_m)?,
        rotation_rad: bound("max_sigma_rotation_deg", trajectory.max_sigma_rotation_deg)?
            .map(f64::to_radians),
    })
}

/// Checks that none of these keys is given, because they have no meaning here.
fn refuse(table: &Table<'_>, keys: &[(&str, bool)], reason: &str, expected: &str) -> Result<()> {
    match keys.iter().find(|(_, given)| *given) {
        Some((key, _)) => Err(table.error(key, format!("{key} {reason}"), expected)),
        None => Ok(()),
    }
}

fn poses_file(source: &Source, files: &Files, poses: &written::Trajectory) -> Result<PosesFile> {
    let table = Table::new(source, "trajectory");
    let estimation = [
        ("nodes", poses.nodes.is_some()),
        ("estimate", poses.estimate.is_some()),
        ("zero_velocity", poses.zero_velocity.is_some()),
    ];
    refuse(
        &table,
        &estimation,
        "together with a file of poses",
        "this key only if the trajectory is estimated from logs",
    )?;
    let sigma = |key, value: Option<f64>| value.map(|x| table.positive(key, x)).transpose();
    let Some((first, others)) = files.0.split_first() else {
        return Err(table.error("file", "an empty list", "at least one file"));
    };
    let LogFile {
        path,
        time_offset_s,
    } = table.log(first, poses.time_offset_s)?;
    Ok(PosesFile {
        path,
        others: others.iter().map(|file| source.absolute(file)).collect(),
        time_offset_s,
        sigma_position_m: sigma("sigma_position_m", poses.sigma_position_m)?,
        sigma_rotation_rad: sigma("sigma_rotation_deg", poses.sigma_rotation_deg)?
            .map(f64::to_radians),
    })
}

fn logs(
    source: &Source,
    all: &Written,
    imu: &written::Imu,
    trajectory: &written::Trajectory,
) -> Result<Logs> {
    let frame = Table::new(source, "frame");
    let gravity_m_s2 = all.frame.gravity_m_s2.unwrap_or(9.81);
    let heading_log = all
        .heading
        .as_ref()
        .map(|heading| Table::new(source, "heading").log(&heading.file, heading.time_offset_s))
        .transpose()?;
    let of_poses = [
        ("time_offset_s", trajectory.time_offset_s.is_some()),
        ("correlation_s", trajectory.correlation_s.is_some()),
        ("sigma_position_m", trajectory.sigma_position_m.is_some()),
        (
            "sigma_rotation_deg",
            trajectory.sigma_rotation_deg.is_some(),
        ),
    ];
    let table = Table::new(source, "trajectory");
    refuse(
        &table,
        &of_poses,
        "without a file of poses",
        "`file` as well; offsets and sigmas of logs belong in their own tables",
    )?;
    let sensors = positions::positions(source, all)?;
    let (positions, position_settings): (Vec<_>, Vec<_>) = sensors.into_iter().unzip();
    let listed = estimate::listed(&table, trajectory.estimate.as_ref())?;
    let estimate = estimate::constants(
        &table,
        listed.as_deref().unwrap_or_default(),
        &position_settings,
        heading_log.is_some(),
    )?;
    Ok(Logs {
        imu: Table::new(source, "imu").log(&imu.file, imu.time_offset_s)?,
        imu_units: ImuUnits {
            accel: imu.accel_unit.unwrap_or_default(),
            gyro: imu.gyro_unit.unwrap_or_default(),
        },
        positions,
        heading: heading_log,
        settings: TrajectorySettings {
            axes: all.frame.body.unwrap_or_default(),
            gravity_m_s2: frame.number(
                "gravity_m_s2",
                gravity_m_s2,
                |g| (9.7..=9.9).contains(&g),
                "the magnitude of gravity on Earth, 9.7 to 9.9",
            )?,
            imu: imu_noise(source, imu)?,
            positions: position_settings,
            heading: heading(source, all)?,
            nodes: trajectory.nodes.unwrap_or_default(),
            max_step_s: TrajectorySettings::MAX_STEP_S,
            estimate,
            zero_velocity: trajectory.zero_velocity.unwrap_or(true),
        },
        estimates_doubted: listed.is_none(),
    })
}

fn heading(source: &Source, all: &Written) -> Result<HeadingSettings> {
    let table = Table::new(source, "heading");
    let heading = all.heading.clone().unwrap_or_default();
    let sigma_deg = table.positive("sigma_deg", heading.sigma_deg.unwrap_or(0.7))?;
    let pitch_deg = heading.sigma_pitch_deg.unwrap_or(sigma_deg);
    let correlated_deg = heading.sigma_correlated_deg;
    let convergence_deg = all.frame.grid_convergence_deg;
    Ok(HeadingSettings {
        sigma_rad: sigma_deg.to_radians(),
        pitch_sigma_rad: table.positive("sigma_pitch_deg", pitch_deg)?.to_radians(),
        sigma_correlated_rad: table
            .not_negative("sigma_correlated_deg", correlated_deg.unwrap_or(0.0))?
            .to_radians(),
        correlation_s: table.correlation(
            "sigma_correlated_deg",
            correlated_deg.is_some(),
            heading.correlation_s,
        )?,
        mounting_offset_rad: table
            .finite("mounting_offset_deg", heading.mounting_offset_deg)?
            .to_radians(),
        grid_convergence_rad: Table::new(source, "frame")
            .finite("grid_convergence_deg", convergence_deg)?
            .to_radians(),
        loss: heading.loss.unwrap_or_default(),
    })
}

fn imu_noise(source: &Source, imu: &written::Imu) -> Result<ImuNoise> {
    let table = Table::new(source, "imu");
    type Given<'k> = (&'k str, Option<f64>);
    let density = |(key, value): Given<'_>, default: f64, unit: fn(f64) -> f64| {
        table.positive(key, value.unwrap_or(default)).map(unit)
    };
    let walk = |walk: Given<'_>, instability: Given<'_>, default, unit| match (walk, instability) {
        ((key, Some(_)), (other, Some(_))) => {
            Err(table.error(key, format!("both {key} and {other}"), "one of the two"))
        }
        ((key, Some(value)), _) => table.positive(key, value),
        _ => density(instability, default, unit),
    };
    let default = ImuDatasheet::default();
    Ok(ImuNoise {
        gyro_density: density(
            ("gyro_noise_deg_sqrt_h", imu.gyro_noise_deg_sqrt_h),
            default.gyro_noise_deg_sqrt_h,
            ImuNoise::gyro_density,
        )?,
        accel_density: density(
            ("accel_noise_ug_sqrt_hz", imu.accel_noise_ug_sqrt_hz),
            default.accel_noise_ug_sqrt_hz,
            ImuNoise::accel_density,
        )?,
        gyro_bias_walk: walk(
            (
                "gyro_bias_walk_rad_s_sqrt_s",
                imu.gyro_bias_walk_rad_s_sqrt_s,
            ),
            (
                "gyro_bias_instability_deg_h",
                imu.gyro_bias_instability_deg_h,
            ),
            default.gyro_bias_instability_deg_h,
            ImuNoise::gyro_bias_walk,
        )?,
        accel_bias_walk: walk(
            (
                "accel_bias_walk_m_s2_sqrt_s",
                imu.accel_bias_walk_m_s2_sqrt_s,
            ),
            ("accel_bias_instability_ug", imu.accel_bias_instability_ug),
            default.accel_bias_instability_ug,
            ImuNoise::accel_bias_walk,
        )?,
    })
}
