//! Profiles in the scanner frame, read chunk by chunk in bounded memory.

use std::path::{Path, PathBuf};

use super::bonn::BonnReader;
use super::file::{CHUNK_POINTS, extension, first_bytes, nothing_in, open};
use super::las_scan::{LasScan, PosedScan};
use super::native::Sheet;
use super::profile_reader::ProfileReader;
use super::table::{Columns, Table};
use super::{bonn, las};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::sensor::ScanPoint;

pub(crate) const PROFILES: Columns = Columns {
    needed: &["time_s", "x_m", "z_m"],
    optional: &["y_m", "intensity"],
};

/// Opens a recording: Bonn `.bin`, the native table `time_s, x_m, z_m`, LAS or LAZ whose points
/// lie in the scanner frame and have times, or LAS and LAZ with the sensor's pose at every point,
/// from which the points in the scanner frame are taken back (those are sorted by time in memory).
///
/// # Errors
/// A file that is missing, empty, or of none of these formats.
pub fn open_profiles(path: &Path) -> Result<Box<dyn ProfileReader>> {
    let (mut file, _) = open(path)?;
    if las::is_las(path, &mut file)? {
        let file = las::LasFile::open(path)?;
        return if las::PoseColumns::of(&file).is_some() {
            Ok(Box::new(PosedScan::read(file)?))
        } else {
            Ok(Box::new(LasScan::new(&file)?))
        };
    }
    let start = first_bytes(path, &mut file)?;
    if extension(path) == "bin" || bonn::looks_like(&start) {
        return Ok(Box::new(BonnReader::open(path)?));
    }
    Ok(Box::new(TableProfiles {
        table: Table::open(path, &PROFILES)?,
        path: path.to_owned(),
        last_time_s: f64::NEG_INFINITY,
    }))
}

/// Profiles as a native table.
struct TableProfiles {
    table: Table,
    path: PathBuf,
    last_time_s: f64,
}

impl ProfileReader for TableProfiles {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        let mut row = [0.0; 5];
        while into.len() < CHUNK_POINTS && self.table.next_row(&mut row)? {
            let [time_s, x, z, y, intensity] = row;
            if time_s < self.last_time_s {
                return Err(self.table.error(
                    format!("time {time_s} s after {} s", self.last_time_s),
                    "points in time order",
                ));
            }
            self.last_time_s = time_s;
            let or_zero = |v: f64| if v.is_nan() { 0.0 } else { v };
            into.push(ScanPoint {
                time_s,
                position_m: Vec3::new(x, or_zero(y), z),
                intensity: or_zero(intensity) as f32,
            });
        }
        if into.is_empty() && self.last_time_s == f64::NEG_INFINITY {
            return Err(nothing_in(&self.path, "point"));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.table.lines().bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.table.lines().bytes_total()
    }
}

/// Writes profiles as a native table that [`open_profiles`] reads back bit by bit, with `y_m`
/// where any point is off the profile's plane.
///
/// # Errors
/// The file cannot be written.
pub fn write_profiles(path: &Path, points: &[ScanPoint]) -> Result<()> {
    let with_y = points.iter().any(|p| p.position_m.y != 0.0);
    let mut header = vec!["time_s", "x_m", "z_m", "intensity"];
    header.extend(with_y.then_some("y_m"));
    let mut sheet = Sheet::create(path, &header)?;
    for p in points {
        let row = [
            p.time_s,
            p.position_m.x,
            p.position_m.z,
            f64::from(p.intensity),
        ];
        sheet.row(row.into_iter().chain(with_y.then_some(p.position_m.y)))?;
    }
    sheet.finish()
}
