//! Conversion of the project as written to the checked project.

mod estimate;
mod motion;
mod positions;
mod scanners;
mod settings;
mod table;

pub(super) use estimate::AUTO;
pub(super) use positions::arcsec_to_radians;
pub(super) use scanners::{TIME_OFFSET, scanners};
pub use settings::comparison;

use std::path::Path;

use super::checked::{Project, Reference};
use super::source::{Required, Source};
use super::written::{self, Written};
use crate::error::{Error, Result};
use crate::geometry::Projection;
use table::Table;

/// The keys that tables of a project need.
const REQUIRED: [Required; 9] = {
    const fn table(name: &'static str, keys: &'static [&'static [&'static str]]) -> Required {
        Required { name, keys }
    }
    [
        table("imu", &[&["file"]]),
        table("prism", &[&["file"], &["lever_arm_m"]]),
        table("gnss", &[&["file"], &["lever_arm_m"]]),
        table("heading", &[&["file"]]),
        table(
            "scanner",
            &[
                &["name"],
                &["profiles"],
                &["translation_m"],
                &["rotation_deg", "quaternion_xyzw"],
            ],
        ),
        table("reference", &[&["file"]]),
        table("bending", &[&["file"], &["columns"]]),
        table("drive", &[&["name"], &["project"]]),
        table("evaluation", &[&["name"], &["project"]]),
    ]
};

/// Reads a project file, checks it and converts it to SI units.
pub(super) fn read(path: &Path) -> Result<Project> {
    project(&Source::read(path)?)
}

/// Checks the text of a project file and converts it to SI units.
pub(super) fn project(source: &Source) -> Result<Project> {
    let written: &Written = &source.parsed_with(&REQUIRED)?;
    // The reader of the tables does not know that one of two keys is needed.
    let is_open = |scanner: &written::Scanner| {
        scanner.rotation_deg.is_none() && scanner.quaternion_xyzw.is_none()
    };
    if written.scanner.iter().any(is_open) {
        source.refuse_missing(&REQUIRED)?;
    }
    let frame = Table::new(source, "frame");
    let (drives, evaluations) = scanners::other_drives(source, written)?;
    let voxel_sizes_m = settings::voxel_sizes(source, &written.calibration)?;
    Ok(Project {
        path: source.path.clone(),
        axes: written.frame.body.unwrap_or_default(),
        origin_m: written
            .frame
            .origin_m
            .map(|origin_m| frame.vector("origin_m", origin_m))
            .transpose()?,
        crs: crs(&frame, written.frame.crs.as_deref())?,
        motion: motion::motion(source, written)?,
        limits: motion::limits(source, written)?,
        scanners: scanners(source, &written.scanner)?,
        reference: written.reference.as_ref().map(|reference| Reference {
            path: source.absolute(&reference.file),
        }),
        has_auto_scales: voxel_sizes_m.is_none(),
        calibration: settings::calibration(source, &written.calibration, voxel_sizes_m)?,
        is_joint: settings::is_joint(source, written)?,
        joint: settings::joint(source, written)?,
        bending: settings::bending(source, written)?,
        comparison: comparison(source, &written.comparison)?,
        acceptance: settings::acceptance(source, &written.acceptance)?,
        imprint: settings::imprint(source, &written.report)?,
        drives,
        evaluations,
    })
}

/// The projected system of the world.
fn crs(frame: &Table<'_>, name: Option<&str>) -> Result<Option<Projection>> {
    let system = name.map(|name| {
        Projection::new(name).map_err(|error| match error {
            Error::Data {
                problem, remedy, ..
            } => frame.error("crs", problem, &remedy),
            other => other,
        })
    });
    system.transpose()
}
