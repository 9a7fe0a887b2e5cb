//! Clouds written point by point as LAS or LAZ.

use std::path::{Path, PathBuf};

use super::civil::gps_from_unix_s;
use super::cloud_sink::{CloudClock, CloudPoint, CloudShape, CloudSink};
use super::las_extra::dimension::{self, ExtraDimension};
use super::las_kind::WKT_RECORD;
use super::las_out::{LasOut, is_compressed};
use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Step of the coordinates in written clouds, metres: it preserves 0.01 mm, and 32 bits reach 21 km
/// to each side of the offset.
pub const CLOUD_STEP_M: f64 = 1e-5;

/// Bytes of a point of format 6, and of format 0, which has no time.
const RECORD: usize = 30;
const TIMELESS_RECORD: usize = 20;

/// GPS time counts from 1980-01-06; its adjusted form is smaller by this, seconds.
const GPS_ADJUSTMENT_S: f64 = 1e9;

/// The dimension whose values are also those of `point_source_id`.
const SCANNER: &str = "scanner";

/// Writes a LAS 1.4 file of point format 6, compressed if its name ends in `.laz`: position, GPS
/// time, intensity, the scanner's number as `point_source_id` and, up to 255, as `user_data`, and
/// further named values on request. Unix times become adjusted standard GPS time, and the header
/// says so; all others are kept and said to be seconds of the GPS week. The same points give the
/// same bytes.
pub struct CloudWriter {
    path: PathBuf,
    out: LasOut,
    offset_m: Vec3,
    step_m: f64,
    has_time: bool,
    clock: CloudClock,
    dimensions: Vec<ExtraDimension>,
    /// Which dimension is the scanner's number.
    scanner: Option<usize>,
    extra: Vec<u8>,
}

impl CloudWriter {
    /// Creates or replaces the file. All points must lie within 21 km of `offset_m` on every
    /// axis; it is rounded to whole metres.
    ///
    /// # Errors
    /// A name that ends in neither `.las` nor `.laz`, an offset that is not finite, a file that
    /// cannot be written.
    pub fn create(path: &Path, offset_m: Vec3) -> Result<Self> {
        Self::around(path, offset_m, &CloudShape::default())
    }

    /// As [`CloudWriter::create`], for points with the times, the values and the coordinate reference
    /// system of `shape`, whose extent is not used.
    ///
    /// # Errors
    /// As there; names of dimensions that LAS does not allow.
    pub fn around(path: &Path, offset_m: Vec3, shape: &CloudShape) -> Result<Self> {
        let shape = CloudShape {
            has_time: true,
            ..shape.clone()
        };
        Self::open(path, offset_m, CLOUD_STEP_M, &shape)
    }

    /// Creates or replaces the file for a cloud of this shape. Coordinates are rounded to [`CLOUD_STEP_M`], or to the smallest
    /// power of ten for which 32 bits span the points. Without times the point format is 0, which
    /// has none.
    ///
    /// # Errors
    /// As [`CloudWriter::create`]; names of dimensions that LAS does not allow.
    pub fn spanning(path: &Path, shape: &CloudShape) -> Result<Self> {
        let (low, high) = (&shape.low, &shape.high);
        // Rounding the offset to whole metres costs half a metre on each side.
        let reach_m = ((high - low) / 2.0).amax() + 1.0;
        let mut step_m = CLOUD_STEP_M;
        while step_m * f64::from(i32::MAX) < reach_m && reach_m.is_finite() {
            step_m *= 10.0;
        }
        let middle = low + (high - low) / 2.0;
        Self::open(path, middle, step_m, shape)
    }

    fn open(path: &Path, offset_m: Vec3, step_m: f64, shape: &CloudShape) -> Result<Self> {
        let CloudShape {
            has_time,
            clock,
            dimensions,
            ..
        } = shape;
        let (has_time, clock) = (*has_time, *clock);
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
        // The extended point formats require WKT for any coordinate reference system.
        builder.has_wkt_crs = true;
        if matches!(clock, CloudClock::AdjustedGps | CloudClock::Unix) {
            builder.gps_time_type = las::GpsTimeType::Standard;
        }
        builder.vlrs.extend(shape.wkt.as_deref().map(wkt_record));
        dimension::append(path, &mut builder, Vec::new(), dimensions)?;
        Ok(Self {
            path: path.to_owned(),
            out: LasOut::create(path, builder)?,
            offset_m,
            step_m,
            has_time,
            clock,
            scanner: dimensions.iter().position(|d| d.name == SCANNER),
            dimensions: dimensions.clone(),
            extra: Vec::new(),
        })
    }

    /// Appends a point in the world frame (m) with its time, its intensity (rounded into 0 to
    /// 65535) and the number of its scanner.
    ///
    /// # Errors
    /// A point that is too far from the offset or not finite, a file that cannot be written.
    pub fn write(&mut self, point: &Vec3, time_s: f64, intensity: f32, scanner: u16) -> Result<()> {
        self.write_with(point, time_s, intensity, scanner, &[])
    }

    /// As [`CloudWriter::write`], with the values of the dimensions; missing ones are NaN.
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
        // `as` saturates and converts NaN to 0.
        record[12..14].copy_from_slice(&(intensity.round() as u16).to_le_bytes());
        let user_data = u8::try_from(scanner).unwrap_or(u8::MAX);
        // First of one return; flags, class and scan angle stay 0.
        let length = if self.has_time {
            record[14] = 0x11;
            record[17] = user_data;
            record[20..22].copy_from_slice(&scanner.to_le_bytes());
            let time_s = match self.clock {
                CloudClock::Unix => gps_from_unix_s(time_s) - GPS_ADJUSTMENT_S,
                _ => time_s,
            };
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

    /// Writes buffered data and completes the header.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self) -> Result<()> {
        self.out.finish()
    }
}

impl CloudSink for CloudWriter {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        let scanner = self.scanner.and_then(|at| point.values.get(at));
        // `as` saturates and converts NaN to 0.
        let scanner = scanner.map_or(0, |number| *number as u16);
        let CloudPoint {
            position,
            time_s,
            intensity,
            values,
        } = point;
        self.write_with(position, *time_s, *intensity, scanner, values)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        CloudWriter::finish(*self)
    }
}

fn wkt_record(wkt: &str) -> las::Vlr {
    let mut data = wkt.as_bytes().to_vec();
    data.push(0);
    las::Vlr {
        user_id: "LASF_Projection".to_owned(),
        record_id: WKT_RECORD,
        description: "OGC coordinate system WKT".to_owned(),
        data,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::crs_wkt;
    use crate::format::las_extra::dimension::ExtraKind;

    const WKT: &str = "PROJCS[\"ETRS89 / UTM zone 32N\"]";

    fn written(path: &Path, times_s: [f64; 2]) -> las::Reader {
        let shape = CloudShape {
            has_time: true,
            clock: CloudClock::of_span(times_s[0], times_s[1]),
            dimensions: vec![
                ExtraDimension::new("scanner", ExtraKind::U32, ""),
                ExtraDimension::new("pose_sigma_m", ExtraKind::F32, ""),
            ],
            wkt: Some(WKT.to_owned()),
            ..CloudShape::default()
        };
        let mut writer = CloudWriter::spanning(path, &shape).unwrap();
        for (number, time_s) in times_s.into_iter().enumerate() {
            let point = CloudPoint {
                position: Vec3::new(0.25, 0.5, number as f64),
                time_s,
                intensity: 7.0,
                values: &[300.0 + number as f64, 0.002],
            };
            writer.push(&point).unwrap();
        }
        CloudSink::finish(Box::new(writer)).unwrap();
        las::Reader::from_path(path).unwrap()
    }

    #[test]
    fn times_are_flagged_as_what_they_are() {
        use las::GpsTimeType::{Standard, Week};
        let folder = tempfile::tempdir().unwrap();
        // 2023-11-14 22:13:20 UTC is 1 384 035 218 s after the beginning of GPS time.
        let cases = [
            ([10.0, 20.0], Week, 10.0),
            ([1.7e9, 1.7e9 + 1.0], Standard, 384_035_218.0),
            ([-3.0, 20.0], Week, -3.0),
        ];
        for (times_s, flag, first_s) in cases {
            let mut reader = written(&folder.path().join("a.laz"), times_s);
            assert_eq!(reader.header().gps_time_type(), flag);
            let points: Vec<las::Point> = reader.points().map(|point| point.unwrap()).collect();
            assert_eq!(points[0].gps_time, Some(first_s));
            let scanners: Vec<u16> = points.iter().map(|point| point.point_source_id).collect();
            assert_eq!(scanners, [300, 301]);
        }
    }

    #[test]
    fn the_coordinate_system_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        written(&path, [0.0, 1.0]);
        assert_eq!(crs_wkt(&path).unwrap().as_deref(), Some(WKT));
        CloudWriter::create(&path, Vec3::zeros())
            .unwrap()
            .finish()
            .unwrap();
        assert_eq!(crs_wkt(&path).unwrap(), None);
    }
}
