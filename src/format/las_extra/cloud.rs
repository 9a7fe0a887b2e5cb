//! A cloud in memory written with dimensions beside its points.

use std::path::Path;

use super::dimension::{ExtraDimension, Row};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::cloud_writer::CloudWriter;
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Writes those points of `cloud` that `row` accepts as LAS or LAZ, in their order, with time and
/// intensity where the cloud has them and the values of `dimensions`; returns how many there are.
/// Coordinates are rounded to [`CLOUD_STEP_M`](crate::format::CLOUD_STEP_M), or to the least power of ten that
/// lets 32 bits span the cloud. `progress` advances by one for each point; the stage is the
/// caller's.
///
/// # Errors
/// Names that LAS cannot hold, an output that cannot be written, what `row` refuses.
pub fn cloud_to_las(
    cloud: &PointCloud,
    output: &Path,
    dimensions: &[ExtraDimension],
    row: &mut Row<'_>,
    progress: &dyn Progress,
) -> Result<u64> {
    let first = cloud.points.first().copied().unwrap_or_default();
    let (low, high) = cloud
        .points
        .iter()
        .fold((first, first), |(low, high): (Vec3, Vec3), point| {
            (low.inf(point), high.sup(point))
        });
    let has_time = !cloud.time_s.is_empty();
    let mut writer = CloudWriter::spanning(output, &low, &high, has_time, dimensions)?;
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
