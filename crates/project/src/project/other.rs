//! Other drives of a project.

use super::checked::{OtherDrive, Project};
use super::resolve;
use crate::error::{Error, Result};

/// See [`OtherDrive::read`].
pub(super) fn read(drive: &OtherDrive, own: &Project) -> Result<Project> {
    let other = resolve::read(&drive.project)?;
    let mut scanners = Vec::new();
    for scanner in &own.scanners {
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
        calibration: own.calibration.clone(),
        has_auto_scales: own.has_auto_scales,
        comparison: own.comparison.clone(),
        origin_m: own.origin_m,
        limits: other.limits.or(own.limits),
        ..other
    })
}
