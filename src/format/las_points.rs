//! The points in a LAS or LAZ file, decoded on all threads.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::file::{CHUNK_POINTS, nothing_in};
use super::las::{LasFile, LasPoint};
use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;

/// Points decoded by one thread at a time: some of the format's chunks of 50,000, so that the way
/// to the first of them is short.
const PART: u64 = 500_000;

/// Number of points that the header of a LAS or LAZ file counts.
///
/// # Errors
/// A file that is missing, damaged, of another format, or without any point.
pub fn las_count(path: &Path) -> Result<u64> {
    match LasFile::open(path)?.header().number_of_points() {
        0 => Err(nothing_in(path, "point")),
        count => Ok(count),
    }
}

/// Hands the points of a LAS or LAZ file (metres) to `each`, in their order, in pieces of 500,000
/// at most. Holds one piece for each thread.
///
/// # Errors
/// As [`las_count`]; what `each` refuses.
pub fn stream_las(path: &Path, each: &mut dyn FnMut(&[Vec3]) -> Result<()>) -> Result<()> {
    let count = las_count(path)?;
    let parts = count.div_ceil(PART);
    let at_once = rayon::current_num_threads() as u64;
    for first in (0..parts).step_by(at_once as usize) {
        let some = first..parts.min(first + at_once);
        let pieces = read_parts(path, some, count, Vec::with_capacity, |points, point| {
            points.push(point.position);
        })?;
        pieces.iter().try_for_each(|piece| each(piece))?;
    }
    Ok(())
}

/// The points of a LAS or LAZ file with intensity, and time where it has that.
pub(crate) fn read_las(path: &Path) -> Result<PointCloud> {
    let count = las_count(path)?;
    let empty = |most| PointCloud {
        points: Vec::with_capacity(most),
        time_s: Vec::new(),
        intensity: Vec::with_capacity(most),
    };
    let parts = read_parts(
        path,
        0..count.div_ceil(PART),
        count,
        empty,
        |cloud, point| {
            cloud.points.push(point.position);
            cloud.intensity.push(point.intensity);
            // Times are finite where there are any.
            if !point.time_s.is_nan() {
                cloud.time_s.push(point.time_s);
            }
        },
    )?;
    let mut cloud = empty(count as usize);
    for part in parts {
        cloud.points.extend(part.points);
        cloud.time_s.extend(part.time_s);
        cloud.intensity.extend(part.intensity);
    }
    Ok(cloud)
}

/// Decodes some parts of a file of `count` points side by side: each begins `empty`, with the
/// number of its points, and `take`s them in order.
fn read_parts<T: Send>(
    path: &Path,
    parts: Range<u64>,
    count: u64,
    empty: impl Fn(usize) -> T + Sync,
    take: impl Fn(&mut T, LasPoint<'_>) + Sync,
) -> Result<Vec<T>> {
    let read_part = |part| {
        let (start, end) = (part * PART, count.min((part + 1) * PART));
        let mut file = LasFile::open(path)?;
        if start > 0 {
            file.seek(start)?;
        }
        let mut found = empty((end - start) as usize);
        while file.taken() < end {
            let left = (end - file.taken()) as usize;
            let read = file.read(left.min(CHUNK_POINTS), |_, point| {
                take(&mut found, point);
                Ok(())
            })?;
            if read == 0 {
                return Err(Error::format(
                    path,
                    Location::Whole,
                    format!("{} points", file.taken()),
                    format!("the {count} points of its header"),
                ));
            }
        }
        Ok(found)
    };
    parts.into_par_iter().map(read_part).collect()
}
