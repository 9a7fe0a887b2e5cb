//! Profiles in the scanner frame, read chunk by chunk in bounded memory.

use std::path::{Path, PathBuf};

use crate::error::Result;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::log::tables::TableWriter;
use crate::format::profiles::reader::ProfileReader;
use crate::format::text::table::{Columns, Table};
use crate::geometry::Vec3;
use crate::sensor::{Continued, ScanPoint};

pub(crate) const PROFILES: Columns = Columns {
    needed: &["time_s", "x_m", "z_m"],
    optional: &["y_m", "intensity"],
};

pub(crate) const PROFILE_TABLE: Kind = Kind {
    columns: Some(PROFILES),
    profiles: Some(open_table),
    frame: Frame::Fixed("metres, seconds (named in the header); scanner frame"),
    ..Kind::new("profile-csv", "profiles (table)")
};

/// Opens a native table, `time_s, x_m, z_m` and optionally `y_m`, `intensity`.
pub(crate) fn open_table(input: &Input) -> Result<Box<dyn ProfileReader>> {
    Ok(Box::new(TableProfiles {
        table: Table::open(input, &PROFILES)?,
        path: input.path().to_owned(),
        times: Continued::default(),
    }))
}

/// Profiles as a native table.
struct TableProfiles {
    table: Table,
    path: PathBuf,
    times: Continued,
}

impl ProfileReader for TableProfiles {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        let mut row = [0.0; 5];
        while into.len() < CHUNK_POINTS && self.table.next_row(&mut row)? {
            let [time_s, x, z, y, intensity] = row;
            let in_order = self.times.in_order(time_s);
            let time_s =
                in_order.map_err(|found| self.table.error(found, "points in time order"))?;
            let or_zero = |v: f64| if v.is_nan() { 0.0 } else { v };
            into.push(ScanPoint {
                time_s,
                position_m: Vec3::new(x, or_zero(y), z),
                intensity: or_zero(intensity) as f32,
            });
        }
        if into.is_empty() && self.times.is_empty() {
            return Err(nothing_in(&self.path, "point"));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.table.bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.table.bytes_total()
    }
}

/// Writes profiles as a native table that [`open_profiles`](crate::format::open_profiles) reads back exactly, with
/// `y_m` if any point is outside the profile plane.
///
/// # Errors
/// The file cannot be written.
pub fn write_profiles(path: &Path, points: &[ScanPoint]) -> Result<()> {
    let with_y = points.iter().any(|p| p.position_m.y != 0.0);
    let mut header = vec!["time_s", "x_m", "z_m", "intensity"];
    header.extend(with_y.then_some("y_m"));
    let mut sheet = TableWriter::create(path, &header)?;
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
