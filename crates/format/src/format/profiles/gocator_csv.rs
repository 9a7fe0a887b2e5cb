//! Profiles of LMI Gocator line profile sensors, exported from recorded data as CSV (Gocator Line Profile Sensors User
//! Manual, "CSV Converter Tool", which describes version 2 of the file).
//!
//! The file consists of blocks. A block is a line with its name, lines of headers and values, and a line `End`.
//!
//! | block | content |
//! |---|---|
//! | `Info` | version of the file, trigger, resolutions |
//! | `DeviceInfo` | the sensors, and the transforms of their alignment |
//! | `Profile` | uniform spacing: x (mm) in the header, rows of z (mm) or of intensities |
//! | `RawProfile` | point cloud profiles: rows of x (mm), of z (mm) or of intensities |
//!
//! A block of profiles begins with `Frame Count, Column Count, X Offset, Y Offset, Z Offset` and their values. The next
//! header has `Frame, Source, Time, Encoder, Z Encoder, Inputs, Exposure, Y, Axis` and the columns of the profile; a
//! profile has one row for each `Axis`: `X`, `Z` or `I`. Other blocks (`Ranges`, `Part`, `Surface`, …) are skipped: a
//! surface has one time for all its lines.
//!
//! Two facts are not in the manual, but come from a file of a snapshot sensor with a block `Part`: a point that was not
//! measured is an empty cell, and coordinates contain the offsets of the block. Both are assumed for profiles too;
//! columns that do not begin at the X Offset are refused. `-`, which marks an absent value in `DeviceInfo`, is read as an
//! empty cell.
//!
//! # Frame
//! The axes are those of the sensor: x along the laser line, z towards the sensor; millimetres become metres, and the
//! origin is that of the file. `Y` is not read: a profile lies in the plane y = 0. The data are assumed to contain the
//! transform of the alignment. A transform that tilts the profile out of this plane is refused, because the file does
//! not have y of each point.
//!
//! # Times
//! The manufacturer gives the unit of the time stamps as 1/1.024 µs of the sensor's clock (knowledge base, "Unit of
//! timestamp in Gocator CSV export file", firmware 3 and 4; `GoStamp` of the SDK 5.3); the manual gives none. If the
//! interval of the first two profiles, read in microseconds, is a period of the trigger, microseconds are used instead.

use std::path::PathBuf;

use crate::error::{Error, Location, Result};
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::profiles::reader::ProfileReader;
use crate::format::text::lines::Lines;
use crate::geometry::Vec3;
use crate::sensor::{Continued, ScanPoint};
use blocks::{Layout, RAW, Row, check_rest, next_line, read_info, skip, tilt};

mod blocks;
#[cfg(test)]
mod tests;

/// The manufacturer's unit of time.
const TICK_S: f64 = 1e-6 / 1.024;
/// Relative tolerance within which a trigger rate fits a unit of time; the units differ by 0.024.
const RATE_SLACK: f64 = 0.005;

pub(crate) const EXPORT: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    profiles: Some(|path| Ok(Box::new(GocatorCsv::open(path)?))),
    frame: Frame::OfFile(|path| Ok(GocatorCsv::open(path)?.describe_frame())),
    note: "read as the manufacturer describes it: no file of a real line sensor with profiles was available",
    ..Kind::new("gocator-csv", "profiles (Gocator CSV export)")
};

/// Whether these are the first bytes of an export.
fn looks_like(start: &[u8]) -> bool {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let mut lines = start.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
    lines.next() == Some(b"Info")
        && lines
            .next()
            .is_some_and(|line| line.starts_with(b"CSV Version,"))
}

/// Reads an export in bounded memory.
struct GocatorCsv {
    path: PathBuf,
    lines: Lines,
    layout: Layout,
    tick_s: f64,
    /// The first row of the next profile.
    next: Option<Row>,
    has_ended: bool,
    source: Option<f64>,
    times: Continued,
    is_empty: bool,
}

impl GocatorCsv {
    fn open(input: &Input) -> Result<Self> {
        let mut reader = Self::at_rows(input)?.0;
        let (mut ahead, rate_hz) = Self::at_rows(input)?;
        if let Some(rate_hz) = rate_hz {
            reader.tick_s = ahead.tick_s(rate_hz)?;
        }
        Ok(reader)
    }

    /// Opens a file at the first row of its profiles; also returns the trigger rate, hertz.
    fn at_rows(input: &Input) -> Result<(Self, Option<f64>)> {
        let mut lines = Lines::open(input)?;
        let mut rate_hz = None;
        let mut tilt_error = None;
        let mut block_names = Vec::new();
        loop {
            if !lines.advance()? {
                return Err(Error::format(
                    input.path(),
                    Location::Whole,
                    format!("the blocks {}", block_names.join(", ")),
                    "a block Profile or RawProfile: surfaces and ranges have no profiles with times",
                ));
            }
            match lines.text().to_owned().as_str() {
                "" => {}
                "Info" => rate_hz = read_info(&mut lines)?,
                "DeviceInfo" => tilt_error = tilt(&mut lines)?,
                block @ ("Profile" | RAW) => {
                    if let Some(error) = tilt_error {
                        return Err(error);
                    }
                    let layout = Layout::read(&mut lines, block)?;
                    let reader = Self {
                        path: input.path().to_owned(),
                        lines,
                        layout,
                        tick_s: TICK_S,
                        next: None,
                        has_ended: false,
                        source: None,
                        times: Continued::default(),
                        is_empty: true,
                    };
                    return Ok((reader, rate_hz));
                }
                block => {
                    let block: String = block.chars().take(40).collect();
                    skip(&mut lines, &block)?;
                    if block_names.len() < 10 {
                        block_names.push(block);
                    }
                }
            }
        }
    }

    /// The unit of the time stamps, seconds: the manufacturer's, unless the interval of the first two profiles in
    /// microseconds is a period of the trigger.
    fn tick_s(&mut self, rate_hz: f64) -> Result<f64> {
        let Some(first) = self.next_row()? else {
            return Ok(TICK_S);
        };
        while let Some(row) = self.next_row()? {
            let frames = row.key[0] - first.key[0];
            if frames != 0.0 {
                let period_us = (row.key[2] - first.key[2]) / frames;
                let fits = (period_us * rate_hz * 1e-6 - 1.0).abs() < RATE_SLACK;
                return Ok(if fits { 1e-6 } else { TICK_S });
            }
        }
        Ok(TICK_S)
    }

    fn describe_frame(&self) -> String {
        let clock = if self.tick_s == TICK_S {
            "1/1.024 µs (the manufacturer's unit)"
        } else {
            "microseconds (derived from the trigger rate)"
        };
        format!(
            "millimetres (the format), times in {clock} of the sensor's clock; scanner frame: x along the laser line, \
             y = 0, z towards the sensor"
        )
    }

    /// The next row; `None` after the last one.
    fn next_row(&mut self) -> Result<Option<Row>> {
        if let Some(row) = self.next.take() {
            return Ok(Some(row));
        }
        if self.has_ended {
            return Ok(None);
        }
        next_line(&mut self.lines, "`End` of the profiles")?;
        if self.lines.text() != "End" {
            return self.layout.row(&self.lines).map(Some);
        }
        self.has_ended = true;
        check_rest(&mut self.lines)?;
        Ok(None)
    }

    /// Reads one profile and appends its points; false at the end of the profiles.
    fn next_profile(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        let Some(first) = self.next_row()? else {
            return Ok(false);
        };
        let [frame, source, ticks] = first.key;
        let key = first.key;
        let mut rows: [Option<Vec<f64>>; 3] = [None, None, None];
        let mut next = Some(first);
        while let Some(row) = next {
            if row.key != key {
                self.next = Some(row);
                break;
            }
            let slot = &mut rows[row.axis as usize];
            if slot.replace(row.values).is_some() {
                let found = format!("axis {:?} of frame {frame} twice", row.axis);
                return Err(self.lines.error(found, "each axis once in a profile"));
            }
            next = self.next_row()?;
        }
        let time_s = ticks * self.tick_s;
        let time_s = self.next_time_s(source, time_s)?;
        let [x_mm, z_mm, intensities] = rows;
        let (Some(x_mm), Some(z_mm)) = (x_mm.as_ref().or(self.layout.x_mm.as_ref()), z_mm) else {
            let found = format!("frame {frame} without a row of its coordinates");
            return Err(self
                .lines
                .error(found, "a row Z, and a row X for point cloud profiles"));
        };
        for (i, (x, z)) in x_mm.iter().zip(&z_mm).enumerate() {
            if x.is_nan() || z.is_nan() {
                continue;
            }
            let intensity = intensities.as_ref().map_or(0.0, |row| row[i]);
            into.push(ScanPoint {
                time_s,
                position_m: Vec3::new(x * 1e-3, 0.0, z * 1e-3),
                intensity: if intensity.is_nan() {
                    0.0
                } else {
                    intensity as f32
                },
            });
        }
        Ok(true)
    }

    /// The time of a profile, continued past midnight. Checks that the profile is not earlier than the last one and comes
    /// from the same sensor.
    fn next_time_s(&mut self, source: f64, time_s: f64) -> Result<f64> {
        let first = *self.source.get_or_insert(source);
        if source != first {
            return Err(self.lines.error(
                format!("profiles of source {source} among those of source {first}"),
                "one sensor per file: export each sensor separately",
            ));
        }
        let in_order = self.times.in_order(time_s);
        in_order.map_err(|found| self.lines.error(found, "profiles in time order"))
    }
}

impl ProfileReader for GocatorCsv {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        while into.len() < CHUNK_POINTS && self.next_profile(into)? {}
        self.is_empty &= into.is_empty();
        if into.is_empty() && self.is_empty {
            return Err(nothing_in(&self.path, "valid point"));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.lines.bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.lines.bytes_total()
    }
}
