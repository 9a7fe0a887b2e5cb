//! The positions in a LAS or LAZ file, streamed in bounded memory and decoded on all threads.

use std::path::Path;

use rayon::prelude::*;

use super::las::LasFile;
use super::{CHUNK_POINTS, nothing_in};
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
        let pieces: Result<Vec<Vec<Vec3>>> = (first..parts.min(first + at_once))
            .into_par_iter()
            .map(|part| read_part(path, part * PART, PART.min(count - part * PART)))
            .collect();
        pieces?.iter().try_for_each(|piece| each(piece))?;
    }
    Ok(())
}

fn read_part(path: &Path, start: u64, count: u64) -> Result<Vec<Vec3>> {
    let mut file = LasFile::open(path)?;
    if start > 0 {
        file.seek(start)?;
    }
    let mut points = Vec::with_capacity(count as usize);
    while file.taken() < start + count {
        let left = (start + count - file.taken()) as usize;
        let read = file.read(left.min(CHUNK_POINTS), |_, point| {
            points.push(point.position);
            Ok(())
        })?;
        if read == 0 {
            return Err(Error::format(
                path,
                Location::Whole,
                format!("{} points", file.taken()),
                format!("at least {}, as its header says", start + count),
            ));
        }
    }
    Ok(points)
}
