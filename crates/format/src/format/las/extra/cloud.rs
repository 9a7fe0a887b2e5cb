//! A cloud in memory, written with extra dimensions.

use std::path::Path;

use super::dimension::{ExtraDimension, Row};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::cloud::sink::CloudShape;
use crate::format::las::losses::LasLosses;
use crate::format::las::value::ExtraValue;
use crate::format::las::writer::CloudWriter;
use crate::progress::Progress;

/// Writes the points of `cloud` that `row` accepts as LAS or LAZ, in their order, with time and
/// intensity if the cloud has them and the values of the dimensions, in this coordinate reference
/// system (WKT); returns their number.
/// Coordinates are rounded to [`CLOUD_STEP_M`](crate::format::CLOUD_STEP_M). `progress` advances by
/// one for each point; the caller begins and ends the stage.
///
/// # Errors
/// A point that this step does not reach from the middle of the cloud; names that LAS does not allow, an output that cannot be written, errors of `row`.
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
    let mut stored = Vec::with_capacity(dimensions.len());
    let mut losses = LasLosses::default();
    let mut written = 0;
    for (at, point) in cloud.points.iter().enumerate() {
        values.fill(f64::NAN);
        if row(at as u64, &mut values)? {
            let time_s = cloud.time_s.get(at).copied().unwrap_or(0.0);
            let intensity = cloud.intensity.get(at).copied().unwrap_or(0.0);
            let (time_s, intensity) = losses.filled(time_s, intensity);
            stored.clear();
            stored.extend(values.iter().map(|value| ExtraValue::Number(*value)));
            writer.write_with(point, time_s, intensity, 0, &stored)?;
            written += 1;
        }
        if at % 65_536 == 65_535 {
            progress.advance(65_536);
            progress.check()?;
        }
    }
    progress.advance(cloud.points.len() as u64 % 65_536);
    writer.finish()?;
    losses.warn(progress);
    Ok(written)
}
