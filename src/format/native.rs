//! The native tables of IMU, prism and heading.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::table::{Columns, Table};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::sensor::{HeadingFix, ImuSample, PositionFix};

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
pub(crate) const PRISM: Columns = Columns {
    needed: &["time_s", "east_m", "north_m", "up_m"],
    optional: &["sigma_m"],
};
pub(crate) const HEADING: Columns = Columns {
    needed: &["time_s", "heading_deg"],
    optional: &["sigma_deg"],
};

/// Reads an IMU log, `time_s, gyro_x_rad_s, …, accel_x_m_s2, …`.
///
/// # Errors
/// Missing columns, cells that are no finite numbers, times that do not increase, no rows.
pub fn read_imu(path: &Path) -> Result<Vec<ImuSample>> {
    read_rows::<7, _>(path, &IMU, "IMU sample", |row, _| {
        Ok(ImuSample {
            time_s: row[0],
            gyro_rad_s: Vec3::new(row[1], row[2], row[3]),
            accel_m_s2: Vec3::new(row[4], row[5], row[6]),
        })
    })
}

/// Reads a prism log, `time_s, east_m, north_m, up_m` and perhaps `sigma_m`.
///
/// # Errors
/// As [`read_imu`]; also a standard deviation that is not positive.
pub fn read_prism(path: &Path) -> Result<Vec<PositionFix>> {
    read_rows::<5, _>(path, &PRISM, "prism position", |row, table| {
        let position_m = Vec3::new(row[1], row[2], row[3]);
        let sigma_m = sigma(row[4], "sigma_m", table)?;
        Ok(PositionFix::with_sigma(row[0], position_m, sigma_m))
    })
}

/// Reads a heading log, `time_s, heading_deg` and perhaps `sigma_deg`; degrees become radians.
///
/// # Errors
/// As [`read_prism`].
pub fn read_heading(path: &Path) -> Result<Vec<HeadingFix>> {
    read_rows::<3, _>(path, &HEADING, "heading", |row, table| {
        Ok(HeadingFix::new(
            row[0],
            row[1].to_radians(),
            sigma(row[2], "sigma_deg", table)?.map(f64::to_radians),
        ))
    })
}

/// Reads every row of a table in strictly increasing time order; `N` counts all wanted columns,
/// the first of which is the time.
pub(crate) fn read_rows<const N: usize, T>(
    path: &Path,
    columns: &Columns,
    what: &str,
    mut record: impl FnMut(&[f64; N], &Table) -> Result<T>,
) -> Result<Vec<T>> {
    let mut table = Table::open(path, columns)?;
    let mut records = Vec::new();
    let mut row = [0.0; N];
    let mut last = f64::NEG_INFINITY;
    while table.next_row(&mut row)? {
        if row[0] <= last {
            return Err(table.error(
                format!("time {} s after {last} s", row[0]),
                "times that increase",
            ));
        }
        last = row[0];
        records.push(record(&row, &table)?);
    }
    if records.is_empty() {
        return Err(super::nothing_in(path, what));
    }
    Ok(records)
}

/// A standard deviation that may be missing.
pub(crate) fn sigma(value: f64, name: &str, table: &Table) -> Result<Option<f64>> {
    if value.is_nan() {
        Ok(None)
    } else if value > 0.0 {
        Ok(Some(value))
    } else {
        Err(table.error(format!("{name} = {value}"), "a positive standard deviation"))
    }
}

/// A file being written, line by line.
pub(crate) struct Sheet<'a> {
    path: &'a Path,
    out: BufWriter<File>,
}

impl<'a> Sheet<'a> {
    pub(crate) fn create(path: &'a Path, header: &[&str]) -> Result<Self> {
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        let mut sheet = Self {
            path,
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
        write(&mut self.out).map_err(|e| Error::io(self.path, e))
    }

    /// A row of numbers in the shortest form that reads back as the same number; NaN is written
    /// as an empty cell.
    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = f64>) -> Result<()> {
        self.put(|out| {
            for (i, cell) in cells.into_iter().enumerate() {
                if i > 0 {
                    out.write_all(b",")?;
                }
                if !cell.is_nan() {
                    write!(out, "{cell}")?;
                }
            }
            out.write_all(b"\n")
        })
    }

    pub(crate) fn finish(mut self) -> Result<()> {
        self.put(|out| out.flush())
    }
}

/// Writes an IMU log that [`read_imu`] reads back bit by bit.
///
/// # Errors
/// The file cannot be written.
pub fn write_imu(path: &Path, samples: &[ImuSample]) -> Result<()> {
    let mut sheet = Sheet::create(path, IMU.needed)?;
    for sample in samples {
        let (w, a) = (&sample.gyro_rad_s, &sample.accel_m_s2);
        sheet.row([sample.time_s, w.x, w.y, w.z, a.x, a.y, a.z])?;
    }
    sheet.finish()
}

/// Writes a prism log that [`read_prism`] reads back bit by bit; with `sigma_m` where any fix has
/// one.
///
/// # Errors
/// The file cannot be written.
pub fn write_prism(path: &Path, fixes: &[PositionFix]) -> Result<()> {
    let with_sigma = fixes.iter().any(|fix| fix.covariance_m2.is_some());
    let mut header = PRISM.needed.to_vec();
    header.extend(with_sigma.then_some("sigma_m"));
    let mut sheet = Sheet::create(path, &header)?;
    for fix in fixes {
        let p = &fix.position_m;
        let sigma = with_sigma.then(|| fix.covariance_m2.map_or(f64::NAN, |c| c[(0, 0)].sqrt()));
        sheet.row([fix.time_s, p.x, p.y, p.z].into_iter().chain(sigma))?;
    }
    sheet.finish()
}

/// Writes a heading log in degrees, read back by [`read_heading`] to 1e-15 of its value; with
/// `sigma_deg` where any fix has one.
///
/// # Errors
/// The file cannot be written.
pub fn write_heading(path: &Path, fixes: &[HeadingFix]) -> Result<()> {
    let with_sigma = fixes.iter().any(|fix| fix.sigma_rad.is_some());
    let mut header = HEADING.needed.to_vec();
    header.extend(with_sigma.then_some("sigma_deg"));
    let mut sheet = Sheet::create(path, &header)?;
    for fix in fixes {
        let sigma = with_sigma.then(|| fix.sigma_rad.map_or(f64::NAN, f64::to_degrees));
        let row = [fix.time_s, fix.heading_rad.to_degrees()];
        sheet.row(row.into_iter().chain(sigma))?;
    }
    sheet.finish()
}
