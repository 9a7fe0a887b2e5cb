//! Mountings from files and into them.

use std::path::PathBuf;

use boresight::geometry::BodyFromScanner;
use boresight::pipeline::{Conversion, mountings_text};
use boresight::{Error, project};
use pyo3::prelude::*;

use crate::arrays::quaternion;
use crate::clouds::whole;
use crate::work::run;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(read_mountings, module)?)?;
    module.add_function(wrap_pyfunction!(write_mountings, module)?)
}

/// Name, quaternion x, y, z, w and translation (metres) of each scanner: body_from_scanner.
type Scanner = (String, [f64; 4], [f64; 3]);

/// The mountings of a project or of a `calibration.toml`.
#[pyfunction]
fn read_mountings(path: PathBuf, listener: &Bound<'_, PyAny>) -> PyResult<Vec<Scanner>> {
    let scanners = run(listener, Some(1), |progress| {
        let mountings = project::mountings(&path)?;
        if mountings.is_unusable {
            progress.warn("this calibration is marked as not usable");
        }
        Ok(mountings.scanners)
    })?;
    let rows = scanners.into_iter().map(|(name, mounting)| {
        let rotation = mounting.rotation.coords.into();
        (name, rotation, mounting.translation_m.into())
    });
    Ok(rows.collect())
}

/// Writes mountings in the format given by the end of the name.
#[pyfunction]
fn write_mountings(
    path: PathBuf,
    scanners: Vec<Scanner>,
    body: String,
    listener: &Bound<'_, PyAny>,
) -> PyResult<()> {
    let scanners: Vec<(String, BodyFromScanner)> = scanners
        .into_iter()
        .map(|(name, rotation, translation_m)| {
            let mounting = BodyFromScanner::new(quaternion(rotation), translation_m.into());
            (name, mounting)
        })
        .collect();
    let with = Conversion {
        body: Some(body),
        ..Conversion::default()
    };
    run(listener, Some(1), |_| {
        whole(&path, |staged| {
            let text = mountings_text(staged, &scanners, &with)?;
            std::fs::write(staged, text).map_err(|error| Error::io(staged, error))
        })
    })
}
