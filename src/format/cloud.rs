//! Clouds from all formats that contain points.

use std::path::Path;

use super::detect::{Format, detect};
use super::file::nothing_in;
use super::{cloud_table, e57, las_points, npy, pcd, ply, pts};
use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};

/// Reads a cloud: the native table, plain lines of x y z, LAS, LAZ, PLY, PCD, E57, PTS, PTX or
/// NumPy `.npy` of shape (n, 3). Points marked as not measured are left out; times and intensities
/// are kept if every point has them.
///
/// # Errors
/// A file that is missing, damaged, of another format, or without points.
pub fn read_cloud(path: &Path) -> Result<PointCloud> {
    // Unknown tables are read as well: the reader names the missing column.
    let cloud = match detect(path).unwrap_or(Format::CloudCsv) {
        Format::Las | Format::Laz => las_points::read_las(path),
        Format::Ply => ply::read(path),
        Format::Pcd => pcd::read(path),
        Format::E57 => e57::read(path),
        Format::Pts => pts::read_pts(path),
        Format::Ptx => pts::read_ptx(path),
        Format::Npy => npy::read(path),
        Format::CloudCsv
        | Format::PrismCsv
        | Format::ImuCsv
        | Format::HeadingCsv
        | Format::ProfileCsv => cloud_table::read_table(path),
        Format::XyzText => cloud_table::read_xyz(path),
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
