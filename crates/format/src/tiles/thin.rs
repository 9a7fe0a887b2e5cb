//! Thinning of clouds that may be larger than memory.

use std::path::Path;
use std::time::{Duration, Instant};

use super::source::CloudSource;
use super::stage::stage;
use crate::cloud::voxel::Thinner;
use crate::error::Result;
use crate::progress::Progress;

/// The result of thinning, and the times of its stages.
#[derive(Debug, Clone, Copy)]
pub struct Thinned {
    /// Number of points read.
    pub points: u64,
    /// Number of points kept.
    pub kept: usize,
    /// Time to read, seconds.
    pub read_s: f64,
    /// Time to thin, seconds.
    pub thin_s: f64,
    /// Time to write, seconds.
    pub write_s: f64,
}

/// Writes the points of the file `cloud` that [`crate::cloud::voxel::thin`] keeps on voxels of edge
/// `voxel_m` (metres, positive) to `output` (LAS or LAZ), in their order. Points of a LAS or LAZ
/// file keep all their fields bit by bit; such a file may be larger than memory, because at most
/// twice the points kept are held ([`Thinner`]). It is read twice.
///
/// # Errors
/// A cloud that cannot be read, or cannot be written as LAS or LAZ.
pub fn thin(cloud: &Path, voxel_m: f64, output: &Path, progress: &dyn Progress) -> Result<Thinned> {
    let start = Instant::now();
    let cloud = CloudSource::open(cloud, progress)?;
    let mut thinner = Thinner::new(voxel_m);
    let mut thinning = Duration::ZERO;
    let (kept, _) = stage(progress, "reading and thinning", cloud.len(), || {
        cloud.stream(progress, &mut |points| {
            thinner.add(points);
            if thinner.is_full() {
                let start = Instant::now();
                thinner.thin();
                thinning += start.elapsed();
            }
            Ok(())
        })?;
        let start = Instant::now();
        let kept = thinner.finish();
        thinning += start.elapsed();
        Ok(kept)
    })?;
    let read_s = (start.elapsed() - thinning).as_secs_f64();
    let mut next = kept.iter().copied().peekable();
    let mut is_kept = |index: u64, _: &mut [f64]| Ok(next.next_if_eq(&index).is_some());
    let write_s = cloud.write(output, &[], &mut is_kept, progress)?;
    Ok(Thinned {
        points: cloud.len(),
        kept: kept.len(),
        read_s,
        thin_s: thinning.as_secs_f64(),
        write_s,
    })
}
