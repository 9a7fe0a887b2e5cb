//! Constants estimated together with the trajectory.

use super::table::Table;
use crate::error::Result;
use crate::project::source::nearest;
use crate::trajectory::{Constant, PositionKind, PositionSettings};

/// For constants: those that the drive contradicts are estimated. For scales: they follow from the points.
pub(in crate::project) const AUTO: &str = "auto";

/// The names listed in `estimate`; `None` for `"auto"`, which is also the default.
pub(super) fn listed(
    table: &Table<'_>,
    written: Option<&toml::Value>,
) -> Result<Option<Vec<String>>> {
    let expected = format!("\"{AUTO}\" or a list of constants such as [\"prism.lever_arm\"]");
    let wrong =
        |found: &toml::Value| table.error("estimate", format!("estimate = {found}"), &expected);
    match written {
        None => Ok(None),
        Some(toml::Value::String(word)) if word == AUTO => Ok(None),
        Some(toml::Value::Array(names)) => names
            .iter()
            .map(|name| name.as_str().map(str::to_owned).ok_or_else(|| wrong(name)))
            .collect::<Result<Vec<_>>>()
            .map(Some),
        Some(other) => Err(wrong(other)),
    }
}

/// The constants listed in `estimate`, in that order, without repetition.
pub(super) fn constants(
    table: &Table<'_>,
    names: &[String],
    positions: &[PositionSettings],
    has_heading: bool,
) -> Result<Vec<Constant>> {
    let all = all_constants(positions);
    let known: Vec<String> = all.iter().map(|c| c.name(positions)).collect();
    let mut listed = Vec::new();
    for name in names {
        let error = |found: String, expected: &str| table.error("estimate", found, expected);
        let Some(index) = known.iter().position(|known| known == name) else {
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            let near = nearest(name, &known).unwrap_or_default();
            return Err(error(
                format!("the unknown constant `{name}`"),
                &format!("`{near}` (constants: {})", known.join(", ")),
            ));
        };
        let constant = all[index];
        if listed.contains(&constant) {
            return Err(error(format!("`{name}` twice"), "each constant once"));
        }
        let of_heading = matches!(
            constant,
            Constant::HeadingOffset | Constant::HeadingTimeOffset
        );
        if of_heading && !has_heading {
            return Err(error(
                format!("`{name}` without [heading]"),
                "a [heading] log",
            ));
        }
        if let Constant::IncidenceBias(index) = constant
            && positions[index].station_m.is_none()
        {
            return Err(error(
                format!("`{name}` without a line of sight"),
                &format!(
                    "station_m of `{}`, the position of its total station",
                    positions[index].name
                ),
            ));
        }
        listed.push(constant);
    }
    Ok(listed)
}

/// All constants of a project with these position sensors.
fn all_constants(positions: &[PositionSettings]) -> Vec<Constant> {
    let mut all = Vec::new();
    for (index, settings) in positions.iter().enumerate() {
        let times = [Constant::TimeOffset(index), Constant::TimeDrift(index)];
        all.extend(times.into_iter().chain([Constant::LeverArm(index)]));
        if settings.kind == PositionKind::Prism {
            all.push(Constant::IncidenceBias(index));
        }
    }
    all.extend([
        Constant::HeadingOffset,
        Constant::HeadingTimeOffset,
        Constant::Gravity,
        Constant::GyroScale,
        Constant::ImuNoiseScale,
    ]);
    all
}
