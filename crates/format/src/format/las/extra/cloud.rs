//! A cloud in memory, written with extra dimensions.

use std::path::Path;

use super::dimension::{ExtraDimension, Row};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::cloud::sink::CloudShape;
use crate::format::las::writer::CloudWriter;
use crate::progress::Progress;

/// Writes the points of `cloud` that `row` accepts as LAS or LAZ, in their order, with time and
/// intensity if the cloud has them and the values of the dimensions, in this coordinate reference
/// system (WKT); returns their number.
/// Coordinates are rounded to [`CLOUD_STEP_M`](crate::format::CLOUD_STEP_M), or to the smallest
/// power of ten for which 32 bits span the cloud. `progress` advances by one for each point; the
/// caller begins and ends the stage.
///
/// # Errors
/// Names that LAS does not allow, an output that cannot be written, errors of `row`.
pub fn cloud_to_las(
    cloud: &PointCloud,
    output: &Path,
    dimensions: &[ExtraDimension],
    wkt: Option<String>,
    row: &mut Row<'_>,
    progress: &dyn Progress,
) -> Result<u64> {
    let shape = CloudShape {
        dimensions: dimensions.to_vec(),
        ..CloudShape::of(cloud, wkt)
    };
    let mut writer = CloudWriter::spanning(output, &shape)?;
    let mut values = vec![f64::NAN; dimensions.len()];
    let mut written = 0;
    for (at, point) in cloud.points.iter().enumerate() {
        values.fill(f64::NAN);
        if row(at as u64, &mut values)? {
            let time_s = cloud.time_s.get(at).copied().unwrap_or(0.0);
            let intensity = cloud.intensity.get(at).copied().unwrap_or(0.0);
            writer.write_with(point, time_s, intensity, 0, &values)?;
            written += 1;
        }
        if at % 65_536 == 65_535 {
            progress.advance(65_536);
            progress.check()?;
        }
    }
    progress.advance(cloud.points.len() as u64 % 65_536);
    writer.finish()?;
    Ok(written)
}
