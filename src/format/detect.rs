//! Which format a file has: by what it holds, then by its name.

use std::fmt;
use std::io::{Seek, SeekFrom};
use std::path::Path;

use super::file::{extension, first_bytes, nothing_in, open};
use super::lines::{Lines, Separator, numbers};
use super::table::Columns;
use super::{bonn, cloud_table, native, pose_table, positions, profile, sbet};
use crate::error::{Error, Result};

/// A file format that is read here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// IMU log as a native table.
    ImuCsv,
    /// Log of positions of a prism or GNSS antenna as a native table.
    PrismCsv,
    /// Polar observations of a total station as a native table.
    PolarCsv,
    /// Coordinates and polar observations of a Leica total station.
    TpsCsv,
    /// Heading log as a native table.
    HeadingCsv,
    /// Profiles as a native table.
    ProfileCsv,
    /// Trajectory as a native table.
    TrajectoryCsv,
    /// Cloud as a native table.
    CloudCsv,
    /// Plain lines of x y z.
    XyzText,
    /// Gocator recording of the Bonn robot.
    BonnProfiles,
    /// Trajectory of the Bonn robot.
    BonnTrajectory,
    /// Mounting of the Bonn group.
    BonnMounting,
    /// Trajectory as time, position and quaternion.
    Tum,
    /// Smoothed best estimate of trajectory.
    Sbet,
    /// ASPRS LAS.
    Las,
    /// Compressed LAS.
    Laz,
    /// Polygon file format.
    Ply,
    /// Point Cloud Library.
    Pcd,
    /// ASTM E57.
    E57,
    /// Leica PTS.
    Pts,
    /// Leica PTX.
    Ptx,
    /// NumPy array.
    Npy,
    /// Project file of this program.
    Project,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ImuCsv => "IMU log (table)",
            Self::PrismCsv => "position log (table)",
            Self::PolarCsv => "total station log (table, polar)",
            Self::TpsCsv => "total station log (Leica, coordinates and polar)",
            Self::HeadingCsv => "heading log (table)",
            Self::ProfileCsv => "profiles (table)",
            Self::TrajectoryCsv => "trajectory (table)",
            Self::CloudCsv => "cloud (table)",
            Self::XyzText => "cloud (lines of x y z)",
            Self::BonnProfiles => "profiles (Gocator recording, Bonn .bin)",
            Self::BonnTrajectory => "trajectory (Bonn .trj)",
            Self::BonnMounting => "mounting (Bonn XML)",
            Self::Tum => "trajectory (TUM)",
            Self::Sbet => "trajectory (SBET, geographic)",
            Self::Las => "points (LAS)",
            Self::Laz => "points (LAZ)",
            Self::Ply => "cloud (PLY)",
            Self::Pcd => "cloud (PCD)",
            Self::E57 => "cloud (E57)",
            Self::Pts => "cloud (PTS)",
            Self::Ptx => "cloud (PTX)",
            Self::Npy => "cloud (NumPy)",
            Self::Project => "project",
        })
    }
}

/// The native tables, those with more needed columns first.
pub(crate) const TABLES: [(Format, Columns); 8] = [
    (Format::TrajectoryCsv, pose_table::TRAJECTORY),
    (Format::ImuCsv, native::IMU),
    (Format::TpsCsv, positions::TPS),
    (Format::PolarCsv, positions::POLAR),
    (Format::PrismCsv, positions::POSITIONS),
    (Format::CloudCsv, cloud_table::CLOUD),
    (Format::ProfileCsv, profile::PROFILES),
    (Format::HeadingCsv, native::HEADING),
];

/// Finds the format of a file.
///
/// # Errors
/// A file that is missing, empty, or of no known format: what it starts with is named.
pub fn detect(path: &Path) -> Result<Format> {
    let (mut file, size) = open(path)?;
    let start = first_bytes(path, &mut file)?;
    file.seek(SeekFrom::Start(0))
        .map_err(|e| Error::io(path, e))?;
    if let Some(format) = by_signature(&start, size) {
        return Ok(format);
    }
    // Nothing certain inside: the name decides where it can, and its reader says what is wrong.
    match extension(path).as_str() {
        "las" => return Ok(Format::Las),
        "laz" => return Ok(Format::Laz),
        "ply" => return Ok(Format::Ply),
        "pcd" => return Ok(Format::Pcd),
        "e57" => return Ok(Format::E57),
        "npy" => return Ok(Format::Npy),
        "pts" => return Ok(Format::Pts),
        "ptx" => return Ok(Format::Ptx),
        "sbet" => return Ok(Format::Sbet),
        "bin" => return Ok(Format::BonnProfiles),
        "trj" => return Ok(Format::BonnTrajectory),
        "tum" => return Ok(Format::Tum),
        "toml" => return Ok(Format::Project),
        _ => {}
    }
    by_text(path)
}

/// The format that the first bytes prove.
fn by_signature(start: &[u8], size: u64) -> Option<Format> {
    let contains = |what: &[u8]| start.windows(what.len()).any(|w| w == what);
    if start.starts_with(b"LASF") {
        let compressed = start.get(104).is_some_and(|b| b & 0x80 != 0);
        Some(if compressed { Format::Laz } else { Format::Las })
    } else if start.starts_with(b"ply\n") || start.starts_with(b"ply\r\n") {
        Some(Format::Ply)
    } else if start.starts_with(b"ASTM-E57") {
        Some(Format::E57)
    } else if start.starts_with(b"\x93NUMPY") {
        Some(Format::Npy)
    } else if contains(b"FIELDS ") && contains(b"DATA ") {
        Some(Format::Pcd)
    } else if contains(b"<SystemCalibration") {
        Some(Format::BonnMounting)
    } else if bonn::looks_like(start) {
        Some(Format::BonnProfiles)
    } else if sbet::looks_like(start, size) {
        Some(Format::Sbet)
    } else {
        None
    }
}

/// The format of a table or of lines of numbers.
fn by_text(path: &Path) -> Result<Format> {
    let mut lines = Lines::open(path)?;
    let mut cells = Vec::new();
    let mut comment = Vec::new();
    let mut single = 0;
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() {
            continue;
        }
        if let Some(text) = text.strip_prefix('#') {
            comment = Separator::of(text).names(text);
            continue;
        }
        if !numbers(text, &mut cells) {
            let names = Separator::of(text).names(text);
            return by_columns(&names).ok_or_else(|| unknown(&lines, &names));
        }
        if let Some(format) = by_columns(&comment) {
            return Ok(format);
        }
        // A header of other names is no comment on lines of x y z.
        if comment.len() == cells.len()
            && comment
                .first()
                .is_some_and(|name| name.to_lowercase().starts_with("time"))
        {
            return Err(unknown(&lines, &comment));
        }
        match (cells.len(), single) {
            (1, 0) => single = 1,
            (1, _) => return Ok(Format::Ptx),
            (3.., 1) => return Ok(Format::Pts),
            (16, _) => return Ok(Format::BonnTrajectory),
            (8, _) if extension(path) != "xyz" => return Ok(Format::Tum),
            (3.., _) => return Ok(Format::XyzText),
            (n, _) => {
                return Err(lines.error(
                    format!("{n} numbers and no header before them"),
                    "a header, or lines of x y z",
                ));
            }
        }
    }
    Err(nothing_in(path, "line of data"))
}

fn unknown(lines: &Lines, names: &[String]) -> Error {
    let found: String = names.join(", ").chars().take(200).collect();
    lines.error(
        format!("`{found}`"),
        "the columns of an IMU, prism or heading log, of profiles, a trajectory or a cloud, or \
         one of the binary formats",
    )
}

/// The table with these columns. A prism log and a cloud with times can have the same: a cloud
/// begins with its coordinates.
fn by_columns(names: &[String]) -> Option<Format> {
    let format = TABLES.iter().find(|(_, columns)| columns.are_in(names))?.0;
    let is_cloud = names.first().is_some_and(|name| name == "east_m")
        || names.iter().any(|n| n == "intensity" || n == "scanner");
    if format == Format::PrismCsv && is_cloud {
        return Some(Format::CloudCsv);
    }
    Some(format)
}
