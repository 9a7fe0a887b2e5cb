//! Checks of scanners and other drives, and of their names.

use super::table::Table;
use crate::calibration::PARAMETER_NAMES;
use crate::error::Result;
use crate::format::PointTimes;
use crate::geometry::euler::rotation_from_euler_deg;
use crate::geometry::{BodyFromScanner, EulerConvention, Rotation};
use crate::joint::{COMPLIANCE, Compliance};
use crate::project::checked::{OtherDrive, Scanner};
use crate::project::source::{Source, Step, nearest};
use crate::project::units::TimeUnit;
use crate::project::written::{self, Written};

/// The constant of a scanner that can be estimated besides its mounting.
pub(in crate::project) const TIME_OFFSET: &str = "time_offset";

/// More scanners than any platform carries. The limit bounds the number of parameters that are estimated together.
const MAX_SCANNERS: usize = 1000;

/// The scanners, with unique names.
pub(in crate::project) fn scanners(
    source: &Source,
    written: &[written::Scanner],
) -> Result<Vec<Scanner>> {
    if written.len() > MAX_SCANNERS {
        return Err(source.error(
            &[Step::Key("scanner"), Step::Index(MAX_SCANNERS)],
            format!("{} scanners", written.len()),
            "1000 at most",
        ));
    }
    let names: Vec<&str> = written.iter().map(|s| s.name.as_str()).collect();
    check_names(source, "scanner", &names)?;
    let scanners = written.iter().enumerate();
    let scanners: Vec<Scanner> = scanners
        .map(|(index, scanner)| checked(source, index, scanner))
        .collect::<Result<_>>()?;
    let loads = || {
        scanners
            .iter()
            .filter_map(|s| Some(s.compliance?.mean_load))
    };
    let first = loads().next();
    if loads().any(|load| Some(load) != first) {
        return Err(source.error(
            &[Step::Key("scanner")],
            "reference_load_g that differ from scanner to scanner",
            "the tables of one calibration.toml",
        ));
    }
    Ok(scanners)
}

fn checked(source: &Source, index: usize, scanner: &written::Scanner) -> Result<Scanner> {
    let table = Table {
        index: Some(index),
        ..Table::new(source, "scanner")
    };
    if scanner.profiles.0.is_empty() {
        return Err(table.error("profiles", "an empty list", "at least one file"));
    }
    let convention = scanner.rotation_convention.unwrap_or_default();
    let rotation = rotation(&table, scanner, convention)?;
    let translation_m = table.on_body("translation_m", scanner.translation_m)?;
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
    let mut estimate_time_offset = false;
    for name in scanner.estimate.iter().flatten() {
        if name != TIME_OFFSET {
            return Err(table.error(
                "estimate",
                format!("the unknown constant `{name}`"),
                &format!(
                    "`{TIME_OFFSET}`; parameters of the mounting are estimated unless `fixed`"
                ),
            ));
        }
        if estimate_time_offset {
            return Err(table.error("estimate", format!("`{name}` twice"), "each constant once"));
        }
        estimate_time_offset = true;
    }
    Ok(Scanner {
        name: scanner.name.clone(),
        profiles: scanner
            .profiles
            .0
            .iter()
            .map(|file| source.absolute(file))
            .collect(),
        time_offset_s: table.finite("time_offset_s", scanner.time_offset_s)?,
        point_times: PointTimes {
            field: scanner.point_time_field.clone(),
            unit_s: scanner.point_time_unit.map(TimeUnit::length_s),
        },
        estimate_time_offset,
        body_from_scanner: BodyFromScanner::new(rotation, translation_m),
        convention,
        fixed,
        compliance: scanner
            .compliance
            .as_ref()
            .map(|written| compliance(&table, written))
            .transpose()?,
    })
}

/// The compliance in radians and metres: (δφ, δp) for each load in turn.
fn compliance(table: &Table<'_>, written: &written::Compliance) -> Result<Compliance> {
    let flat = |turn_deg: &[[f64; 4]; 3], shift_m: &[[f64; 4]; 3]| -> Result<[f64; COMPLIANCE]> {
        let mut all = [0.0; COMPLIANCE];
        for (i, value) in all.iter_mut().enumerate() {
            let (load, row) = (i / 6, i % 6);
            *value = match row {
                0..3 => turn_deg[row][load].to_radians(),
                _ => shift_m[row - 3][load],
            };
            table.finite("compliance", Some(*value))?;
        }
        Ok(all)
    };
    Ok(Compliance {
        by_load: flat(&written.turn_deg_per_g, &written.shift_m_per_g)?,
        sigma: flat(&written.sigma_turn_deg_per_g, &written.sigma_shift_m_per_g)?,
        mean_load: written.reference_load_g,
    })
}

/// The drives that are adjusted with this one and the drives that are evaluated, with unique names.
pub(super) fn other_drives(
    source: &Source,
    written: &Written,
) -> Result<(Vec<OtherDrive>, Vec<OtherDrive>)> {
    let (drives, evaluations) = (&written.drive, &written.evaluation);
    for (array, others) in [("drive", drives), ("evaluation", evaluations)] {
        let names: Vec<&str> = others.iter().map(|other| other.name.as_str()).collect();
        check_names(source, array, &names)?;
    }
    for (index, evaluation) in evaluations.iter().enumerate() {
        let name = evaluation.name.to_lowercase();
        if drives.iter().any(|drive| drive.name.to_lowercase() == name) {
            let table = Table {
                index: Some(index),
                ..Table::new(source, "evaluation")
            };
            let found = format!("the name {:?}, which is that of a drive", evaluation.name);
            return Err(table.error("name", found, "a unique name"));
        }
    }
    let checked = |others: &[written::OtherDrive]| {
        let others = others.iter().map(|other| OtherDrive {
            name: other.name.clone(),
            project: source.absolute(&other.project),
        });
        others.collect()
    };
    Ok((checked(drives), checked(evaluations)))
}

/// Checks names, which become file names and keys of the result: they must be valid for both, and unique
/// even in file systems that ignore case.
fn check_names(source: &Source, array: &str, names: &[&str]) -> Result<()> {
    let lower: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
    // A name `a-b` is a pair if `a` and `b` are names, too.
    let is_pair = |name: &str| {
        let rests = lower
            .iter()
            .filter_map(|a| name.strip_prefix(a.as_str())?.strip_prefix('-'));
        rests
            .into_iter()
            .any(|b| lower.iter().any(|name| name == b))
    };
    for (index, name) in names.iter().enumerate() {
        let table = Table {
            index: Some(index),
            ..Table::new(source, array)
        };
        check_letters(&table, name, ", as it becomes part of file names")?;
        if lower[..index].contains(&lower[index]) {
            return Err(table.error("name", format!("the name {name:?} twice"), "a unique name"));
        }
        if lower[index] == "initial" || array == "scanner" && is_pair(&lower[index]) {
            return Err(table.error(
                "name",
                format!("the name {name:?}, which is reserved for the results"),
                "another name",
            ));
        }
    }
    Ok(())
}

/// Checks that a name is short and contains no characters with a special meaning.
pub(super) fn check_letters(table: &Table<'_>, name: &str, reason: &str) -> Result<()> {
    let is_allowed = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    if !name.is_empty() && name.chars().count() <= 64 && name.chars().all(is_allowed) {
        return Ok(());
    }
    Err(table.error(
        "name",
        format!("the name {name:?}"),
        &format!("1 to 64 letters, digits, `-` or `_`{reason}"),
    ))
}

/// Largest deviation from length 1 due to rounding to four digits.
const QUATERNION_TOLERANCE: f64 = 1e-3;

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
            // If the length is 1 up to rounding, the quaternion is kept, so that printing and
            // reading gives the same bits.
            Ok(if off < 1e-12 {
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
