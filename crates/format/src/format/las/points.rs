//! The points of a LAS or LAZ file, decoded on all threads.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::cloud::gathering::gaps;
use crate::format::cloud::names::viewpoint_columns;
use crate::format::cloud::viewpoints::Viewpoints;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::las::columns::extra_columns;
use crate::format::las::file::{LasFile, LasPoint};
use crate::geometry::Vec3;

/// Points decoded by one thread at a time: several of the format's chunks of 50,000, so that few
/// points are decoded only to reach the first of them.
const PART: u64 = 500_000;

/// Number of points according to the header of a LAS or LAZ file.
///
/// # Errors
/// A file that is missing, damaged, of another format, or without points.
pub fn las_count(input: impl Into<Input>) -> Result<u64> {
    let input = &input.into();
    count_of(&LasFile::open(input)?)
}

fn count_of(file: &LasFile) -> Result<u64> {
    match file.header().number_of_points() {
        0 => Err(nothing_in(file.path(), "point")),
        count => Ok(count),
    }
}

/// What is said about a LAS or LAZ file before its points are used as metres.
///
/// # Errors
/// As [`las_count`]; coordinates that are latitudes and longitudes.
pub fn las_remarks(input: impl Into<Input>) -> Result<Vec<String>> {
    let input = &input.into();
    let file = LasFile::reopen(input)?;
    if file.is_geographic() {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            "latitudes and longitudes (the coordinate system of the file)",
            "lengths: project the cloud first, for example with PDAL's filters.reprojection",
        ));
    }
    Ok(file.remarks())
}

/// Calls `each` with the points of a LAS or LAZ file (metres), in order, in pieces of at most
/// 500,000. Memory holds one piece per thread.
///
/// # Errors
/// As [`las_count`]; errors of `each`.
pub fn stream_las(
    input: impl Into<Input>,
    each: &mut dyn FnMut(&[Vec3]) -> Result<()>,
) -> Result<()> {
    let input = &input.into();
    let file = LasFile::open(input)?;
    let count = count_of(&file)?;
    if !file.can_seek() {
        return stream_in_order(file, count, each);
    }
    let parts = count.div_ceil(PART);
    let at_once = rayon::current_num_threads() as u64;
    for first in (0..parts).step_by(at_once as usize) {
        let batch = first..parts.min(first + at_once);
        let pieces = read_parts(input, batch, count, Vec::with_capacity, |points, point| {
            points.push(point.position);
        })?;
        pieces.iter().try_for_each(|piece| each(piece))?;
    }
    Ok(())
}

/// The places from which the points of a LAS or LAZ file were seen (metres), by its extra dimensions; empty if it has none
/// for them.
///
/// # Errors
/// As [`las_count`].
pub fn las_viewpoints(input: impl Into<Input>) -> Result<Vec<Vec3>> {
    let input = &input.into();
    let mut file = LasFile::open(input)?;
    let count = count_of(&file)?;
    let columns = extra_columns(&file);
    let names: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    // Extra dimensions of a file in feet are in a unit that it does not state.
    let place = viewpoint_columns(&names).filter(|_| file.converted().is_none());
    let Some(place) = place.map(|place| place.map(|at| columns[at].1)) else {
        return Ok(Vec::new());
    };
    let take = |places: &mut Viewpoints, point: LasPoint<'_>| {
        places.add(Vec3::from(
            place.map(|column| column.value(point.extra).number()),
        ));
    };
    let mut all = Viewpoints::default();
    if !file.can_seek() {
        read_until(&mut file, count, &mut all, take)?;
        return Ok(all.into_places());
    }
    let parts = read_parts(
        input,
        0..count.div_ceil(PART),
        count,
        |_| Viewpoints::default(),
        take,
    )?;
    let places = parts.into_iter().flat_map(Viewpoints::into_places);
    places.for_each(|place| all.add(place));
    Ok(all.into_places())
}

/// The points of a LAS or LAZ file with intensity, and with time if the file has it.
pub(crate) fn read_las(input: &Input) -> Result<PointCloud> {
    let mut file = LasFile::open(input)?;
    let count = count_of(&file)?;
    let has_time = file.has_time();
    let empty = |most| PointCloud {
        points: Vec::with_capacity(most),
        time_s: Vec::new(),
        intensity: Vec::with_capacity(most),
    };
    let take = |cloud: &mut PointCloud, point: LasPoint<'_>| {
        cloud.points.push(point.position);
        cloud.intensity.push(point.intensity);
        if has_time {
            cloud.time_s.push(point.time_s);
        }
    };
    for remark in file.remarks() {
        input.remark(remark);
    }
    let mut cloud = empty(count as usize);
    if !file.can_seek() {
        read_until(&mut file, count, &mut cloud, take)?;
    } else {
        let parts = read_parts(input, 0..count.div_ceil(PART), count, empty, take)?;
        for part in parts {
            cloud.points.extend(part.points);
            cloud.time_s.extend(part.time_s);
            cloud.intensity.extend(part.intensity);
        }
    }
    gaps(&cloud).into_iter().for_each(|gap| input.remark(gap));
    cloud.forget_absent();
    Ok(cloud)
}

/// As [`stream_las`], on one thread, for a file in which the decoder cannot seek.
fn stream_in_order(
    mut file: LasFile,
    count: u64,
    each: &mut dyn FnMut(&[Vec3]) -> Result<()>,
) -> Result<()> {
    let mut points = Vec::new();
    while file.taken() < count {
        points.clear();
        let end = count.min(file.taken() + CHUNK_POINTS as u64);
        read_until(&mut file, end, &mut points, |points, point| {
            points.push(point.position);
        })?;
        each(&points)?;
    }
    Ok(())
}

fn cut_off(path: &Path, found: u64, count: u64) -> Error {
    Error::format(
        path,
        Location::Whole,
        format!("{found} points"),
        format!("the {count} points of its header"),
    )
}

/// Decodes several parts of a file of `count` points in parallel, each of [`PART`] points: `empty`
/// makes the result of a part for the number of its points, and `take` adds the points in order.
fn read_parts<T: Send>(
    input: &Input,
    parts: Range<u64>,
    count: u64,
    empty: impl Fn(usize) -> T + Sync,
    take: impl Fn(&mut T, LasPoint<'_>) + Sync,
) -> Result<Vec<T>> {
    let read_part = |part| {
        let (start, end) = (part * PART, count.min((part + 1) * PART));
        let mut file = LasFile::reopen(input)?;
        if start > 0 {
            file.seek(start)?;
        }
        let mut part = empty((end - start) as usize);
        read_until(&mut file, end, &mut part, &take)?;
        Ok(part)
    };
    parts.into_par_iter().map(read_part).collect()
}

/// Decodes the points before number `end`; `take` adds them to `into` in order.
fn read_until<T>(
    file: &mut LasFile,
    end: u64,
    into: &mut T,
    take: impl Fn(&mut T, LasPoint<'_>),
) -> Result<()> {
    while file.taken() < end {
        let left = (end - file.taken()) as usize;
        let read = file.read(left.min(CHUNK_POINTS), |_, point| {
            take(into, point);
            Ok(())
        })?;
        if read == 0 {
            let count = file.header().number_of_points();
            return Err(cut_off(file.path(), file.taken(), count));
        }
    }
    Ok(())
}
