//! Gocator recordings of the Bonn robot, `.bin`: one little-endian record per profile.
//!
//! f64 time (s); u64 stamp; u64 frame; u32 stamp count, profile count, exposure; i32 z offset,
//! x offset (µm); u32 z scale, x scale (nm); u32 width; i32 n, i16 x\[n\]; i32 n, i16 z\[n\];
//! i64 speed; i64 drops; u32 count; u32 width; i32 n, u8 intensity\[n\]. A coordinate is raw ·
//! scale + offset, not rounded; −32768 marks a point that was not measured; z counts from 1150 mm
//! below the scanner's origin.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::cloud::velodyne;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::{Input, Stream};
use crate::format::kind::{Frame, Kind, WholeRecord};
use crate::format::profiles::reader::ProfileReader;
use crate::geometry::Vec3;
use crate::sensor::{Continued, ScanPoint};

/// z in the file is z in the scanner frame plus this, metres.
pub(super) const STAND_OFF_M: f64 = 1.150;
/// Raw coordinate of a point that was not measured.
const INVALID: i16 = i16::MIN;
/// Bytes before the count of x values; the width is the last field.
const HEAD: usize = 56;
/// Bytes from the speed to the width of the intensities.
const MIDDLE: usize = 24;
/// More points than any profile scanner measures at once; it keeps damaged files from claiming
/// gigabytes.
const WIDEST: u32 = 1 << 16;
/// Beyond the range of any profile scanner; damaged scales and offsets exceed it.
const FARTHEST_M: f64 = 1e3;

pub(crate) const RECORDING: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    extensions: &["bin"],
    profiles: Some(|path| Ok(Box::new(BonnReader::open(path)?))),
    record: Some(whole_record),
    frame: Frame::Fixed(
        "nanometres and micrometres, seconds (the format); scanner frame: x along the laser line, y = 0, z towards the scanner",
    ),
    ..Kind::new("bonn-profiles", "profiles (Gocator recording, Bonn .bin)")
};

/// Reads a recording in bounded memory.
pub(crate) struct BonnReader {
    path: PathBuf,
    reader: BufReader<Stream>,
    record: Vec<u8>,
    /// Byte offset of the record.
    start: u64,
    total: u64,
    times: Continued,
    empty: bool,
    /// Whether the first profile is damaged, so that the file may be one of another format.
    may_be_other: bool,
}

fn word<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut word = [0; N];
    word.copy_from_slice(&bytes[at..at + N]);
    word
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(word(bytes, at))
}

/// Whether these could be the first bytes of a recording.
pub(crate) fn looks_like(start: &[u8]) -> bool {
    start.len() >= HEAD + 4
        && Head::parse(start).is_ok()
        && u32_at(start, 52) > 0
        && u32_at(start, HEAD) == u32_at(start, 52)
}

/// The record at the beginning of these bytes, if its time fits and it is complete.
fn whole_record(bytes: &[u8], fits: &dyn Fn(f64) -> bool) -> Option<WholeRecord> {
    let head = bytes.get(..HEAD).and_then(|head| Head::parse(head).ok())?;
    if !fits(head.time_s) {
        return None;
    }
    let width = head.width as usize;
    let xs = HEAD + 4 + 2 * width;
    let zs = xs + 4 + 2 * width;
    let intensities = zs + MIDDLE;
    let count = |at: usize| Some(u32_at(bytes.get(..at + 4)?, at) as usize);
    let intensity_count = count(intensities - 4)?;
    let is_consistent = width > 0
        && count(HEAD)? == width
        && count(xs)? == width
        && count(intensities)? == intensity_count
        && (intensity_count == width || intensity_count == 0);
    let length = intensities + 4 + intensity_count;
    (is_consistent && length <= bytes.len()).then_some(WholeRecord {
        length,
        time_s: head.time_s,
    })
}

/// The head of a record, in seconds and metres.
struct Head {
    time_s: f64,
    z_offset_m: f64,
    x_offset_m: f64,
    z_scale_m: f64,
    x_scale_m: f64,
    width: u32,
}

impl Head {
    /// Parses and checks the head. The error holds the offending byte, the text found and the text
    /// expected.
    fn parse(bytes: &[u8]) -> std::result::Result<Self, (usize, String, String)> {
        let offset = |at| f64::from(i32::from_le_bytes(word(bytes, at))) * 1e-6;
        let scale = |at| f64::from(u32_at(bytes, at)) * 1e-9;
        let head = Self {
            time_s: f64::from_le_bytes(word(bytes, 0)),
            z_offset_m: offset(36),
            x_offset_m: offset(40),
            z_scale_m: scale(44),
            x_scale_m: scale(48),
            width: u32_at(bytes, 52),
        };
        if !head.time_s.is_finite() {
            return Err((
                0,
                format!("time {} s", head.time_s),
                "a finite time".to_owned(),
            ));
        }
        for (at, offset, scale) in [
            (36, head.z_offset_m, head.z_scale_m),
            (40, head.x_offset_m, head.x_scale_m),
        ] {
            if scale == 0.0 || offset.abs() + 32768.0 * scale > FARTHEST_M {
                return Err((
                    at,
                    format!("offset {offset} m and scale {scale} m"),
                    format!("a positive scale and coordinates below {FARTHEST_M} m"),
                ));
            }
        }
        if head.width > WIDEST {
            return Err((
                52,
                format!("a profile of {} points", head.width),
                format!("at most {WIDEST}"),
            ));
        }
        Ok(head)
    }
}

impl BonnReader {
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let (mut file, total) = input.open()?;
        let may_be_other = !looks_like(&input.first_bytes(&mut file)?);
        Ok(Self {
            path: input.path().to_owned(),
            reader: BufReader::with_capacity(1 << 18, file),
            record: Vec::new(),
            start: 0,
            total,
            times: Continued::default(),
            empty: true,
            may_be_other,
        })
    }

    /// A format error at byte `at` of the record.
    fn error(&self, at: usize, found: impl Into<String>, expected: impl Into<String>) -> Error {
        let mut expected = expected.into();
        if self.start == 0 && self.may_be_other {
            expected += &format!(
                " (profiles of the Bonn robot), or {}",
                velodyne::DESCRIPTION
            );
        }
        let at = Location::Byte(self.start + at as u64);
        Error::format(&self.path, at, found, expected)
    }

    /// Appends the next `n` bytes of the file to the record and returns their offset in it.
    fn take(&mut self, n: usize) -> Result<usize> {
        let at = self.record.len();
        let left = self.total.saturating_sub(self.bytes_read());
        if n as u64 > left {
            return Err(self.error(
                at,
                format!("only {left} bytes left in the file"),
                format!(
                    "{n} more bytes of the profile that starts at byte {} (boresight salvage copies the \
                     undamaged profiles)",
                    self.start
                ),
            ));
        }
        self.record.resize(at + n, 0);
        self.reader
            .read_exact(&mut self.record[at..])
            .map_err(|e| Error::io(&self.path, e))?;
        Ok(at)
    }

    /// Reads a count, which must be `width`, and that many values of `size` bytes.
    fn take_values(&mut self, width: u32, size: usize, name: &str) -> Result<usize> {
        let at = self.take(4)?;
        let n = u32_at(&self.record, at);
        if n != width {
            return Err(self.error(
                at,
                format!("{} {name} values", n as i32),
                format!("{width}, the width of the profile"),
            ));
        }
        self.take(width as usize * size)
    }

    /// Reads one profile and appends its valid points; false at the end of the file.
    fn next_profile(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        self.start += self.record.len() as u64;
        self.record.clear();
        if self.start == self.total {
            return Ok(false);
        }
        self.take(HEAD)?;
        let mut head = Head::parse(&self.record)
            .map_err(|(at, found, expected)| self.error(at, found, expected))?;
        head.time_s = match self.times.in_order(head.time_s) {
            Ok(time_s) => time_s,
            Err(found) => return Err(self.error(0, found, "profiles in time order")),
        };
        let xs = self.take_values(head.width, 2, "x")?;
        let zs = self.take_values(head.width, 2, "z")?;
        let middle = self.take(MIDDLE)?;
        let intensity_count = u32_at(&self.record, middle + 20);
        if intensity_count != head.width && intensity_count != 0 {
            return Err(self.error(
                middle + 20,
                format!("{intensity_count} intensities"),
                format!("0 or {}, the width of the profile", head.width),
            ));
        }
        let intensities_at = self.take_values(intensity_count, 1, "intensity")?;

        let width = head.width as usize;
        let raw = |at: usize| {
            self.record[at..at + 2 * width]
                .chunks_exact(2)
                .map(|pair| i16::from_le_bytes([pair[0], pair[1]]))
        };
        let intensities = self.record[intensities_at..].iter().copied();
        let padded = intensities.chain(std::iter::repeat(0));
        let rays = raw(xs).zip(raw(zs)).zip(padded);
        into.extend(
            rays.filter(|((x, z), _)| *x != INVALID && *z != INVALID)
                .map(|((x, z), intensity)| ScanPoint {
                    time_s: head.time_s,
                    position_m: Vec3::new(
                        f64::from(x) * head.x_scale_m + head.x_offset_m,
                        0.0,
                        f64::from(z) * head.z_scale_m + head.z_offset_m - STAND_OFF_M,
                    ),
                    intensity: f32::from(intensity),
                }),
        );
        Ok(true)
    }
}

impl ProfileReader for BonnReader {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        while into.len() < CHUNK_POINTS && self.next_profile(into)? {}
        self.empty &= into.is_empty();
        if into.is_empty() && self.empty {
            return Err(nothing_in(&self.path, "valid point"));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.start + self.record.len() as u64
    }

    fn bytes_total(&self) -> u64 {
        self.total
    }
}

/// Writes a recording in this format: 16-bit coordinates with a scale and an offset. These are chosen
/// for every profile so that the step is as small as its extent allows (30 µm for a profile 2
/// m wide; the error of a coordinate is at most half a step and half a micrometre).
#[derive(Debug)]
pub struct BonnWriter {
    path: PathBuf,
    out: BufWriter<File>,
    frame: u64,
    record: Vec<u8>,
}

/// Offset (µm) and scale (nm) that map all `values` (m) to 16-bit integers.
fn quantisation(values: impl Iterator<Item = f64> + Clone) -> (i32, u32) {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(f64::NEG_INFINITY, f64::max);
    if low > high {
        return (0, 1000);
    }
    let offset_um = ((low + high) * 0.5 * 1e6).round();
    let extent_m = (high - offset_um * 1e-6).max(offset_um * 1e-6 - low);
    let scale_nm = (extent_m * 1e9 / f64::from(i16::MAX)).ceil().max(1.0);
    (offset_um as i32, scale_nm as u32)
}

impl BonnWriter {
    /// Creates or replaces the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        Ok(Self {
            path: path.to_owned(),
            out: BufWriter::with_capacity(1 << 18, file),
            frame: 0,
            record: Vec::new(),
        })
    }

    /// Appends a profile: for every ray, x and z in the scanner frame (m) and the intensity, or
    /// `None` if nothing was measured. The writer numbers the frames.
    ///
    /// # Errors
    /// Times or coordinates outside the range of the format (not finite, beyond a kilometre), too
    /// many rays, a file that cannot be written.
    pub fn write_profile(&mut self, time_s: f64, points: &[Option<(f64, f64, u8)>]) -> Result<()> {
        let fits = |v: f64| v.abs() < 0.5 * FARTHEST_M;
        if !time_s.is_finite()
            || points.len() > WIDEST as usize
            || points.iter().flatten().any(|p| !fits(p.0) || !fits(p.1))
        {
            return Err(Error::data(
                format!(
                    "{}: profile {} of {} points at {time_s} s has coordinates or a time outside \
                     the range of the format",
                    self.path.display(),
                    self.frame,
                    points.len()
                ),
                format!(
                    "give finite times, at most {WIDEST} points per profile, and coordinates \
                     below 500 m"
                ),
            ));
        }
        let valid = points.iter().flatten();
        let (x0, dx) = quantisation(valid.clone().map(|p| p.0));
        let (z0, dz) = quantisation(valid.map(|p| p.1 + STAND_OFF_M));
        let width = points.len() as u32;
        let record = &mut self.record;
        record.clear();
        record.extend(time_s.to_le_bytes());
        record.extend(((time_s.max(0.0) * 1e6) as u64).to_le_bytes());
        record.extend(self.frame.to_le_bytes());
        for count in [1u32, 1, 0] {
            record.extend(count.to_le_bytes());
        }
        for offset_um in [z0, x0] {
            record.extend(offset_um.to_le_bytes());
        }
        for scale_nm in [dz, dx] {
            record.extend(scale_nm.to_le_bytes());
        }
        record.extend(width.to_le_bytes());
        let raw = |value_m: f64, offset_um: i32, scale_nm: u32| {
            ((value_m - f64::from(offset_um) * 1e-6) / (f64::from(scale_nm) * 1e-9)).round() as i16
        };
        record.extend(width.to_le_bytes());
        for point in points {
            let x = point.map_or(INVALID, |p| raw(p.0, x0, dx));
            record.extend(x.to_le_bytes());
        }
        record.extend(width.to_le_bytes());
        for point in points {
            let z = point.map_or(INVALID, |p| raw(p.1 + STAND_OFF_M, z0, dz));
            record.extend(z.to_le_bytes());
        }
        // Speed and drops.
        for unused in [0i64; 2] {
            record.extend(unused.to_le_bytes());
        }
        for count in [1, width, width] {
            record.extend(count.to_le_bytes());
        }
        record.extend(points.iter().map(|point| point.map_or(0, |p| p.2)));
        self.frame += 1;
        self.out
            .write_all(record)
            .map_err(|e| Error::io(&self.path, e))
    }

    /// Writes buffered data.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<()> {
        self.out.flush().map_err(|e| Error::io(&self.path, e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantisation_is_as_fine_as_the_extent_allows() {
        let values = [-1.0, 0.3, 1.0];
        let (offset_um, scale_nm) = quantisation(values.iter().copied());
        assert_eq!((offset_um, scale_nm), (0, 30519));
        assert!(f64::from(scale_nm) * 32767.0 >= 1e9);
        assert_eq!(quantisation([0.25].into_iter()), (250_000, 1));
        assert_eq!(quantisation(std::iter::empty()), (0, 1000));
    }

    #[test]
    fn a_recording_continues_past_midnight() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("night.bin");
        let mut writer = BonnWriter::create(&path).unwrap();
        for time_s in [86_399.9, 86_400.0 - 86_400.0, 0.1] {
            writer
                .write_profile(time_s, &[Some((0.1, -0.5, 9))])
                .unwrap();
        }
        writer.finish().unwrap();
        let mut points = Vec::new();
        BonnReader::open(&Input::from(&path))
            .unwrap()
            .next_chunk(&mut points)
            .unwrap();
        let times_s: Vec<f64> = points.iter().map(|point| point.time_s).collect();
        assert_eq!(times_s, [86_399.9, 86_400.0, 86_400.1]);
    }
}
