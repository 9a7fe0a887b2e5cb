//! Clouds from all formats that hold points in space.

use std::path::Path;

use rayon::prelude::*;

use super::las::LasFile;
use super::native::Sheet;
use super::table::{Columns, Lines, Table, numbers};
use super::{CHUNK_POINTS, Format, nothing_in};
use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;

pub(crate) const CLOUD: Columns = Columns {
    needed: &["east_m", "north_m", "up_m"],
    optional: &["time_s", "intensity", "scanner"],
};

/// Reads a cloud: the native table, plain lines of x y z, LAS, LAZ, PLY, PCD, E57, PTS, PTX or
/// NumPy `.npy` of shape (n, 3). Points that a format marks as not measured are left out; times
/// and intensities are kept where the format has them for every point.
///
/// # Errors
/// A file that is missing, damaged, of another format, without any point, or with 2³² and more.
pub fn read_cloud(path: &Path) -> Result<PointCloud> {
    // Unknown tables are handed on as well: their reader names the column that is missing.
    let cloud = match super::detect(path).unwrap_or(Format::CloudCsv) {
        Format::Las | Format::Laz => read_las(path),
        Format::Ply => super::ply::read(path),
        Format::Pcd => super::pcd::read(path),
        Format::E57 => super::e57::read(path),
        Format::Pts => super::pts::read_pts(path),
        Format::Ptx => super::pts::read_ptx(path),
        Format::Npy => super::npy::read(path),
        Format::CloudCsv
        | Format::PrismCsv
        | Format::ImuCsv
        | Format::HeadingCsv
        | Format::ProfileCsv => read_table(path),
        Format::XyzText => read_xyz(path),
        other => Err(Error::format(
            path,
            Location::Whole,
            other.to_string(),
            "a cloud: LAS, LAZ, PLY, PCD, E57, PTS, PTX, .npy, or text with the columns east_m, \
             north_m, up_m",
        )),
    }?;
    if cloud.points.is_empty() {
        return Err(nothing_in(path, "point"));
    }
    if u32::try_from(cloud.points.len()).is_err() {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{} points", cloud.points.len()),
            format!("{} at most: thin the cloud", u32::MAX),
        ));
    }
    Ok(cloud)
}

/// The number of points that a file names without being read through: LAS and LAZ.
///
/// # Errors
/// A file that is missing or damaged.
pub fn points_named(path: &Path) -> Result<Option<u64>> {
    match super::detect(path) {
        Ok(Format::Las | Format::Laz) => Ok(Some(LasFile::open(path)?.header().number_of_points())),
        // What is wrong with it the reader says better.
        _ => Ok(None),
    }
}

/// Hands the points of a LAS or LAZ file to `each` in chunks and in order, the file never being in
/// memory as a whole. `progress` advances by one for each point; the stage is the caller's.
///
/// # Errors
/// A file that is missing, damaged, of another format, or ends early; what `each` refuses.
pub fn stream_points(
    path: &Path,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&[Vec3]) -> Result<()>,
) -> Result<()> {
    let mut file = LasFile::open(path)?;
    let mut chunk = Vec::with_capacity(CHUNK_POINTS);
    loop {
        chunk.clear();
        let count = file.read(CHUNK_POINTS, |_, point| {
            chunk.push(point.position);
            Ok(())
        })?;
        if count == 0 {
            break;
        }
        each(&chunk)?;
        progress.advance(count);
    }
    let (found, expected) = (file.taken(), file.header().number_of_points());
    if found != expected {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{found} points"),
            format!("the {expected} points of its header"),
        ));
    }
    Ok(())
}

/// Points decoded by one thread: some of the format's chunks of 50,000, so that the way to the
/// first of them is short.
const PART: u64 = 500_000;

/// Reads the parts of a file side by side and joins them in order.
fn read_las(path: &Path) -> Result<PointCloud> {
    let count = LasFile::open(path)?.header().number_of_points();
    let parts: Result<Vec<PointCloud>> = (0..count.div_ceil(PART))
        .into_par_iter()
        .map(|i| read_las_part(path, i * PART, PART.min(count - i * PART)))
        .collect();
    let mut cloud = PointCloud::default();
    for part in parts? {
        cloud.points.extend(part.points);
        cloud.time_s.extend(part.time_s);
        cloud.intensity.extend(part.intensity);
    }
    Ok(cloud)
}

fn read_las_part(path: &Path, start: u64, count: u64) -> Result<PointCloud> {
    let mut file = LasFile::open(path)?;
    if start > 0 {
        file.seek(start)?;
    }
    let mut cloud = PointCloud::default();
    let has_time = file.has_time();
    while file.taken() < start + count {
        let left = (start + count - file.taken()) as usize;
        let read = file.read(left.min(CHUNK_POINTS), |_, point| {
            cloud.points.push(point.position);
            cloud.intensity.push(point.intensity);
            if has_time {
                cloud.time_s.push(point.time_s);
            }
            Ok(())
        })?;
        if read == 0 {
            break;
        }
    }
    Ok(cloud)
}

fn read_table(path: &Path) -> Result<PointCloud> {
    let mut table = Table::open(path, &CLOUD)?;
    let mut cloud = PointCloud::default();
    let mut row = [0.0; 6];
    let has = |name: &str, table: &Table| table.names().iter().any(|other| other == name);
    let (has_time, has_intensity) = (has("time_s", &table), has("intensity", &table));
    while table.next_row(&mut row)? {
        cloud.points.push(Vec3::new(row[0], row[1], row[2]));
        if has_time {
            cloud.time_s.push(row[3]);
        }
        if has_intensity {
            cloud.intensity.push(row[4] as f32);
        }
    }
    Ok(cloud)
}

/// Lines that begin with x y z, all as long as the first.
fn read_xyz(path: &Path) -> Result<PointCloud> {
    let mut lines = Lines::open(path)?;
    let mut cloud = PointCloud::default();
    let mut cells = Vec::new();
    let mut width = 0;
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let numeric = numbers(text, &mut cells) && cells.iter().all(|v| v.is_finite());
        if !numeric || cells.len() < 3 || (width > 0 && cells.len() != width) {
            let found: String = text.chars().take(80).collect();
            let count = width.max(3);
            return Err(lines.error(
                format!("`{found}`"),
                format!("{count} finite numbers, the first of them x y z"),
            ));
        }
        width = cells.len();
        cloud.points.push(Vec3::new(cells[0], cells[1], cells[2]));
    }
    Ok(cloud)
}

/// Writes a cloud as a native table that [`read_cloud`] reads back bit by bit.
///
/// # Errors
/// The file cannot be written.
pub fn write_cloud_table(path: &Path, cloud: &PointCloud) -> Result<()> {
    let with = [!cloud.time_s.is_empty(), !cloud.intensity.is_empty()];
    let mut header = CLOUD.needed.to_vec();
    header.extend(with[0].then_some("time_s"));
    header.extend(with[1].then_some("intensity"));
    let mut sheet = Sheet::create(path, &header)?;
    for (i, p) in cloud.points.iter().enumerate() {
        let time = cloud.time_s.get(i).copied();
        let intensity = cloud.intensity.get(i).map(|v| f64::from(*v));
        sheet.row([p.x, p.y, p.z].into_iter().chain(time).chain(intensity))?;
    }
    sheet.finish()
}
