//! Clouds written point by point as LAS or LAZ.

use std::path::{Path, PathBuf};

use super::las_extra::dimension::{self, ExtraDimension};
use super::las_out::{LasOut, is_compressed};
use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Step of the coordinates in written clouds, metres: 0.01 mm survives, and 32 bits reach
/// 21 km to each side of the offset.
pub const CLOUD_STEP_M: f64 = 1e-5;

/// Bytes of a point of format 6, and of format 0, which has no time.
const RECORD: usize = 30;
const TIMELESS_RECORD: usize = 20;

/// Writes a LAS 1.4 file of point format 6, compressed where its name ends in `.laz`: position,
/// GPS time, intensity, and the number of the scanner as `point_source_id` and, up to 255, as
/// `user_data`; where asked for, further named values. The same points give the same bytes.
pub struct CloudWriter {
    path: PathBuf,
    out: LasOut,
    offset_m: Vec3,
    step_m: f64,
    has_time: bool,
    dimensions: Vec<ExtraDimension>,
    extra: Vec<u8>,
}

impl CloudWriter {
    /// Creates or replaces the file. All points must lie within 21 km of `offset_m` on every
    /// axis; it is rounded to whole metres.
    ///
    /// # Errors
    /// A name that ends neither in `.las` nor `.laz`, an offset that is not finite, a file that
    /// cannot be written.
    pub fn create(path: &Path, offset_m: Vec3) -> Result<Self> {
        Self::open(path, offset_m, CLOUD_STEP_M, true, &[])
    }

    /// Creates or replaces a file for points between `low` and `high` (metres), with the values of
    /// `dimensions` beside each. Coordinates are rounded to [`CLOUD_STEP_M`], or to the least power
    /// of ten that lets 32 bits span the points. Without times the point format is 0, which has
    /// none.
    ///
    /// # Errors
    /// As [`CloudWriter::create`]; names of dimensions that LAS cannot hold.
    pub fn spanning(
        path: &Path,
        low: &Vec3,
        high: &Vec3,
        has_time: bool,
        dimensions: &[ExtraDimension],
    ) -> Result<Self> {
        // The offset is rounded to whole metres, which costs half a metre to each side.
        let reach_m = ((high - low) / 2.0).amax() + 1.0;
        let mut step_m = CLOUD_STEP_M;
        while step_m * f64::from(i32::MAX) < reach_m && reach_m.is_finite() {
            step_m *= 10.0;
        }
        let middle = low + (high - low) / 2.0;
        Self::open(path, middle, step_m, has_time, dimensions)
    }

    fn open(
        path: &Path,
        offset_m: Vec3,
        step_m: f64,
        has_time: bool,
        dimensions: &[ExtraDimension],
    ) -> Result<Self> {
        let offset_m = offset_m.map(f64::round);
        let is_compressed = is_compressed(path)?;
        if !offset_m.iter().all(|v| v.is_finite()) {
            return Err(Error::data(
                format!("{}: the offset of a cloud is not finite", path.display()),
                "check the positions of the trajectory",
            ));
        }
        dimension::check(path, dimensions)?;
        let axis = |offset| las::Transform {
            scale: step_m,
            offset,
        };
        let mut builder = las::Builder::from((1, 4));
        builder.date = None;
        builder.guid = Default::default();
        builder.point_format = las::point::Format {
            has_gps_time: has_time,
            is_extended: has_time,
            is_compressed,
            ..Default::default()
        };
        builder.generating_software = "boresight".to_owned();
        builder.transforms = las::Vector {
            x: axis(offset_m.x),
            y: axis(offset_m.y),
            z: axis(offset_m.z),
        };
        // Points of the extended formats demand that any reference system be WKT.
        builder.has_wkt_crs = true;
        dimension::append(path, &mut builder, Vec::new(), dimensions)?;
        Ok(Self {
            path: path.to_owned(),
            out: LasOut::create(path, builder)?,
            offset_m,
            step_m,
            has_time,
            dimensions: dimensions.to_vec(),
            extra: Vec::new(),
        })
    }

    /// Appends a point in the world frame (m) with its time, its intensity (rounded into 0 to
    /// 65535) and the number of its scanner.
    ///
    /// # Errors
    /// A point too far from the offset or not finite, a file that cannot be written.
    pub fn write(&mut self, point: &Vec3, time_s: f64, intensity: f32, scanner: u16) -> Result<()> {
        self.write_with(point, time_s, intensity, scanner, &[])
    }

    /// As [`CloudWriter::write`], with the values of the dimensions; those not given are NaN.
    ///
    /// # Errors
    /// As there.
    pub fn write_with(
        &mut self,
        point: &Vec3,
        time_s: f64,
        intensity: f32,
        scanner: u16,
        values: &[f64],
    ) -> Result<()> {
        let raw = (point - self.offset_m).map(|v| (v / self.step_m).round());
        // Written so that NaN fails as well.
        if !raw.iter().all(|v| v.abs() <= f64::from(i32::MAX)) {
            return Err(self.too_far(point, time_s));
        }
        let mut record = [0; RECORD];
        for (place, v) in record.chunks_exact_mut(4).zip(raw.iter()) {
            place.copy_from_slice(&(*v as i32).to_le_bytes());
        }
        // `as` saturates and makes 0 of NaN.
        record[12..14].copy_from_slice(&(intensity.round() as u16).to_le_bytes());
        let user_data = u8::try_from(scanner).unwrap_or(u8::MAX);
        // The first of one return; flags, class and scan angle stay 0.
        let length = if self.has_time {
            record[14] = 0x11;
            record[17] = user_data;
            record[20..22].copy_from_slice(&scanner.to_le_bytes());
            record[22..30].copy_from_slice(&time_s.to_le_bytes());
            RECORD
        } else {
            record[14] = 0x09;
            record[17] = user_data;
            record[18..20].copy_from_slice(&scanner.to_le_bytes());
            TIMELESS_RECORD
        };
        self.extra.clear();
        for (at, dimension) in self.dimensions.iter().enumerate() {
            let value = values.get(at).copied().unwrap_or(f64::NAN);
            dimension.kind.append(value, &mut self.extra);
        }
        self.out.push(&[&record[..length], &self.extra])
    }

    fn too_far(&self, point: &Vec3, time_s: f64) -> Error {
        Error::data(
            format!(
                "{}: the point ({}, {}, {}) m at {time_s} s lies more than {:.0} m from \
                 ({}, {}, {}) m",
                self.path.display(),
                point.x,
                point.y,
                point.z,
                self.step_m * f64::from(i32::MAX),
                self.offset_m.x,
                self.offset_m.y,
                self.offset_m.z,
            ),
            "check the trajectory and the mounting; a cloud file spans 42 km at most",
        )
    }

    /// Writes what is still in memory and completes the header.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self) -> Result<()> {
        self.out.finish()
    }
}
