//! Clouds written point by point as LAS or LAZ.

use std::path::{Path, PathBuf};

use crate::error::Result;
use crate::format::cloud::sink::{CLOUD_STEP_M, CloudClock, CloudPoint, CloudShape, CloudSink};
use crate::format::las::batches::{LasOut, is_compressed};
use crate::format::las::extra::dimension::{self, ExtraDimension};
use crate::format::las::record::{
    Placement, SCANNER, append_record, check_time, gps_time_s, is_adjusted_gps, wkt_record,
};
use crate::format::las::value::ExtraValue;
use crate::geometry::Vec3;

/// Writes a LAS 1.4 file of point format 6, compressed if its name ends in `.laz`: position, GPS
/// time, intensity, the scanner's number as `point_source_id` and, up to 255, as `user_data`, and
/// further named values on request. Unix times become adjusted standard GPS time, and the header
/// says so; all others are unchanged and flagged as seconds of the GPS week. The same points give
/// the same bytes.
pub struct CloudWriter {
    path: PathBuf,
    out: LasOut,
    placement: Placement,
    has_time: bool,
    clock: CloudClock,
    dimensions: Vec<ExtraDimension>,
    /// Index of the dimension that holds the scanner's number.
    scanner: Option<usize>,
    record: Vec<u8>,
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
    /// As [`CloudWriter::create`]; names of dimensions that LAS does not allow.
    pub fn around(path: &Path, offset_m: Vec3, shape: &CloudShape) -> Result<Self> {
        let shape = CloudShape {
            has_time: true,
            ..shape.clone()
        };
        Self::open(path, Placement::at(path, &offset_m, CLOUD_STEP_M)?, &shape)
    }

    /// Creates or replaces the file for a cloud of this shape. Coordinates are on its grid, or rounded to
    /// [`CLOUD_STEP_M`]; a point that this step does not reach is refused. Without times the
    /// point format is 0, which has none.
    ///
    /// # Errors
    /// As [`CloudWriter::create`]; names of dimensions that LAS does not allow.
    pub fn spanning(path: &Path, shape: &CloudShape) -> Result<Self> {
        let placement = Placement::of(path, shape)?;
        Self::open(path, placement, shape)
    }

    fn open(path: &Path, placement: Placement, shape: &CloudShape) -> Result<Self> {
        let CloudShape {
            has_time,
            clock,
            dimensions,
            ..
        } = shape;
        let (has_time, clock) = (*has_time, *clock);
        let is_compressed = is_compressed(path)?;
        dimension::check(path, dimensions)?;
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
        builder.transforms = placement.transforms();
        // The extended point formats require WKT for any coordinate reference system.
        builder.has_wkt_crs = true;
        if is_adjusted_gps(clock) {
            builder.gps_time_type = las::GpsTimeType::Standard;
        }
        builder.vlrs.extend(shape.wkt.as_deref().map(wkt_record));
        dimension::append(path, &mut builder, Vec::new(), dimensions)?;
        Ok(Self {
            path: path.to_owned(),
            out: LasOut::create(path, builder)?,
            placement,
            has_time,
            clock,
            scanner: dimensions.iter().position(|d| d.name == SCANNER),
            dimensions: dimensions.clone(),
            record: Vec::new(),
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
    /// As [`CloudWriter::write`].
    pub fn write_with(
        &mut self,
        point: &Vec3,
        time_s: f64,
        intensity: f32,
        scanner: u16,
        values: &[ExtraValue],
    ) -> Result<()> {
        let steps = self.placement.steps(&self.path, point, time_s)?;
        if self.has_time {
            check_time(&self.path, time_s)?;
        }
        let time_s = self.has_time.then(|| gps_time_s(self.clock, time_s));
        self.record.clear();
        append_record(steps, time_s, intensity, scanner, &mut self.record);
        for (at, dimension) in self.dimensions.iter().enumerate() {
            let value = values.get(at).copied().unwrap_or(ExtraValue::NONE);
            dimension.kind.append(value, &mut self.record);
        }
        self.out.push(&[&self.record])
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
        let scanner = scanner.map_or(0, |number| number.number() as u16);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::crs_wkt;
    use crate::format::las::extra::dimension::ExtraKind;

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
                values: &[300.0 + number as f64, 0.002].map(ExtraValue::Number),
            };
            writer.push(&point).unwrap();
        }
        CloudSink::finish(Box::new(writer)).unwrap();
        las::Reader::from_path(path).unwrap()
    }

    #[test]
    fn the_header_flags_the_kind_of_the_times() {
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
            let points = reader.read_points(2).unwrap();
            let points: Vec<las::Point> = points.points().map(|point| point.unwrap()).collect();
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
