//! Readers of each kind of measurement, for every format that holds it.

use std::path::Path;

use super::detect::detect;
use super::file::nothing_in;
use super::kind::Kind;
use super::kinds::KINDS;
use super::profile_reader::ProfileReader;
use super::{cloud_table, native, pose_table, positions, profile};
use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::sensor::{HeadingFix, ImuSample, Observations, PoseRecord, Positions};

/// The reader of what a file holds. A text table that has other columns, or is of no known format, is given
/// to the native `table`'s reader, which names the column that is missing.
///
/// # Errors
/// A file that cannot be opened, or of a format without such measurements.
fn reader<T>(
    path: &Path,
    what: &str,
    of: impl Fn(&Kind) -> Option<T>,
    table: &'static Kind,
) -> Result<T> {
    let kind = match detect(path) {
        Ok(format) => format.0,
        Err(error @ Error::Io { .. }) => return Err(error),
        Err(_) => table,
    };
    let is_table = kind.columns.is_some();
    if let Some(reader) = of(kind).or_else(|| of(table).filter(|_| is_table)) {
        return Ok(reader);
    }
    let names = KINDS.iter().filter(|kind| of(kind).is_some());
    let names: Vec<&str> = names.map(|kind| kind.name).collect();
    let expected = format!("{what}: {}", names.join(", "));
    Err(Error::format(path, Location::Whole, kind.name, expected))
}

/// Reads an IMU log. Rows are returned in the order of the file.
///
/// # Errors
/// A file of another format, and errors of the format's reader.
pub fn read_imu(path: &Path) -> Result<Vec<ImuSample>> {
    reader(path, "an IMU log", |kind| kind.imu, &native::IMU_TABLE)?(path)
}

/// Reads a heading log. Rows are returned in the order of the file.
///
/// # Errors
/// A file of another format, and errors of the format's reader.
pub fn read_heading(path: &Path) -> Result<Vec<HeadingFix>> {
    reader(
        path,
        "a heading log",
        |kind| kind.heading,
        &native::HEADING_TABLE,
    )?(path)
}

/// Reads a position log, rows in the order of the file. `observations` selects what to read of a table with
/// coordinates and polar observations, and gives the instrument for polar ones. A row without a range is
/// rejected, not an error.
///
/// # Errors
/// A file of another format, errors of the format's reader, no row with a range.
pub fn read_positions(path: &Path, observations: &Observations) -> Result<Positions> {
    let of = |kind: &Kind| kind.positions;
    reader(path, "a position log", of, &positions::POSITION_TABLE)?(path, observations)
}

/// Reads a trajectory: times increase.
///
/// # Errors
/// A file of another format, and errors of the format's reader; SBET, which has geographic positions; times
/// that do not increase; no poses.
pub fn read_trajectory(path: &Path) -> Result<Vec<PoseRecord>> {
    reader(
        path,
        "a trajectory",
        |kind| kind.poses,
        &pose_table::POSE_TABLE,
    )?(path)
}

/// Reads a cloud. Points marked as not measured are left out; times and intensities are kept if every point
/// has them.
///
/// # Errors
/// A file that is missing, damaged, of another format, or without points.
pub fn read_cloud(path: &Path) -> Result<PointCloud> {
    let cloud = reader(
        path,
        "a cloud",
        |kind| kind.cloud,
        &cloud_table::CLOUD_TABLE,
    )?(path)?;
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

/// The coordinate reference system that a cloud file names, as WKT; `None` where it names none.
///
/// # Errors
/// A file that is missing, damaged or of an unknown format.
pub fn crs_wkt(path: &Path) -> Result<Option<String>> {
    match detect(path)?.0.wkt {
        Some(reader) => reader(path),
        None => Ok(None),
    }
}

/// Opens a recording of a scanner, in bounded memory where the format allows it.
///
/// # Errors
/// A file that is missing, empty, or of a format without points in the frame of a scanner.
pub fn open_profiles(path: &Path) -> Result<Box<dyn ProfileReader>> {
    reader(
        path,
        "profiles",
        |kind| kind.profiles,
        &profile::PROFILE_TABLE,
    )?(path)
}
