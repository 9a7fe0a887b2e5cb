//! Clouds written point by point as LAS or LAZ.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;

/// Step of the coordinates in written clouds, metres: 0.01 mm survives, and 32 bits reach
/// 21 km to each side of the offset.
pub const CLOUD_STEP_M: f64 = 1e-5;

/// Bytes of a point of format 6.
const RECORD: usize = 30;
/// Points compressed at a time: several of the format's chunks of 50,000, so that all threads
/// have work.
const BATCH: usize = 200_000;

/// Writes a LAS 1.4 file of point format 6, compressed where its name ends in `.laz`: position,
/// GPS time, intensity, and the number of the scanner as `user_data` and `point_source_id`. The
/// same points give the same bytes.
pub struct CloudWriter {
    path: PathBuf,
    writer: las::Writer<BufWriter<File>>,
    offset_m: Vec3,
    records: Vec<u8>,
}

impl CloudWriter {
    /// Creates or replaces the file. All points must lie within 21 km of `offset_m` on every
    /// axis; it is rounded to whole metres.
    ///
    /// # Errors
    /// A name that ends neither in `.las` nor `.laz`, an offset that is not finite, a file that
    /// cannot be written.
    pub fn create(path: &Path, offset_m: Vec3) -> Result<Self> {
        let offset_m = offset_m.map(f64::round);
        let is_compressed = match super::extension(path).as_str() {
            "laz" => true,
            "las" => false,
            other => {
                return Err(Error::format(
                    path,
                    Location::Whole,
                    format!("a cloud to be written with the extension `{other}`"),
                    "`laz` or `las`",
                ));
            }
        };
        if !offset_m.iter().all(|v| v.is_finite()) {
            return Err(Error::data(
                format!("{}: the offset of a cloud is not finite", path.display()),
                "check the positions of the trajectory",
            ));
        }
        let axis = |offset| las::Transform {
            scale: CLOUD_STEP_M,
            offset,
        };
        let header = las::point::Format::new(6).and_then(|mut point_format| {
            point_format.is_compressed = is_compressed;
            let mut builder = las::Builder::from((1, 4));
            builder.date = None;
            builder.guid = Default::default();
            builder.point_format = point_format;
            builder.generating_software = "boresight".to_owned();
            builder.transforms = las::Vector {
                x: axis(offset_m.x),
                y: axis(offset_m.y),
                z: axis(offset_m.z),
            };
            // Points of the extended formats demand that any reference system be WKT.
            builder.has_wkt_crs = true;
            builder.into_header()
        });
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        let writer = header
            .and_then(|header| las::Writer::new(BufWriter::with_capacity(1 << 20, file), header))
            .map_err(|e| problem(path, e))?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            offset_m,
            records: Vec::with_capacity(BATCH * RECORD),
        })
    }

    /// Appends a point in the world frame (m) with its time, its intensity (rounded into 0 to
    /// 65535) and the number of its scanner.
    ///
    /// # Errors
    /// A point too far from the offset or not finite, a file that cannot be written.
    pub fn write(&mut self, point: &Vec3, time_s: f64, intensity: f32, scanner: u8) -> Result<()> {
        let raw = (point - self.offset_m).map(|v| (v / CLOUD_STEP_M).round());
        // Written so that NaN fails as well.
        if !raw.iter().all(|v| v.abs() <= f64::from(i32::MAX)) {
            return Err(Error::data(
                format!(
                    "{}: the point ({}, {}, {}) m at {time_s} s lies more than {:.0} m from \
                     ({}, {}, {}) m",
                    self.path.display(),
                    point.x,
                    point.y,
                    point.z,
                    CLOUD_STEP_M * f64::from(i32::MAX),
                    self.offset_m.x,
                    self.offset_m.y,
                    self.offset_m.z,
                ),
                "check the trajectory and the mounting; a cloud file spans 42 km at most",
            ));
        }
        let mut record = [0; RECORD];
        for (place, v) in record.chunks_exact_mut(4).zip(raw.iter()) {
            place.copy_from_slice(&(*v as i32).to_le_bytes());
        }
        // `as` saturates and makes 0 of NaN.
        record[12..14].copy_from_slice(&(intensity.round() as u16).to_le_bytes());
        // The first of one return; flags, class and scan angle stay 0.
        record[14] = 0x11;
        record[17] = scanner;
        record[20..22].copy_from_slice(&u16::from(scanner).to_le_bytes());
        record[22..30].copy_from_slice(&time_s.to_le_bytes());
        let out = &mut self.records;
        out.extend_from_slice(&record);
        if out.len() >= BATCH * RECORD {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let header = self.writer.header();
        let records = std::mem::replace(&mut self.records, Vec::with_capacity(BATCH * RECORD));
        las::PointDataBuilder::new()
            .for_header(header)
            .build_from_bytes(records)
            .and_then(|points| self.writer.write_points(&points))
            .map_err(|e| problem(&self.path, e))
    }

    /// Writes what is still in memory and completes the header.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<()> {
        if !self.records.is_empty() {
            self.flush()?;
        }
        self.writer.close().map_err(|e| problem(&self.path, e))?;
        let out = self
            .writer
            .into_inner()
            .map_err(|e| problem(&self.path, e))?;
        out.into_inner()
            .map(drop)
            .map_err(|e| Error::io(&self.path, e.into_error()))
    }
}

fn problem(path: &Path, error: las::Error) -> Error {
    match error {
        las::Error::Io(source) => Error::io(path, source),
        other => Error::format(
            path,
            Location::Whole,
            other.to_string(),
            "points that LAS can hold",
        ),
    }
}
