//! From the project as typed to the project as checked.

mod estimate;
mod motion;
mod positions;
mod scanners;
mod settings;
mod table;

pub(super) use positions::arcsec_to_radians;

use std::path::Path;

use super::checked::{Project, Reference};
use super::source::Source;
use crate::error::Result;
use table::Table;

/// Reads a project file, checks it and brings it into SI units.
pub(super) fn read(path: &Path) -> Result<Project> {
    let source = &Source::read(path)?;
    let written = &source.written()?;
    let frame = Table::new(source, "frame");
    Ok(Project {
        path: source.path.clone(),
        axes: written.frame.body.unwrap_or_default(),
        origin_m: frame.vector("origin_m", written.frame.origin_m.unwrap_or_default())?,
        motion: motion::motion(source, written)?,
        limits: motion::limits(source, written)?,
        scanners: scanners::scanners(source, &written.scanner)?,
        reference: written.reference.as_ref().map(|reference| Reference {
            path: source.absolute(&reference.file),
        }),
        calibration: settings::calibration(source, &written.calibration)?,
        comparison: settings::comparison(source, &written.comparison)?,
        evaluations: scanners::evaluations(source, &written.evaluation)?,
    })
}
