//! The logs or the poses, and the noise of the IMU.

use super::table::Table;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::project::checked::{LogFile, Logs, Motion, PosesFile};
use crate::project::settings::{
    HeadingSettings, ImuNoise, Loss, Nodes, PositionKind, PositionSettings, TrajectorySettings,
};
use crate::project::source::{Source, Step};
use crate::project::written::{self, Written};

/// Standard gravity, the g of datasheets, m/s².
const STANDARD_GRAVITY: f64 = 9.806_65;
/// Time in which a bias walks by its instability, seconds.
const BIAS_CORRELATION_S: f64 = 100.0;

/// Poses or logs, not both.
pub(super) fn motion(source: &Source, written: &Written) -> Result<Motion> {
    let given = [
        ("imu", written.imu.is_some()),
        ("prism", written.prism.is_some()),
        ("heading", written.heading.is_some()),
    ];
    if let Some(poses) = &written.trajectory {
        if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
            return Err(source.error(
                &[Step::Key(name)],
                format!("[{name}] beside [trajectory]"),
                "either a trajectory or the logs to estimate it from, not both",
            ));
        }
        return poses_file(source, poses).map(Motion::Poses);
    }
    match (&written.imu, &written.prism) {
        (Some(imu), Some(prism)) => {
            let logs = logs(source, written, imu, prism)?;
            Ok(Motion::Logs(Box::new(logs)))
        }
        (imu, _) => {
            let missing = if imu.is_none() { "imu" } else { "prism" };
            Err(source.error(
                &[],
                format!("no [{missing}]"),
                "[imu] and [prism], or [trajectory]",
            ))
        }
    }
}

fn poses_file(source: &Source, poses: &written::Poses) -> Result<PosesFile> {
    let table = Table::new(source, "trajectory");
    let sigma = |key, value: Option<f64>| value.map(|x| table.positive(key, x)).transpose();
    let LogFile {
        path,
        time_offset_s,
    } = table.log(&poses.file, poses.time_offset_s)?;
    Ok(PosesFile {
        path,
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
    prism: &written::Prism,
) -> Result<Logs> {
    let frame = Table::new(source, "frame");
    let convergence = all.frame.grid_convergence_deg;
    let gravity_m_s2 = all.frame.gravity_m_s2.unwrap_or(9.81);
    let prism_table = Table::new(source, "prism");
    let heading_table = Table::new(source, "heading");
    let heading = all.heading.clone().unwrap_or_default();
    let heading_log = all
        .heading
        .as_ref()
        .map(|heading| heading_table.log(&heading.file, heading.time_offset_s))
        .transpose()?;
    Ok(Logs {
        imu: Table::new(source, "imu").log(&imu.file, imu.time_offset_s)?,
        positions: vec![prism_table.log(&prism.file, prism.time_offset_s)?],
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
            positions: vec![PositionSettings {
                name: "prism".into(),
                kind: PositionKind::Prism,
                sigma_m: Vec3::repeat(
                    prism_table.positive("sigma_m", prism.sigma_m.unwrap_or(0.005))?,
                ),
                lever_arm_m: prism_table.vector("lever_arm_m", prism.lever_arm_m)?,
                station_m: None,
                loss: Loss::default(),
            }],
            heading: HeadingSettings {
                sigma_rad: heading_table
                    .positive("sigma_deg", heading.sigma_deg.unwrap_or(0.7))?
                    .to_radians(),
                mounting_offset_rad: heading_table
                    .finite("mounting_offset_deg", heading.mounting_offset_deg)?
                    .to_radians(),
                grid_convergence_rad: frame
                    .finite("grid_convergence_deg", convergence)?
                    .to_radians(),
                pitch_sigma_rad: 0.7_f64.to_radians(),
                loss: Loss::default(),
            },
            nodes: Nodes::default(),
            estimate: Vec::new(),
            zero_velocity: true,
        },
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
    Ok(ImuNoise {
        gyro_density: density(
            ("gyro_noise_deg_sqrt_h", imu.gyro_noise_deg_sqrt_h),
            0.15,
            gyro_density,
        )?,
        accel_density: density(
            ("accel_noise_ug_sqrt_hz", imu.accel_noise_ug_sqrt_hz),
            57.0,
            accel_density,
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
            7.0,
            gyro_bias_walk,
        )?,
        accel_bias_walk: walk(
            (
                "accel_bias_walk_m_s2_sqrt_s",
                imu.accel_bias_walk_m_s2_sqrt_s,
            ),
            ("accel_bias_instability_ug", imu.accel_bias_instability_ug),
            14.0,
            accel_bias_walk,
        )?,
    })
}

/// rad/s/√Hz of an angle random walk in °/√h.
pub(in crate::project) fn gyro_density(deg_sqrt_h: f64) -> f64 {
    (deg_sqrt_h / 60.0).to_radians()
}

/// m/s²/√Hz of a velocity random walk in µg/√Hz.
pub(in crate::project) fn accel_density(ug_sqrt_hz: f64) -> f64 {
    ug_sqrt_hz * 1e-6 * STANDARD_GRAVITY
}

/// rad/s/√s of a bias instability in °/h.
pub(in crate::project) fn gyro_bias_walk(deg_h: f64) -> f64 {
    (deg_h / 3600.0).to_radians() / BIAS_CORRELATION_S.sqrt()
}

/// m/s²/√s of a bias instability in µg.
pub(in crate::project) fn accel_bias_walk(ug: f64) -> f64 {
    ug * 1e-6 * STANDARD_GRAVITY / BIAS_CORRELATION_S.sqrt()
}
