//! The native tables of IMU and heading.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format::file::{extension, nothing_in};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::las::value::ExtraValue;
use crate::format::parquet::ParquetTable;
use crate::format::text::table::{Columns, Table};
use crate::geometry::Vec3;
use crate::sensor::{HeadingFix, ImuSample};

pub(crate) const IMU: Columns = Columns {
    needed: &[
        "time_s",
        "gyro_x_rad_s",
        "gyro_y_rad_s",
        "gyro_z_rad_s",
        "accel_x_m_s2",
        "accel_y_m_s2",
        "accel_z_m_s2",
    ],
    optional: &[],
};
pub(crate) const HEADING: Columns = Columns {
    needed: &["time_s", "heading_deg"],
    optional: &["sigma_deg", "pitch_deg", "sigma_pitch_deg"],
};

pub(crate) const IMU_TABLE: Kind = Kind {
    columns: Some(IMU),
    imu: Some(read_imu),
    frame: Frame::Fixed("units named in the header; body axes: those of frame.body in the project"),
    ..Kind::new("imu-csv", "IMU log (table)")
};
pub(crate) const HEADING_TABLE: Kind = Kind {
    columns: Some(HEADING),
    heading: Some(read_heading),
    frame: Frame::Fixed("units named in the header; headings clockwise from north"),
    ..Kind::new("heading-csv", "heading log (table)")
};

/// Reads an IMU log, `time_s, gyro_x_rad_s, …, accel_x_m_s2, …`. Rows are returned in the order of
/// the file.
///
/// # Errors
/// Missing columns, cells that are not finite numbers, no rows.
pub(crate) fn read_imu(input: &Input) -> Result<Vec<ImuSample>> {
    read_rows::<7, _>(input, &IMU, "IMU sample", |row, _| {
        Ok(ImuSample {
            time_s: row[0],
            gyro_rad_s: Vec3::new(row[1], row[2], row[3]),
            accel_m_s2: Vec3::new(row[4], row[5], row[6]),
        })
    })
}

/// Reads a heading log, `time_s, heading_deg` and optionally `sigma_deg`, `pitch_deg` (of the
/// baseline above the horizon) and `sigma_pitch_deg`; degrees become radians. Rows are returned in
/// the order of the file.
///
/// # Errors
/// Those of [`read_imu`]; a standard deviation that is not positive, or that belongs to a missing pitch.
pub(crate) fn read_heading(input: &Input) -> Result<Vec<HeadingFix>> {
    read_rows::<5, _>(input, &HEADING, "heading", |row, table| {
        let radians = |value: f64| (!value.is_nan()).then(|| value.to_radians());
        let pitch_rad = radians(row[3]);
        if pitch_rad.is_none() && !row[4].is_nan() {
            return Err(table.error("sigma_pitch_deg without pitch_deg", "both or neither"));
        }
        if pitch_rad.is_some_and(|pitch| pitch.abs() > std::f64::consts::FRAC_PI_2) {
            return Err(table.error(format!("pitch_deg = {}", row[3]), "-90 to 90"));
        }
        Ok(HeadingFix {
            time_s: row[0],
            heading_rad: row[1].to_radians(),
            sigma_rad: sigma(row[2], "sigma_deg", table)?.map(f64::to_radians),
            pitch_rad,
            pitch_sigma_rad: sigma(row[4], "sigma_pitch_deg", table)?.map(f64::to_radians),
        })
    })
}

/// Reads every row of a table in the order of the file; `N` is the number of columns.
pub(crate) fn read_rows<const N: usize, T>(
    input: &Input,
    columns: &Columns,
    what: &str,
    mut record: impl FnMut(&[f64; N], &Table) -> Result<T>,
) -> Result<Vec<T>> {
    let mut table = Table::open(input, columns)?;
    let mut records = Vec::new();
    let mut row = [0.0; N];
    while table.next_row(&mut row)? {
        records.push(record(&row, &table)?);
    }
    if records.is_empty() {
        return Err(nothing_in(input.path(), what));
    }
    Ok(records)
}

/// Checks a standard deviation; NaN stands for an absent one and gives `None`.
pub(crate) fn sigma(value: f64, name: &str, table: &Table) -> Result<Option<f64>> {
    if value.is_nan() {
        Ok(None)
    } else if value > 0.0 {
        Ok(Some(value))
    } else {
        Err(table.error(format!("{name} = {value}"), "a positive standard deviation"))
    }
}

/// A table being written row by row.
pub(crate) struct TableWriter {
    path: PathBuf,
    out: BufWriter<File>,
}

impl TableWriter {
    pub(crate) fn create(path: &Path, header: &[&str]) -> Result<Self> {
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        let mut sheet = Self {
            path: path.to_owned(),
            out: BufWriter::with_capacity(1 << 18, file),
        };
        let header = header.join(",");
        sheet.put(|out| writeln!(out, "{header}"))?;
        Ok(sheet)
    }

    pub(crate) fn put(
        &mut self,
        write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
    ) -> Result<()> {
        write(&mut self.out).map_err(|e| Error::io(&self.path, e))
    }

    /// Writes a row of numbers in the shortest form that reads back as the same number; NaN becomes
    /// an empty cell.
    pub(crate) fn row<V: Into<ExtraValue>>(
        &mut self,
        cells: impl IntoIterator<Item = V>,
    ) -> Result<()> {
        self.put(|out| {
            for (i, cell) in cells.into_iter().enumerate() {
                if i > 0 {
                    out.write_all(b",")?;
                }
                write!(out, "{}", cell.into())?;
            }
            out.write_all(b"\n")
        })
    }

    pub(crate) fn finish(mut self) -> Result<()> {
        self.put(|out| out.flush())
    }
}

/// Writes records as a table with the needed columns and those optional columns for which any record has a
/// value; as Parquet if the name ends in `.parquet`. `row` gives all values of a record, NaN for absent values.
pub(crate) fn write_rows<const N: usize, T>(
    path: &Path,
    columns: &Columns,
    records: &[T],
    row: impl Fn(&T) -> [f64; N],
) -> Result<()> {
    let mut used = [false; N];
    used[..columns.needed.len()].fill(true);
    for record in records {
        for (used, value) in used.iter_mut().zip(row(record)) {
            *used |= !value.is_nan();
        }
    }
    let names = columns.needed.iter().chain(columns.optional).zip(used);
    let header: Vec<&str> = names
        .filter_map(|(name, used)| used.then_some(*name))
        .collect();
    let rows = records.iter().map(|record| {
        let cells = row(record).into_iter().zip(used);
        cells.filter_map(|(cell, used)| used.then_some(cell))
    });
    if extension(path) == "parquet" {
        let mut sheet = ParquetTable::create(path, &header)?;
        for cells in rows {
            sheet.row(cells)?;
        }
        return sheet.finish();
    }
    let mut sheet = TableWriter::create(path, &header)?;
    for cells in rows {
        sheet.row(cells)?;
    }
    sheet.finish()
}

/// Writes an IMU log that [`read_imu`](crate::format::read_imu) reads back bit by bit.
///
/// # Errors
/// The file cannot be written.
pub fn write_imu(path: &Path, samples: &[ImuSample]) -> Result<()> {
    write_rows(path, &IMU, samples, |sample| {
        let (w, a) = (&sample.gyro_rad_s, &sample.accel_m_s2);
        [sample.time_s, w.x, w.y, w.z, a.x, a.y, a.z]
    })
}

/// Writes a heading log in degrees that [`read_heading`](crate::format::read_heading) reads back to a relative
/// 1e-15, with columns for standard deviations and pitch if any fix has them.
///
/// # Errors
/// The file cannot be written.
pub fn write_heading(path: &Path, fixes: &[HeadingFix]) -> Result<()> {
    let degrees = |value: Option<f64>| value.map_or(f64::NAN, f64::to_degrees);
    write_rows(path, &HEADING, fixes, |fix| {
        let heading_deg = fix.heading_rad.to_degrees();
        let optional = [fix.sigma_rad, fix.pitch_rad, fix.pitch_sigma_rad].map(degrees);
        [
            fix.time_s,
            heading_deg,
            optional[0],
            optional[1],
            optional[2],
        ]
    })
}
