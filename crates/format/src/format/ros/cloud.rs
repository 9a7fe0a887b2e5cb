//! Points of `sensor_msgs/PointCloud2` and `sensor_msgs/LaserScan` in the frame of the scanner.
//!
//! The type of the time field determines the time of a point of a cloud:
//! - integers of 32 bits are nanoseconds since the stamp of the header (Ouster `t`, Livox
//!   `offset_time`, Aeva `time_offset_ns`), those of 2³¹ and more before it;
//! - floating-point numbers of 32 bits are seconds since the stamp (Velodyne `time`), negative if the
//!   stamp is that of the end of the cloud;
//! - floating-point numbers of 64 bits are seconds since the stamp if none exceeds 10, otherwise
//!   absolute times in the power of 1000 of a second that brings them nearest to the stamp (seconds:
//!   Hesai and RoboSense `timestamp`; nanoseconds: Livox `timestamp`);
//! - `utc_time` is in whole seconds, with the milliseconds `ms_time` (O-Net).
//!
//! Without such a field every point has the time of the header, but a field whose name tells of a time must be known or
//! named in the project. Points that are not finite, or zero in all coordinates, were not measured.

use super::messages::{LaserScan, PointCloud2};
use super::timed::{Lost, TimedPoints};
use super::wire::{Decoded, Fault};
use crate::format::binary::Number;
use crate::format::input::PointTimes;
use crate::geometry::Vec3;
use crate::sensor::ScanPoint;

/// The names of time fields; an earlier name is preferred.
const TIME_NAMES: [&str; 10] = [
    "t",
    "time",
    "timestamp",
    "time_stamp",
    "offset_time",
    "time_offset",
    "time_offset_ns",
    "offset_ns",
    "point_time_offset",
    "t_offset",
];
/// A time in whole seconds, and its milliseconds.
const SECONDS_NAMES: [&str; 2] = ["utc_time", "ms_time"];
/// Parts of the names of other fields that tell of a time.
const TIME_WORDS: [&str; 5] = ["time", "stamp", "nsec", "usec", "msec"];
/// Beginnings of them.
const TIME_STARTS: [&str; 2] = ["t_", "ts"];
/// The names of intensity fields; an earlier name is preferred.
const INTENSITY_NAMES: [&str; 2] = ["intensity", "reflectivity"];
/// One in so many points of a cloud may have a wild time.
const FEW_WILD: usize = 4;
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
            let named = self.fields.iter().position(|f| f.name == name.as_bytes());
            if let Some(index) = named {
                return self.layout(name, index).map(Some);
            }
        }
        Ok(None)
    }

    /// Where a point has the field with this index, called `name`.
    fn layout(&self, name: &'static str, index: usize) -> Decoded<PointField<'static>> {
        let field = &self.fields[index];
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
        Ok(PointField {
            name,
            offset,
            number,
            big_endian: self.is_big_endian,
        })
    }

    /// Like [`field`](Self::field), for a coordinate, which must exist.
    fn axis(&self, name: &'static str) -> Decoded<PointField<'static>> {
        self.field(&[name])?.ok_or_else(|| {
            Fault::new(
                format!("points with the fields {}", self.names()),
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

    /// The field with the times: that which the user names, or one with a known name.
    fn time_field(&self, how: &PointTimes) -> Decoded<Option<PointField<'static>>> {
        let Some(wanted) = &how.field else {
            return self.field(&TIME_NAMES);
        };
        let named = self
            .fields
            .iter()
            .position(|field| field.name == wanted.as_bytes());
        let Some(index) = named else {
            return Err(Fault::asked(
                format!("points without the field {wanted}"),
                format!("`point_time_field` of the scanner: one of {}", self.names()),
            ));
        };
        self.layout("named for the time", index).map(Some)
    }

    /// The names of all fields, the first 20 of them.
    fn names(&self) -> String {
        let names = self.fields.iter().take(20);
        let names = names.map(|f| String::from_utf8_lossy(&f.name[..f.name.len().min(40)]));
        names.collect::<Vec<_>>().join(", ")
    }

    /// Asks for the meaning of a field whose name tells of a time.
    fn ask_for_time(&self) -> Decoded<()> {
        let tells = |field: &&super::messages::Field<'_>| {
            let name = String::from_utf8_lossy(field.name).to_lowercase();
            TIME_WORDS.iter().any(|word| name.contains(word))
                || TIME_STARTS.iter().any(|start| name.starts_with(start))
        };
        match self.fields.iter().find(tells) {
            None => Ok(()),
            Some(field) => {
                let name = String::from_utf8_lossy(&field.name[..field.name.len().min(40)]);
                Err(Fault::asked(
                    format!("points with the field {name}, whose meaning is not known"),
                    "`point_time_field` and `point_time_unit` of the scanner in the project, if it is the time of the \
                     point, or `point_time_field = \"\"` if points have no times",
                ))
            }
        }
    }

    /// The points in time order, at most `most`.
    pub(super) fn points(&self, most: usize, how: &PointTimes) -> Decoded<TimedPoints> {
        let count = (self.width as usize).saturating_mul(self.height as usize);
        let records = self.records()?;
        too_many(count, most)?;
        if count == 0 {
            return Ok(TimedPoints::of(Vec::new()));
        }
        let axes = [self.axis("x")?, self.axis("y")?, self.axis("z")?];
        let intensity = self.field(&INTENSITY_NAMES)?;
        let is_timeless = how.field.as_deref() == Some("");
        let in_seconds = SECONDS_NAMES.map(|name| self.field(&[name]));
        let [seconds, milliseconds] = in_seconds;
        let (seconds, milliseconds) = (seconds?, milliseconds?);
        let time = match (is_timeless, seconds) {
            (true, _) => None,
            (false, Some(seconds)) if how.field.is_none() && milliseconds.is_some() => {
                Some(seconds)
            }
            _ => self.time_field(how)?,
        };
        if time.is_none() && !is_timeless {
            self.ask_for_time()?;
        }
        let fraction = milliseconds.filter(|_| time.is_some_and(|t| t.name == SECONDS_NAMES[0]));
        let mut points = Vec::with_capacity(count);
        let mut lost = Lost::default();
        for record in records {
            let [x, y, z] = axes.map(|axis| axis.value_in(record));
            let position_m = Vec3::new(x, y, z);
            if !crate::geometry::is_finite(&position_m) {
                lost.unplaced += 1;
                continue;
            }
            if position_m == Vec3::zeros() {
                lost.at_scanner += 1;
                continue;
            }
            let fraction_s = fraction.map_or(0.0, |field| 1e-3 * field.value_in(record));
            // In the unit of the file until all times are known.
            let time_s = time.map_or(0.0, |time| time.value_in(record)) + fraction_s;
            if !time_s.is_finite() {
                lost.untimed += 1;
                continue;
            }
            points.push(ScanPoint {
                time_s,
                position_m,
                intensity: intensity.map_or(0.0, |field| field.value_in(record) as f32),
            });
        }
        let mut converted = Converted::default();
        match time {
            Some(time) if fraction.is_none() => {
                converted = self.convert_times(time, how.unit_s, &mut points)?;
            }
            Some(_) => {}
            None => points.iter_mut().for_each(|p| p.time_s = self.time_s),
        }
        lost.untimed += leave_out_wild(&mut points);
        // Rows are often the rings of the scanner, which measure at the same time.
        points.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let mut timed = TimedPoints::of(points);
        timed.wrapped = converted.wrapped;
        timed.lasts_s = converted.lasts_s;
        timed.are_alike = !is_timeless
            && timed.has_one_time()
            && converted.lasts_s.is_none_or(|lasts_s| lasts_s == 0.0);
        timed.lost = lost;
        Ok(timed)
    }

    /// Converts the times of the points from those of the file to seconds.
    fn convert_times(
        &self,
        time: PointField<'_>,
        unit_s: Option<f64>,
        points: &mut [ScanPoint],
    ) -> Decoded<Converted> {
        let mut wrapped = 0;
        if matches!(time.number, Number::U32) {
            const HALF: f64 = (1u64 << 31) as f64;
            for point in points.iter_mut().filter(|point| point.time_s >= HALF) {
                point.time_s -= 2.0 * HALF;
                wrapped += 1;
            }
        }
        let mut sizes: Vec<f64> = points.iter().map(|p| p.time_s.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        // Without those that may be wild.
        let highest = sizes.len().checked_sub(1 + sizes.len() / FEW_WILD);
        let highest = highest.map_or(0.0, |at| sizes[at]);
        let unit = match (unit_s, time.number) {
            (Some(unit_s), _) if highest * unit_s <= LONGEST_CLOUD_S => Some((self.time_s, unit_s)),
            (Some(unit_s), _) => Some((0.0, unit_s)),
            (None, Number::I32 | Number::U32) => Some((self.time_s, 1e-9)),
            (None, Number::F32 | Number::F64) if highest <= LONGEST_CLOUD_S => {
                Some((self.time_s, 1.0))
            }
            (None, Number::F64) => unit_of_absolute(highest, self.time_s).map(|unit| (0.0, unit)),
            _ => None,
        };
        let Some((zero_s, unit_s)) = unit else {
            return Err(Fault::asked(
                format!(
                    "the field {} ({:?}) with the value {highest}",
                    time.name, time.number
                ),
                "nanoseconds since the stamp as 32-bit integers, seconds since the stamp below \
                 10 s, or absolute times as FLOAT64; or `point_time_unit` of the scanner in the project",
            ));
        };
        // Beside a stamp since 1970, f64 does not resolve nanoseconds.
        let times = points.iter().map(|point| point.time_s);
        let lasts =
            times.clone().fold(f64::NEG_INFINITY, f64::max) - times.fold(f64::INFINITY, f64::min);
        for point in points {
            point.time_s = zero_s + point.time_s * unit_s;
        }
        let is_in_ns = matches!(time.number, Number::I32 | Number::U32) && unit_s == 1e-9;
        Ok(Converted {
            wrapped,
            lasts_s: is_in_ns.then_some(lasts * unit_s),
        })
    }
}

/// What was found when times were converted.
#[derive(Debug, Clone, Copy, Default)]
struct Converted {
    /// Number of times that lie before the stamp as numbers without a sign.
    wrapped: usize,
    /// From the first to the last, seconds, if they were taken for nanoseconds.
    lasts_s: Option<f64>,
}

/// Leaves out the few points with times far from those of the others, and returns their number; if there are many,
/// none.
fn leave_out_wild(points: &mut Vec<ScanPoint>) -> u64 {
    let mut times: Vec<f64> = points.iter().map(|point| point.time_s).collect();
    times.sort_by(f64::total_cmp);
    let Some(middle_s) = times.get(times.len() / 2) else {
        return 0;
    };
    let is_wild = |point: &ScanPoint| (point.time_s - middle_s).abs() > LONGEST_CLOUD_S;
    let wild = points.iter().filter(|point| is_wild(point)).count();
    if wild > points.len() / FEW_WILD {
        return 0;
    }
    points.retain(|point| !is_wild(point));
    wild as u64
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
mod tests;
