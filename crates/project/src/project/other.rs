//! Other drives of a project.

use super::checked::{OtherDrive, Project};
use super::resolve;
use crate::error::{Error, Result};

/// See [`OtherDrive::read`].
pub(super) fn read(drive: &OtherDrive, main: &Project) -> Result<Project> {
    let other = resolve::read(&drive.project)?;
    let mut scanners = Vec::new();
    for scanner in &main.scanners {
        let mut theirs = other.scanners.iter();
        let same = theirs.find(|candidate| candidate.name == scanner.name);
        scanners.push(same.cloned().ok_or_else(|| {
            Error::data(
                format!("{} has no scanner `{}`", other.path.display(), scanner.name),
                "an evaluation drive needs every scanner of the calibrated project",
            )
        })?);
    }
    Ok(Project {
        scanners,
        calibration: main.calibration.clone(),
        has_auto_scales: main.has_auto_scales,
        comparison: main.comparison.clone(),
        origin_m: main.origin_m,
        limits: other.limits.or(main.limits),
        ..other
    })
}
