//! The records of points, their times, and the grid of whole steps on which a LAS file stores coordinates.

use std::path::Path;

use crate::error::{Error, Result};
use crate::format::cloud::sink::{CLOUD_STEP_M, CloudClock, CloudGrid, CloudShape};
use crate::format::text::civil::adjusted_gps_from_unix_s;
use crate::geometry::Vec3;

/// Bytes of a point of format 6 without extra bytes, and of format 0, which has no time.
pub(crate) const RECORD: usize = 30;
const TIMELESS_RECORD: usize = 20;

/// The dimension whose values are also those of `point_source_id`.
pub(crate) const SCANNER: &str = "scanner";

/// The time of a point as LAS stores it: Unix times become adjusted standard GPS time.
pub(crate) fn gps_time_s(clock: CloudClock, time_s: f64) -> f64 {
    match clock {
        CloudClock::Unix => adjusted_gps_from_unix_s(time_s),
        _ => time_s,
    }
}

/// Refuses a time that readers would refuse.
///
/// # Errors
/// A time that is not finite.
pub(crate) fn check_time(path: &Path, time_s: f64) -> Result<()> {
    if time_s.is_finite() {
        Ok(())
    } else {
        Err(Error::data(
            format!("{}: a point at {time_s} s", path.display()),
            "give every point a finite time",
        ))
    }
}

/// Whether times of this clock are flagged as adjusted standard GPS time; all others are flagged as time of the GPS
/// week.
pub(crate) fn is_adjusted_gps(clock: CloudClock) -> bool {
    matches!(clock, CloudClock::AdjustedGps | CloudClock::Unix)
}

/// The record of a coordinate reference system (LAS 1.4, "OGC coordinate system WKT").
pub(crate) fn wkt_record(wkt: &str) -> las::Vlr {
    let mut data = wkt.as_bytes().to_vec();
    data.push(0);
    las::Vlr {
        user_id: "LASF_Projection".to_owned(),
        record_id: 2112,
        description: "OGC coordinate system WKT".to_owned(),
        data,
    }
}

/// Offset and step of the coordinates of a file: a coordinate is the offset plus a whole 32-bit
/// number of steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placement {
    /// Metres.
    pub(crate) offset_m: Vec3,
    /// Metres, the same for all axes.
    pub(crate) step_m: f64,
}

impl Placement {
    /// The offset is rounded to whole metres.
    ///
    /// # Errors
    /// An offset that is not finite.
    pub(crate) fn at(path: &Path, offset_m: &Vec3, step_m: f64) -> Result<Self> {
        let offset_m = offset_m.map(f64::round);
        if !offset_m.iter().all(|v| v.is_finite()) {
            return Err(Error::data(
                format!("{}: the offset of a cloud is not finite", path.display()),
                "check the positions of the trajectory",
            ));
        }
        Ok(Self { offset_m, step_m })
    }

    /// For a cloud of this shape: its grid if it has one, or steps of [`CLOUD_STEP_M`] around its middle. If these do
    /// not reach all points, the middle is the median, so that the far points are refused and not the others.
    ///
    /// # Errors
    /// Bounds that are not finite.
    pub(crate) fn of(path: &Path, shape: &CloudShape) -> Result<Self> {
        if let Some(CloudGrid { offset_m, step_m }) = shape.grid {
            return Ok(Self { offset_m, step_m });
        }
        let middle_m = shape.low + (shape.high - shape.low) / 2.0;
        Self::at(path, &shape.median.unwrap_or(middle_m), CLOUD_STEP_M)
    }

    /// The steps of a point in the world frame (m) from the offset.
    ///
    /// # Errors
    /// A point that is too far from the offset or not finite.
    pub(crate) fn steps(&self, path: &Path, point: &Vec3, time_s: f64) -> Result<[i32; 3]> {
        let steps = (point - self.offset_m).map(|v| (v / self.step_m).round());
        // Written so that NaN fails as well.
        if !steps.iter().all(|v| v.abs() <= f64::from(i32::MAX)) {
            return Err(self.too_far(path, point, time_s));
        }
        Ok([steps.x as i32, steps.y as i32, steps.z as i32])
    }

    fn too_far(&self, path: &Path, point: &Vec3, time_s: f64) -> Error {
        Error::data(
            format!(
                "{}: the point ({}, {}, {}) m{} lies more than {:.0} m from ({}, {}, {}) m",
                path.display(),
                point.x,
                point.y,
                point.z,
                if time_s.is_finite() {
                    format!(" at {time_s} s")
                } else {
                    String::new()
                },
                self.step_m * f64::from(i32::MAX),
                self.offset_m.x,
                self.offset_m.y,
                self.offset_m.z,
            ),
            "leave such points out: a LAS file spans 2³² of its steps at most, 43 km with steps of 0.01 mm; E57, PLY, Parquet \
             and CSV hold any distance",
        )
    }

    /// Transforms of a header.
    pub(crate) fn transforms(&self) -> las::Vector<las::Transform> {
        let axis = |offset| las::Transform {
            scale: self.step_m,
            offset,
        };
        las::Vector {
            x: axis(self.offset_m.x),
            y: axis(self.offset_m.y),
            z: axis(self.offset_m.z),
        }
    }
}

/// Appends the standard fields of a point to `into`, as format 6 with a time and as format 0
/// without one. The point is return 1 of 1; the intensity is rounded into 0 to 65535; the number of
/// the scanner becomes the point source and, up to 255, the user data. Flags, class and scan angle
/// are 0.
pub(crate) fn append_record(
    steps: [i32; 3],
    time_s: Option<f64>,
    intensity: f32,
    scanner: u16,
    into: &mut Vec<u8>,
) {
    let mut record = [0; RECORD];
    for (place, v) in record.chunks_exact_mut(4).zip(steps) {
        place.copy_from_slice(&v.to_le_bytes());
    }
    // `as` saturates and converts NaN to 0.
    record[12..14].copy_from_slice(&(intensity.round() as u16).to_le_bytes());
    record[17] = u8::try_from(scanner).unwrap_or(u8::MAX);
    match time_s {
        Some(time_s) => {
            record[14] = 0x11;
            record[20..22].copy_from_slice(&scanner.to_le_bytes());
            record[22..30].copy_from_slice(&time_s.to_le_bytes());
            into.extend_from_slice(&record);
        }
        None => {
            record[14] = 0x09;
            record[18..20].copy_from_slice(&scanner.to_le_bytes());
            into.extend_from_slice(&record[..TIMELESS_RECORD]);
        }
    }
}
