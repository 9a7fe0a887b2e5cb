//! Clouds as text: the native table, and plain lines of x y z.

use std::path::Path;

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::cloud::gathering::{Gathering, unnamed};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::log::tables::TableWriter;
use crate::format::text::lines::Lines;
use crate::format::text::numerals::DECIMAL_COMMAS;
use crate::format::text::table::{Columns, Table};
use crate::geometry::Vec3;

pub(crate) const CLOUD: Columns = Columns {
    needed: &["east_m", "north_m", "up_m"],
    optional: &["time_s", "intensity", "scanner"],
};

pub(crate) const CLOUD_TABLE: Kind = Kind {
    columns: Some(CLOUD),
    cloud: Some(read_table),
    frame: Frame::Fixed(
        "metres (named in the header); world: east, north, up (named in the header)",
    ),
    ..Kind::new("cloud-csv", "cloud (table)")
};

pub(crate) const XYZ: Kind = Kind {
    cloud: Some(read_xyz),
    frame: Frame::Fixed(
        "metres (assumed: there is no header); axes of the file, taken for the world",
    ),
    ..Kind::new("xyz-text", "cloud (lines of x y z)")
};

/// The columns of a native table that is known to have the needed ones; a row without a position was not measured.
const WITH_GAPS: Columns = Columns {
    needed: &[],
    optional: &[
        "east_m",
        "north_m",
        "up_m",
        "time_s",
        "intensity",
        "scanner",
    ],
};

/// Reads a native table.
pub(crate) fn read_table(input: &Input) -> Result<PointCloud> {
    Table::open(input, &CLOUD)?;
    let mut table = Table::open(input, &WITH_GAPS)?;
    let mut gathering = Gathering::new(input);
    let mut row = [0.0; 6];
    let is_unknown = |name: &&String| !CLOUD.names(name);
    let left_out: Vec<&str> = table
        .names()
        .iter()
        .filter(is_unknown)
        .map(String::as_str)
        .collect();
    if !left_out.is_empty() {
        input.remark(format!("the columns {} are left out", left_out.join(", ")));
    }
    while table.next_row(&mut row)? {
        gathering.push(Vec3::new(row[0], row[1], row[2]), row[3], row[4]);
    }
    gathering.finish()
}

/// Reads lines that begin with x y z and have as many numbers as the first line.
pub(crate) fn read_xyz(input: &Input) -> Result<PointCloud> {
    let mut lines = Lines::open(input)?;
    let mut gathering = Gathering::new(input);
    let mut cells = Vec::new();
    let mut width = 0;
    let fits = |n, width| n >= 3 && (width == 0 || n == width);
    let expected = |width: usize| {
        let count = width.max(3);
        format!("{count} numbers, the first of them x y z")
    };
    while lines.next_row(&mut cells, |row| fits(row.len(), width), || expected(width))? {
        width = cells.len();
        gathering.push(Vec3::new(cells[0], cells[1], cells[2]), f64::NAN, f64::NAN);
    }
    if lines.numerals().has_decimal_commas {
        input.remark(DECIMAL_COMMAS);
    }
    if let Some(remark) = unnamed(width) {
        input.remark(format!(
            "{remark}: put a header above them, such as `x y z intensity`"
        ));
    }
    gathering.finish()
}

/// Writes a cloud as a native table that [`read_cloud`](crate::format::read_cloud) reads back bit by bit.
///
/// # Errors
/// The file cannot be written.
pub fn write_cloud_table(path: &Path, cloud: &PointCloud) -> Result<()> {
    let with = [!cloud.time_s.is_empty(), !cloud.intensity.is_empty()];
    let mut header = CLOUD.needed.to_vec();
    header.extend(with[0].then_some("time_s"));
    header.extend(with[1].then_some("intensity"));
    let mut sheet = TableWriter::create(path, &header)?;
    for (i, p) in cloud.points.iter().enumerate() {
        let time = cloud.time_s.get(i).copied();
        let intensity = cloud.intensity.get(i).map(|v| f64::from(*v));
        sheet.row([p.x, p.y, p.z].into_iter().chain(time).chain(intensity))?;
    }
    sheet.finish()
}
