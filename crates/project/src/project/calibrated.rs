//! Mountings and poses from an earlier run.

use std::path::Path;

use super::checked::{Motion, PosesFile, Project, Scanner};
use super::resolve;
use super::source::Source;
use super::written::Mountings;
use crate::error::{Error, Location, Result};

/// See [`Project::calibrated_scanners`].
pub(super) fn scanners(project: &Project, path: &Path) -> Result<Vec<Scanner>> {
    if path.is_dir() {
        let expected = "a file of [[scanner]] tables, such as `calibration.toml` in it";
        return Err(Error::format(path, Location::Whole, "a folder", expected));
    }
    let source = &Source::read(path)?;
    let written: Mountings = source.parsed()?;
    let calibrated = resolve::scanners(source, &written.scanner)?;
    let with_values = |scanner: &Scanner| {
        let Some(same) = calibrated.iter().find(|s| s.name == scanner.name) else {
            let names: Vec<String> = calibrated.iter().map(|s| format!("`{}`", s.name)).collect();
            let only = if names.is_empty() {
                "no scanners".to_owned()
            } else {
                format!("only {}", names.join(", "))
            };
            return Err(source.error(
                &[],
                format!("{only}, not `{}`", scanner.name),
                &format!(
                    "a [[scanner]] table for every scanner of {}",
                    project.path.display()
                ),
            ));
        };
        Ok(Scanner {
            body_from_scanner: same.body_from_scanner,
            convention: same.convention,
            time_offset_s: same.time_offset_s,
            compliance: same.compliance,
            ..scanner.clone()
        })
    };
    project.scanners.iter().map(with_values).collect()
}

/// See [`super::mountings`].
pub(super) fn mountings(path: &Path) -> Result<super::Mountings> {
    let source = &Source::read(path)?;
    let tables: toml::Table = source.parsed()?;
    let (scanners, axes) = if tables.keys().all(|key| key == "scanner") {
        let written: Mountings = source.parsed()?;
        (resolve::scanners(source, &written.scanner)?, None)
    } else {
        let project = Project::read(path)?;
        (project.scanners, Some(project.axes))
    };
    if scanners.is_empty() {
        return Err(source.error(&[], "no scanner", "[[scanner]] tables"));
    }
    let mounting = |scanner: Scanner| (scanner.name, scanner.body_from_scanner);
    Ok(super::Mountings {
        scanners: scanners.into_iter().map(mounting).collect(),
        axes,
        is_unusable: source.begins_with("# not usable"),
    })
}

/// See [`Project::with_trajectory`].
pub(super) fn with_trajectory(project: &Project, path: &Path) -> Result<Project> {
    let path = std::path::absolute(path).map_err(|source| Error::io(path, source))?;
    Ok(Project {
        motion: Motion::Poses(PosesFile {
            path,
            others: Vec::new(),
            time_offset_s: 0.0,
            sigma_position_m: None,
            sigma_rotation_rad: None,
        }),
        ..project.clone()
    })
}
