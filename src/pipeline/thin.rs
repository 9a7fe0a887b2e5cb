//! One point a voxel of a cloud on disk, which may be larger than memory.

use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::json;

use super::{Options, Outcome, peak_memory_bytes};
use crate::cloud::PointCloud;
use crate::cloud::voxel::{self, Thinner};
use crate::error::{Error, Result};
use crate::format::{self, Format};
use crate::output::Staging;
use crate::progress::Progress;

/// What is kept of a cloud, and what that took.
struct Thinned {
    /// The cloud, where it is no LAS or LAZ file and had to be read whole.
    cloud: Option<PointCloud>,
    /// Number of points.
    count: u64,
    /// Indices of the points that are kept, ascending.
    kept: Vec<u64>,
    /// Time of the reading.
    read: Duration,
    /// Time of the thinning.
    thin: Duration,
}

/// Writes the points of `cloud` that [`voxel::thin`] keeps on voxels of the edge `voxel_m` (metres,
/// positive) as `<name>-thinned.laz`, in their order. Points of a LAS or LAZ file keep everything
/// they carry, bit by bit; such a file may be larger than memory, because no more of it is held
/// than twice what is kept ([`Thinner`]). It is read twice.
///
/// # Errors
/// A cloud that cannot be read, a folder that cannot be written.
pub fn thin(
    cloud: &Path,
    voxel_m: f64,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let stem = cloud.file_stem().unwrap_or_default().to_string_lossy();
    let name = format!("{stem}-thinned.laz");
    let staging = Staging::new(&options.out, &[cloud.to_owned()], &[&name])?;
    let is_las = match format::detect(cloud) {
        Ok(found) => matches!(found, Format::Las | Format::Laz),
        Err(missing @ Error::Io { .. }) => return Err(missing),
        // The reader says what is wrong.
        Err(_) => false,
    };
    let thinned = if is_las {
        thin_las(cloud, voxel_m, progress)?
    } else {
        thin_in_memory(cloud, voxel_m, progress)?
    };
    let start = Instant::now();
    write(cloud, &thinned, &staging.path(&name), progress)?;
    let written = start.elapsed();
    staging.commit()?;
    let (before, after) = (thinned.count, thinned.kept.len());
    let seconds = |time: Duration| json!({ "seconds": time.as_secs_f64() });
    let file = options.out.join(name);
    Ok(Outcome {
        result: json!({
            "cloud": file,
            "voxel_m": voxel_m,
            "points": { "read": before, "kept": after },
            "stages": {
                "read": seconds(thinned.read),
                "thin": seconds(thinned.thin),
                "write": seconds(written),
            },
            "peak_memory_bytes": peak_memory_bytes(),
        }),
        summary: format!(
            "{after} of {before} points kept, one for each voxel of {:.3} mm",
            voxel_m * 1e3
        ),
        files: vec![file],
    })
}

fn thin_las(path: &Path, voxel_m: f64, progress: &dyn Progress) -> Result<Thinned> {
    let count = format::las_count(path)?;
    let mut thinner = Thinner::new(voxel_m);
    let mut thin = Duration::ZERO;
    progress.begin("reading and thinning", count);
    let start = Instant::now();
    let read = format::stream_las(path, &mut |points| {
        thinner.add(points);
        if thinner.is_full() {
            let start = Instant::now();
            thinner.thin();
            thin += start.elapsed();
        }
        progress.advance(points.len() as u64);
        Ok(())
    });
    let until_last = start.elapsed();
    let thinned = read.map(|()| {
        let kept = thinner.finish();
        Thinned {
            cloud: None,
            count,
            kept,
            read: until_last - thin,
            thin: thin + (start.elapsed() - until_last),
        }
    });
    progress.end();
    thinned
}

fn thin_in_memory(path: &Path, voxel_m: f64, progress: &dyn Progress) -> Result<Thinned> {
    progress.begin("reading and thinning", 0);
    let start = Instant::now();
    let thinned = format::read_cloud(path).map(|cloud| {
        let read = start.elapsed();
        let kept = voxel::thin(&cloud.points, voxel_m);
        Thinned {
            count: cloud.points.len() as u64,
            kept: kept.into_iter().map(u64::from).collect(),
            cloud: Some(cloud),
            read,
            thin: start.elapsed() - read,
        }
    });
    progress.end();
    thinned
}

fn write(from: &Path, thinned: &Thinned, to: &Path, progress: &dyn Progress) -> Result<()> {
    let mut kept = thinned.kept.iter().copied().peekable();
    let mut is_kept = |index: u64, _: &mut [f64]| Ok(kept.next_if_eq(&index).is_some());
    progress.begin("writing", thinned.count);
    let written = match &thinned.cloud {
        Some(cloud) => format::cloud_to_las(cloud, to, &[], &mut is_kept, progress),
        None => format::copy_las(from, to, &[], &mut is_kept, progress),
    };
    progress.end();
    written.map(drop)
}
