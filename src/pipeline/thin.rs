//! `boresight thin`: thins a cloud to one point per voxel.

use std::path::Path;

use serde_json::json;

use super::{Options, Outcome};
use crate::error::{Error, Result};
use crate::format;
use crate::progress::Progress;
use crate::tiles::{self, peak_memory_bytes};

/// Writes the points of `cloud` that [`tiles::thin`] keeps with voxels of `voxel_m` (metres,
/// positive) to `<name>-thinned.laz`.
///
/// # Errors
/// A cloud that cannot be read, a folder that cannot be written.
pub fn thin(
    cloud: &Path,
    voxel_m: f64,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    // A missing cloud must not leave a new folder behind.
    if let Err(missing @ Error::Io { .. }) = format::detect(cloud) {
        return Err(missing);
    }
    let stem = cloud.file_stem().unwrap_or_default().to_string_lossy();
    let name = format!("{stem}-thinned.laz");
    let staging = options.staging(&[cloud.to_owned()], &[&name])?;
    let work = tiles::thin(cloud, voxel_m, &staging.path(&name), progress)?;
    staging.commit()?;
    let seconds = |seconds: f64| json!({ "seconds": seconds });
    let file = options.out.join(name);
    Ok(Outcome {
        result: json!({
            "cloud": file,
            "voxel_m": voxel_m,
            "points": { "read": work.points, "kept": work.kept },
            "stages": {
                "read": seconds(work.read_s),
                "thin": seconds(work.thin_s),
                "write": seconds(work.write_s),
            },
            "peak_memory_bytes": peak_memory_bytes(),
        }),
        summary: format!(
            "{} of {} points kept, one per voxel of {:.3} mm",
            work.kept,
            work.points,
            voxel_m * 1e3
        ),
        files: vec![file],
        ..Outcome::default()
    })
}
