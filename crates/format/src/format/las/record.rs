//! The records of points, their times, and the grid of whole steps on which a LAS file stores coordinates.

use std::path::Path;

use crate::error::{Error, Result};
use crate::format::cloud::sink::{CloudClock, CloudGrid, CloudShape};
use crate::format::text::civil::{gps_from_unix_s, unix_from_gps_s};
use crate::geometry::Vec3;

/// Bytes of a point of format 6 without extra bytes, and of format 0, which has no time.
pub(crate) const RECORD: usize = 30;
const TIMELESS_RECORD: usize = 20;

/// GPS time counts from 1980-01-06; its adjusted form is smaller by this, seconds.
const GPS_ADJUSTMENT_S: f64 = 1e9;

/// The dimension whose values are also those of `point_source_id`.
pub(crate) const SCANNER: &str = "scanner";

/// The time of a point as LAS stores it: Unix times become adjusted standard GPS time.
pub(crate) fn gps_time_s(clock: CloudClock, time_s: f64) -> f64 {
    match clock {
        CloudClock::Unix => gps_from_unix_s(time_s) - GPS_ADJUSTMENT_S,
        _ => time_s,
    }
}

/// The Unix time of a point with adjusted standard GPS time.
pub(crate) fn unix_from_adjusted_gps_s(time_s: f64) -> f64 {
    unix_from_gps_s(time_s + GPS_ADJUSTMENT_S)
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

    /// For points between `low` and `high`, metres: the step is `finest_m`, or the smallest power
    /// of ten times it for which 32 bits span the points.
    ///
    /// # Errors
    /// Bounds that are not finite.
    pub(crate) fn spanning(path: &Path, low: &Vec3, high: &Vec3, finest_m: f64) -> Result<Self> {
        // Rounding the offset to whole metres costs half a metre on each side.
        let reach_m = ((high - low) / 2.0).amax() + 1.0;
        let mut step_m = finest_m;
        while step_m * f64::from(i32::MAX) < reach_m && reach_m.is_finite() {
            step_m *= 10.0;
        }
        Self::at(path, &(low + (high - low) / 2.0), step_m)
    }

    /// For a cloud of this shape: its grid if it has one, or a grid that spans its coordinates.
    ///
    /// # Errors
    /// Bounds that are not finite.
    pub(crate) fn of(path: &Path, shape: &CloudShape, finest_m: f64) -> Result<Self> {
        match shape.grid {
            Some(CloudGrid { offset_m, step_m }) => Ok(Self { offset_m, step_m }),
            None => Self::spanning(path, &shape.low, &shape.high, finest_m),
        }
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
                "{}: the point ({}, {}, {}) m at {time_s} s lies more than {:.0} m from \
                 ({}, {}, {}) m",
                path.display(),
                point.x,
                point.y,
                point.z,
                self.step_m * f64::from(i32::MAX),
                self.offset_m.x,
                self.offset_m.y,
                self.offset_m.z,
            ),
            "check the coordinates: a LAS file spans 2³² of its steps at most",
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
