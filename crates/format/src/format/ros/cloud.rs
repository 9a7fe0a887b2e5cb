//! Points of `sensor_msgs/PointCloud2` and `sensor_msgs/LaserScan` in the frame of the scanner.
//!
//! The type of the time field determines the time of a point of a cloud:
//! - integers of 32 bits are nanoseconds since the stamp of the header (Ouster `t`, Livox
//!   `offset_time`);
//! - floating-point numbers of 32 bits are seconds since the stamp (Velodyne `time`), negative if the
//!   stamp is that of the end of the cloud;
//! - floating-point numbers of 64 bits are seconds since the stamp if none exceeds 10, otherwise
//!   absolute times in the power of 1000 of a second that brings them nearest to the stamp (seconds:
//!   Hesai and RoboSense `timestamp`; nanoseconds: Livox `timestamp`).
//!
//! Without such a field every point has the time of the header. Points that are not finite, or zero
//! in all coordinates, were not measured.

use super::messages::{LaserScan, PointCloud2};
use super::wire::{Decoded, Fault};
use crate::format::binary::Number;
use crate::geometry::Vec3;
use crate::sensor::ScanPoint;

/// The names of time fields; an earlier name is preferred.
const TIME_NAMES: [&str; 5] = ["t", "time", "timestamp", "time_stamp", "offset_time"];
/// The names of intensity fields; an earlier name is preferred.
const INTENSITY_NAMES: [&str; 2] = ["intensity", "reflectivity"];
/// More seconds than the points of any cloud span.
const LONGEST_CLOUD_S: f64 = 10.0;

/// A field of the points that is read.
#[derive(Clone, Copy)]
struct PointField<'a> {
    name: &'a str,
    offset: usize,
    number: Number,
    big_endian: bool,
}

impl PointField<'_> {
    /// The value of the field in a point, which must contain the field.
    fn value_in(&self, point: &[u8]) -> f64 {
        self.number.read(&point[self.offset..], self.big_endian)
    }
}

/// The number type of a field of a cloud.
fn number(datatype: u8) -> Option<Number> {
    Some(match datatype {
        1 => Number::I8,
        2 => Number::U8,
        3 => Number::I16,
        4 => Number::U16,
        5 => Number::I32,
        6 => Number::U32,
        7 => Number::F32,
        8 => Number::F64,
        _ => return None,
    })
}

impl<'a> PointCloud2<'a> {
    /// The first of the fields called `names` that the points have.
    fn field(&self, names: &[&'static str]) -> Decoded<Option<PointField<'static>>> {
        for name in names.iter().copied() {
            let Some(field) = self.fields.iter().find(|f| f.name == name.as_bytes()) else {
                continue;
            };
            let number = number(field.datatype).ok_or_else(|| {
                let found = format!("the field {name} of type {}", field.datatype);
                Fault::new(found, "a type from 1 (INT8) to 8 (FLOAT64)")
            })?;
            let offset = field.offset as usize;
            let step = self.point_step as usize;
            if offset.saturating_add(number.size()) > step {
                return Err(Fault::new(
                    format!("the field {name} at byte {offset} of a point of {step} bytes"),
                    "fields within the point",
                ));
            }
            return Ok(Some(PointField {
                name,
                offset,
                number,
                big_endian: self.is_big_endian,
            }));
        }
        Ok(None)
    }

    /// Like [`field`](Self::field), for a coordinate, which must exist.
    fn axis(&self, name: &'static str) -> Decoded<PointField<'static>> {
        self.field(&[name])?.ok_or_else(|| {
            let names: Vec<_> = self
                .fields
                .iter()
                .take(20)
                .map(|f| String::from_utf8_lossy(&f.name[..f.name.len().min(40)]))
                .collect();
            Fault::new(
                format!("points with the fields {}", names.join(", ")),
                "x, y, z",
            )
        })
    }

    /// The bytes of every point, after a check that all points exist.
    fn records(&self) -> Decoded<impl Iterator<Item = &'a [u8]> + use<'a>> {
        let (step, width) = (self.point_step as usize, self.width as usize);
        let (row_step, height) = (self.row_step as usize, self.height as usize);
        let row_bytes = step.checked_mul(width);
        // The row step of a cloud of one row is sometimes left at zero.
        let row_step = if height == 1 {
            row_step.max(row_bytes.unwrap_or(0))
        } else {
            row_step
        };
        let end = row_bytes.and_then(|row| match (height, width) {
            (0, _) | (_, 0) => Some(0),
            _ if row > row_step || step == 0 => None,
            _ => row_step.checked_mul(height - 1)?.checked_add(row),
        });
        let data = self.data;
        match (end, row_bytes) {
            (Some(end), Some(row)) if end <= data.len() => {
                let rows = if end == 0 { 0 } else { height };
                Ok((0..rows)
                    .flat_map(move |i| data[i * row_step..i * row_step + row].chunks_exact(step)))
            }
            _ => Err(Fault::new(
                format!(
                    "{height} rows ({row_step} bytes) of {width} points ({step} bytes) in {} bytes",
                    data.len()
                ),
                "as many bytes as the points need",
            )),
        }
    }

    /// The points in time order, at most `most`.
    pub(super) fn points(&self, most: usize) -> Decoded<Vec<ScanPoint>> {
        let count = (self.width as usize).saturating_mul(self.height as usize);
        let records = self.records()?;
        too_many(count, most)?;
        if count == 0 {
            return Ok(Vec::new());
        }
        let axes = [self.axis("x")?, self.axis("y")?, self.axis("z")?];
        let intensity = self.field(&INTENSITY_NAMES)?;
        let time = self.field(&TIME_NAMES)?;
        let mut points = Vec::with_capacity(count);
        for record in records {
            let [x, y, z] = axes.map(|axis| axis.value_in(record));
            let position_m = Vec3::new(x, y, z);
            if !crate::geometry::is_finite(&position_m) || position_m == Vec3::zeros() {
                continue;
            }
            points.push(ScanPoint {
                // In the unit of the file until all times are known.
                time_s: time.map_or(0.0, |time| time.value_in(record)),
                position_m,
                intensity: intensity.map_or(0.0, |field| field.value_in(record) as f32),
            });
        }
        self.convert_times(time, &mut points)?;
        // Rows are often the rings of the scanner, which measure at the same time.
        points.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(points)
    }

    /// Converts the times of the points from those of the file to seconds.
    fn convert_times(&self, time: Option<PointField<'_>>, points: &mut [ScanPoint]) -> Decoded<()> {
        let Some(time) = time else {
            points.iter_mut().for_each(|p| p.time_s = self.time_s);
            return Ok(());
        };
        let highest = points.iter().map(|p| p.time_s.abs());
        // `f64::max` would skip NaN.
        let highest = highest.fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a });
        let unit = match time.number {
            Number::I32 | Number::U32 => Some((self.time_s, 1e-9)),
            Number::F32 | Number::F64 if highest <= LONGEST_CLOUD_S => Some((self.time_s, 1.0)),
            Number::F64 => unit_of_absolute(highest, self.time_s).map(|unit| (0.0, unit)),
            _ => None,
        };
        let Some((zero_s, unit_s)) = unit else {
            return Err(Fault::new(
                format!(
                    "the field {} ({:?}) with the value {highest}",
                    time.name, time.number
                ),
                "nanoseconds since the stamp as 32-bit integers, seconds since the stamp below \
                 10 s, or absolute times as FLOAT64",
            ));
        };
        for point in points {
            point.time_s = zero_s + point.time_s * unit_s;
        }
        Ok(())
    }
}

/// The unit, in seconds, that brings an absolute time near `stamp_s`. If the clocks differ, the
/// magnitude decides, for times since 1970 or 1980.
fn unit_of_absolute(time: f64, stamp_s: f64) -> Option<f64> {
    const UNITS_S: [f64; 4] = [1.0, 1e-3, 1e-6, 1e-9];
    let is_near = |unit: &&f64| (0.5..2.0).contains(&(time * **unit / stamp_s));
    let is_date = |unit: &&f64| (1e8..1e11).contains(&(time * **unit));
    let near = UNITS_S.iter().find(is_near);
    near.or_else(|| UNITS_S.iter().find(is_date)).copied()
}

impl LaserScan {
    /// The points in the x-y plane of the scanner in time order, at most `most`. Ranges outside the
    /// limits of the message are left out: they were not measured.
    pub(super) fn points(&self, most: usize) -> Decoded<Vec<ScanPoint>> {
        let count = self.ranges_m.len();
        too_many(count, most)?;
        let numbers = [
            self.angle_min_rad,
            self.angle_increment_rad,
            self.time_increment_s,
        ];
        if !numbers.iter().all(|v| v.is_finite()) {
            return Err(Fault::new(
                format!("angle, angle increment and time increment {numbers:?}"),
                "finite numbers",
            ));
        }
        let limits = self.range_min_m..=self.range_max_m;
        let has_limits = self.range_max_m > self.range_min_m;
        let mut points = Vec::with_capacity(count);
        for (i, range_m) in self.ranges_m.iter().copied().enumerate() {
            let is_measured = range_m.is_finite() && range_m > 0.0;
            if !is_measured || (has_limits && !limits.contains(&range_m)) {
                continue;
            }
            let (sin, cos) = (self.angle_min_rad + i as f64 * self.angle_increment_rad).sin_cos();
            points.push(ScanPoint {
                time_s: self.time_s + i as f64 * self.time_increment_s,
                position_m: Vec3::new(range_m * cos, range_m * sin, 0.0),
                intensity: self.intensities.get(i).map_or(0.0, |v| *v as f32),
            });
        }
        points.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(points)
    }
}

/// Checks that there are no more points than the size of the file allows.
fn too_many(count: usize, most: usize) -> Decoded<()> {
    if count <= most {
        return Ok(());
    }
    Err(Fault::new(
        format!("a cloud of {count} points"),
        format!("at most {most} in a file of this size"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_of_absolute_times_follows_from_the_stamp_then_from_their_size() {
        for (time, stamp_s, expected) in [
            (1.7e9, 1.7e9, Some(1.0)),
            (1.7e12, 1.7e9, Some(1e-3)),
            (1.7e18, 1.7e9, Some(1e-9)),
            // Times since the start of the scanner, like the stamp.
            (1.2e12, 1200.0, Some(1e-9)),
            (1.2e9, 1200.0, Some(1e-6)),
            // A clock other than the stamp's, or no stamp.
            (1.7e15, 1200.0, Some(1e-6)),
            (1.7e18, 0.0, Some(1e-9)),
            (5e4, 0.0, None),
            (f64::NAN, 1.0, None),
        ] {
            assert_eq!(unit_of_absolute(time, stamp_s), expected, "{time}");
        }
    }
}
