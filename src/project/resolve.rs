//! From the project as typed to the project as checked.

use std::path::Path;

use super::checked::{
    Evaluation, LogFile, Logs, Motion, PARAMETER_NAMES, PosesFile, Project, Reference, Scanner,
};
use super::settings::{
    CalibrationSettings, ComparisonSettings, HeadingSettings, ImuNoise, PrismSettings,
    TrajectorySettings,
};
use super::source::{Source, Step, nearest};
use super::written::{self, Written};
use crate::error::Result;
use crate::geometry::euler::rotation_from_euler_deg;
use crate::geometry::{EulerConvention, Rotation, Vec3, pose};

/// Standard gravity, the g of datasheets, m/s².
pub(super) const STANDARD_GRAVITY: f64 = 9.806_65;
/// Time in which a bias walks by its instability, seconds.
const BIAS_CORRELATION_S: f64 = 100.0;
/// Largest deviation from length 1 that rounding to four digits explains.
const QUATERNION_TOLERANCE: f64 = 1e-3;

/// rad/s/√Hz of an angle random walk in °/√h.
pub(super) fn gyro_density(deg_sqrt_h: f64) -> f64 {
    (deg_sqrt_h / 60.0).to_radians()
}

/// m/s²/√Hz of a velocity random walk in µg/√Hz.
pub(super) fn accel_density(ug_sqrt_hz: f64) -> f64 {
    ug_sqrt_hz * 1e-6 * STANDARD_GRAVITY
}

/// rad/s/√s of a bias instability in °/h.
pub(super) fn gyro_bias_walk(deg_h: f64) -> f64 {
    (deg_h / 3600.0).to_radians() / BIAS_CORRELATION_S.sqrt()
}

/// m/s²/√s of a bias instability in µg.
pub(super) fn accel_bias_walk(ug: f64) -> f64 {
    ug * 1e-6 * STANDARD_GRAVITY / BIAS_CORRELATION_S.sqrt()
}

/// Checks `written` and brings it into SI units.
pub(super) fn resolve(source: &Source, written: Written) -> Result<Project> {
    let check = Check { source };
    let frame = Table::new(source, "frame");
    let origin_m = frame.vector("origin_m", written.frame.origin_m.unwrap_or_default())?;
    let motion = check.motion(&written)?;
    let scanners = check.scanners(&written.scanner)?;
    let evaluations = check.evaluations(&written.evaluation)?;
    let reference = written.reference.as_ref().map(|reference| Reference {
        path: source.absolute(&reference.file),
    });
    Ok(Project {
        path: source.path.clone(),
        axes: written.frame.body.unwrap_or_default(),
        origin_m,
        motion,
        scanners,
        reference,
        calibration: check.calibration(&written.calibration)?,
        comparison: check.comparison(&written.comparison)?,
        evaluations,
    })
}

/// One table of the file, for errors that name its keys.
struct Table<'a> {
    source: &'a Source,
    name: &'a str,
    /// Which, where the table is one of an array.
    index: Option<usize>,
}

impl<'a> Table<'a> {
    fn new(source: &'a Source, name: &'a str) -> Self {
        let index = None;
        Self {
            source,
            name,
            index,
        }
    }

    fn error(&self, key: &str, found: impl Into<String>, expected: &str) -> crate::Error {
        let mut steps = vec![Step::Key(self.name)];
        steps.extend(self.index.map(Step::Index));
        steps.push(Step::Key(key));
        self.source.error(&steps, found, expected)
    }

    /// `value` where it is finite and `good`.
    fn number(&self, key: &str, value: f64, good: fn(f64) -> bool, expected: &str) -> Result<f64> {
        if value.is_finite() && good(value) {
            Ok(value)
        } else {
            Err(self.error(key, format!("{key} = {value}"), expected))
        }
    }

    fn finite(&self, key: &str, value: Option<f64>) -> Result<f64> {
        self.number(key, value.unwrap_or(0.0), |_| true, "a finite number")
    }

    fn positive(&self, key: &str, value: f64) -> Result<f64> {
        self.number(key, value, |x| x > 0.0, "a number above 0")
    }

    fn not_negative(&self, key: &str, value: f64) -> Result<f64> {
        self.number(key, value, |x| x >= 0.0, "a number not below 0")
    }

    fn vector(&self, key: &str, values: [f64; 3]) -> Result<Vec3> {
        for value in values {
            self.finite(key, Some(value))?;
        }
        Ok(values.into())
    }

    fn log(&self, file: &Path, time_offset_s: Option<f64>) -> Result<LogFile> {
        Ok(LogFile {
            path: self.source.absolute(file),
            time_offset_s: self.finite("time_offset_s", time_offset_s)?,
        })
    }
}

struct Check<'a> {
    source: &'a Source,
}

impl<'a> Check<'a> {
    fn table(&self, name: &'a str) -> Table<'a> {
        Table::new(self.source, name)
    }

    fn motion(&self, written: &Written) -> Result<Motion> {
        let logs = [
            ("imu", written.imu.is_some()),
            ("prism", written.prism.is_some()),
            ("heading", written.heading.is_some()),
        ];
        if let Some(poses) = &written.trajectory {
            if let Some((name, _)) = logs.iter().find(|(_, given)| *given) {
                return Err(self.source.error(
                    &[Step::Key(name)],
                    format!("[{name}] beside [trajectory]"),
                    "either a trajectory or the logs to estimate it from, not both",
                ));
            }
            return self.poses(poses).map(Motion::Poses);
        }
        match (&written.imu, &written.prism) {
            (Some(imu), Some(prism)) => {
                let logs = self.logs(written, imu, prism)?;
                Ok(Motion::Logs(Box::new(logs)))
            }
            (imu, _) => {
                let missing = if imu.is_none() { "imu" } else { "prism" };
                Err(self.source.error(
                    &[],
                    format!("no [{missing}]"),
                    "[imu] and [prism], or [trajectory]",
                ))
            }
        }
    }

    fn poses(&self, poses: &written::Poses) -> Result<PosesFile> {
        let table = self.table("trajectory");
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

    fn logs(&self, all: &Written, imu: &written::Imu, prism: &written::Prism) -> Result<Logs> {
        let frame = self.table("frame");
        let convergence = all.frame.grid_convergence_deg;
        let gravity_m_s2 = all.frame.gravity_m_s2.unwrap_or(9.81);
        let prism_table = self.table("prism");
        let heading_table = self.table("heading");
        let heading = all.heading.clone().unwrap_or_default();
        let heading_log = all
            .heading
            .as_ref()
            .map(|heading| heading_table.log(&heading.file, heading.time_offset_s))
            .transpose()?;
        Ok(Logs {
            imu: self.table("imu").log(&imu.file, imu.time_offset_s)?,
            prism: prism_table.log(&prism.file, prism.time_offset_s)?,
            heading: heading_log,
            settings: TrajectorySettings {
                axes: all.frame.body.unwrap_or_default(),
                gravity_m_s2: frame.number(
                    "gravity_m_s2",
                    gravity_m_s2,
                    |g| (9.7..=9.9).contains(&g),
                    "the magnitude of gravity on Earth, 9.7 to 9.9",
                )?,
                imu: self.imu_noise(imu)?,
                prism: PrismSettings {
                    sigma_m: prism_table.positive("sigma_m", prism.sigma_m.unwrap_or(0.005))?,
                    lever_arm_m: prism_table.vector("lever_arm_m", prism.lever_arm_m)?,
                },
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
                },
            },
        })
    }

    fn imu_noise(&self, imu: &written::Imu) -> Result<ImuNoise> {
        let table = self.table("imu");
        type Given<'k> = (&'k str, Option<f64>);
        let density = |(key, value): Given<'_>, default: f64, unit: fn(f64) -> f64| {
            table.positive(key, value.unwrap_or(default)).map(unit)
        };
        let walk =
            |walk: Given<'_>, instability: Given<'_>, default, unit| match (walk, instability) {
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

    fn scanners(&self, written: &[written::Scanner]) -> Result<Vec<Scanner>> {
        let names: Vec<&str> = written.iter().map(|s| s.name.as_str()).collect();
        self.names("scanner", &names)?;
        written
            .iter()
            .enumerate()
            .map(|(index, scanner)| self.scanner(index, scanner))
            .collect()
    }

    fn scanner(&self, index: usize, scanner: &written::Scanner) -> Result<Scanner> {
        let table = Table {
            index: Some(index),
            ..self.table("scanner")
        };
        if scanner.profiles.0.is_empty() {
            return Err(table.error("profiles", "an empty list", "at least one file"));
        }
        let convention = scanner.rotation_convention.unwrap_or_default();
        let rotation = rotation(&table, scanner, convention)?;
        let translation_m = table.vector("translation_m", scanner.translation_m)?;
        let mut fixed = [false; 6];
        for name in scanner.fixed.iter().flatten() {
            match PARAMETER_NAMES.iter().position(|known| known == name) {
                Some(parameter) => fixed[parameter] = true,
                None => {
                    let near = nearest(name, &PARAMETER_NAMES).unwrap_or_default();
                    return Err(table.error(
                        "fixed",
                        format!("the unknown parameter `{name}`"),
                        &format!("`{near}` (parameters: {})", PARAMETER_NAMES.join(", ")),
                    ));
                }
            }
        }
        Ok(Scanner {
            name: scanner.name.clone(),
            profiles: scanner
                .profiles
                .0
                .iter()
                .map(|file| self.source.absolute(file))
                .collect(),
            time_offset_s: table.finite("time_offset_s", scanner.time_offset_s)?,
            body_from_scanner: pose(rotation, translation_m),
            convention,
            fixed,
        })
    }

    fn evaluations(&self, written: &[written::Evaluation]) -> Result<Vec<Evaluation>> {
        let names: Vec<&str> = written.iter().map(|e| e.name.as_str()).collect();
        self.names("evaluation", &names)?;
        let evaluation = |evaluation: &written::Evaluation| Evaluation {
            name: evaluation.name.clone(),
            project: self.source.absolute(&evaluation.project),
        };
        Ok(written.iter().map(evaluation).collect())
    }

    /// Names become file names and keys of the result: fit for both, and each only once even where
    /// the file system does not tell upper from lower case.
    fn names(&self, array: &'a str, names: &[&str]) -> Result<()> {
        let lower: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
        let pairs: Vec<String> = lower
            .iter()
            .flat_map(|a| lower.iter().map(move |b| format!("{a}-{b}")))
            .collect();
        for (index, name) in names.iter().enumerate() {
            let table = Table {
                index: Some(index),
                ..self.table(array)
            };
            let fit = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
            if name.is_empty() || name.chars().count() > 64 || !name.chars().all(fit) {
                return Err(table.error(
                    "name",
                    format!("the name {name:?}"),
                    "1 to 64 letters, digits, `-` or `_`, as it becomes part of file names",
                ));
            }
            if lower[..index].contains(&lower[index]) {
                return Err(table.error(
                    "name",
                    format!("the name {name:?} a second time"),
                    "a name of its own for each",
                ));
            }
            if lower[index] == "initial" || array == "scanner" && pairs.contains(&lower[index]) {
                return Err(table.error(
                    "name",
                    format!("the name {name:?}, which the results need for something else"),
                    "another name",
                ));
            }
        }
        Ok(())
    }

    fn calibration(&self, written: &written::Calibration) -> Result<CalibrationSettings> {
        let table = self.table("calibration");
        let default = CalibrationSettings::default();
        let voxel_sizes_m = written
            .voxel_sizes_m
            .clone()
            .unwrap_or(default.voxel_sizes_m);
        for &size in &voxel_sizes_m {
            table.positive("voxel_sizes_m", size)?;
        }
        if voxel_sizes_m.is_empty() || voxel_sizes_m.windows(2).any(|pair| pair[1] >= pair[0]) {
            return Err(table.error(
                "voxel_sizes_m",
                format!("voxel_sizes_m = {voxel_sizes_m:?}"),
                "at least one size, each smaller than the one before",
            ));
        }
        let at_least = |key, value: usize, least: usize, why: &str| {
            if value >= least {
                return Ok(value);
            }
            Err(table.error(
                key,
                format!("{key} = {value}"),
                &format!("{least} or more{why}"),
            ))
        };
        Ok(CalibrationSettings {
            voxel_sizes_m,
            neighbours: at_least(
                "neighbours",
                written.neighbours.unwrap_or(default.neighbours),
                4,
                ": three points always lie in a plane",
            )?,
            method: written.method.unwrap_or(default.method),
            max_iterations: at_least(
                "max_iterations",
                written.max_iterations.unwrap_or(default.max_iterations),
                1,
                "",
            )?,
            pass_gap_s: table.positive(
                "pass_gap_s",
                written.pass_gap_s.unwrap_or(default.pass_gap_s),
            )?,
            multi_start_rad: written
                .multi_start_deg
                .map(|deg| {
                    let good = |deg| 0.0 < deg && deg <= 180.0;
                    table.number(
                        "multi_start_deg",
                        deg,
                        good,
                        "an angle above 0 and up to 180",
                    )
                })
                .transpose()?
                .map(f64::to_radians),
        })
    }

    fn comparison(&self, written: &written::Comparison) -> Result<ComparisonSettings> {
        let table = self.table("comparison");
        let default = ComparisonSettings::default();
        let positive =
            |key, value: Option<f64>, default| table.positive(key, value.unwrap_or(default));
        let normal_radii_m = written
            .normal_radii_m
            .clone()
            .unwrap_or(default.normal_radii_m);
        if normal_radii_m.is_empty() {
            return Err(table.error("normal_radii_m", "an empty list", "at least one radius"));
        }
        for &radius in &normal_radii_m {
            table.positive("normal_radii_m", radius)?;
        }
        Ok(ComparisonSettings {
            core_spacing_m: positive(
                "core_spacing_m",
                written.core_spacing_m,
                default.core_spacing_m,
            )?,
            normal_radii_m,
            cylinder_radius_m: positive(
                "cylinder_radius_m",
                written.cylinder_radius_m,
                default.cylinder_radius_m,
            )?,
            max_distance_m: positive(
                "max_distance_m",
                written.max_distance_m,
                default.max_distance_m,
            )?,
            registration_error_m: table.not_negative(
                "registration_error_m",
                written
                    .registration_error_m
                    .unwrap_or(default.registration_error_m),
            )?,
        })
    }
}

/// R_bs of a scanner, from its angles or its quaternion.
fn rotation(
    table: &Table<'_>,
    scanner: &written::Scanner,
    convention: EulerConvention,
) -> Result<Rotation> {
    match (scanner.rotation_deg, scanner.quaternion_xyzw) {
        (Some(angles_deg), None) => {
            table.vector("rotation_deg", angles_deg)?;
            Ok(rotation_from_euler_deg(convention, angles_deg))
        }
        (None, Some([x, y, z, w])) => {
            let quaternion = nalgebra::Quaternion::new(w, x, y, z);
            let off = (quaternion.norm() - 1.0).abs();
            if off.is_nan() || off > QUATERNION_TOLERANCE {
                return Err(table.error(
                    "quaternion_xyzw",
                    format!("a quaternion of length {}", quaternion.norm()),
                    "length 1 (order x, y, z, w)",
                ));
            }
            // What is of unit length to rounding stays as it is, so that printing and reading
            // gives the same bits.
            Ok(if off < 1e-15 {
                Rotation::new_unchecked(quaternion)
            } else {
                Rotation::from_quaternion(quaternion)
            })
        }
        (Some(_), Some(_)) => Err(table.error(
            "quaternion_xyzw",
            "both rotation_deg and quaternion_xyzw",
            "one of the two",
        )),
        (None, None) => Err(table.error(
            "name",
            format!("no rotation of the scanner {:?}", scanner.name),
            "rotation_deg or quaternion_xyzw",
        )),
    }
}
