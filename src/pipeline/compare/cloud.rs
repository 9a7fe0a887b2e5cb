//! A comparison as a cloud of its core points.

use std::path::Path;

use super::columns::COLUMNS;
use crate::cloud::PointCloud;
use crate::comparison::M3c2;
use crate::error::Result;
use crate::format::{self, ExtraDimension};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Writes the core points in their order, with the results as extra dimensions; NaN if a result is
/// unknown. `reference` gives the coordinate reference system, in whose unit the points are written.
pub(super) fn write(
    path: &Path,
    distances: &M3c2,
    reference: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let wkt = format::crs_wkt(reference)?;
    let unit_m = format::unit_m(reference)?.unwrap_or(Vec3::repeat(1.0));
    let points = distances.core.iter();
    let points = points.map(|core| core.point.component_div(&unit_m));
    let cloud = PointCloud {
        points: points.collect(),
        ..PointCloud::default()
    };
    let dimensions = COLUMNS.map(|c| ExtraDimension::new(c.name, c.kind, c.text));
    let _stage = progress.stage("writing the core points", cloud.points.len() as u64);
    let mut row = |index: u64, values: &mut [f64]| {
        let core = &distances.core[index as usize];
        for (value, column) in values.iter_mut().zip(&COLUMNS) {
            *value = (column.value)(core);
        }
        Ok(true)
    };
    format::cloud_to_las(&cloud, path, &dimensions, wkt, &mut row, progress).map(drop)
}
