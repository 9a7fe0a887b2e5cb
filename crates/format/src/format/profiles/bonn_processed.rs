//! Processed recordings of the Bonn group, `.bin`: one little-endian record per profile, with the points that were
//! measured and not masked.
//!
//! f64 time (s); u32 n; f32 x\[n\], y\[n\], z\[n\] in the scanner frame (mm); u32 intensity\[n\].

use crate::error::Result;
use crate::format::binary::{Bytes, Number};
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start, WholeRecord};
use crate::format::profiles::reader::ProfileReader;
use crate::geometry::Vec3;
use crate::sensor::{Continued, ScanPoint};

/// Bytes of time and count, and bytes of a point.
const HEAD: usize = 12;
const POINT: usize = 16;
/// More points than any profile scanner measures at once.
const WIDEST: u32 = 1 << 16;
/// Beyond the range of any profile scanner, millimetres.
const FARTHEST_MM: f32 = 1e5;
/// Longest interval between successive profiles of one recording, seconds.
const LONGEST_PAUSE_S: f64 = 3600.0;

pub(crate) const RECORDING: Kind = Kind {
    signature: Some(looks_like),
    profiles: Some(|path| Ok(Box::new(ProcessedReader::open(path)?))),
    record: Some(whole_record),
    frame: Frame::Fixed("millimetres, seconds (the format); scanner frame"),
    ..Kind::new(
        "bonn-processed",
        "profiles (processed recording, Bonn .bin)",
    )
};

fn number(bytes: &[u8], at: usize, kind: Number) -> f64 {
    kind.read(&bytes[at..], false)
}

/// Time and number of points of a record, if they are plausible.
fn head(bytes: &[u8]) -> Option<(f64, u32)> {
    if bytes.len() < HEAD {
        return None;
    }
    let time_s = number(bytes, 0, Number::F64);
    let count = number(bytes, 8, Number::U32) as u32;
    let is_time = time_s == 0.0 || (1e-3..1e11).contains(&time_s);
    (is_time && count <= WIDEST).then_some((time_s, count))
}

/// Whether a file may begin with these bytes: the first record and the head of the second, if present, are plausible.
fn looks_like(start: &Start<'_>) -> bool {
    let Some((first_s, count)) = head(start.bytes) else {
        return false;
    };
    let length = HEAD + POINT * count as usize;
    if length as u64 > start.size {
        return false;
    }
    let available = (start.bytes.len() - HEAD).min(12 * count as usize) / 4;
    let coordinates = (0..available).map(|i| number(start.bytes, HEAD + 4 * i, Number::F32));
    let are_near = coordinates
        .into_iter()
        .all(|x| x.abs() < f64::from(FARTHEST_MM));
    let next = start.bytes.get(length..).filter(|rest| rest.len() >= HEAD);
    let is_followed = match next {
        Some(rest) => head(rest)
            .is_some_and(|(next_s, _)| next_s >= first_s && next_s - first_s < LONGEST_PAUSE_S),
        // Only the first profile is available: it must not be empty.
        None => count > 0,
    };
    are_near && is_followed && (count > 0 || first_s > 0.0)
}

/// The record at the beginning of these bytes, if its time fits, it is complete, and its coordinates are plausible.
fn whole_record(bytes: &[u8], fits: &dyn Fn(f64) -> bool) -> Option<WholeRecord> {
    let (time_s, count) = head(bytes).filter(|(time_s, _)| fits(*time_s))?;
    let n = count as usize;
    let length = HEAD + POINT * n;
    let coordinates = bytes.get(HEAD..length)?.chunks_exact(4).take(3 * n);
    let are_near = coordinates
        .into_iter()
        .all(|bytes| number(bytes, 0, Number::F32).abs() < f64::from(FARTHEST_MM));
    // Zeros alone would pass for an empty profile at time 0.
    (are_near && (n > 0 || time_s > 0.0)).then_some(WholeRecord { length, time_s })
}

/// Reads a recording in bounded memory.
struct ProcessedReader {
    bytes: Bytes,
    record: Vec<u8>,
    times: Continued,
    empty: bool,
}

impl ProcessedReader {
    fn open(input: &Input) -> Result<Self> {
        Ok(Self {
            bytes: Bytes::open(input)?,
            record: Vec::new(),
            times: Continued::default(),
            empty: true,
        })
    }

    /// Reads one profile and appends its points; false at the end of the file.
    fn next_profile(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        if self.bytes.at == self.bytes.total {
            return Ok(false);
        }
        let at = self.bytes.at;
        let mut start = [0; HEAD];
        self.bytes.take(&mut start, "time and count of a profile")?;
        let error = |bytes: &mut Bytes, at: u64, found: String, expected: &str| {
            bytes.at = at;
            bytes.error(found, expected)
        };
        let Some((time_s, count)) = head(&start) else {
            let time_s = number(&start, 0, Number::F64);
            let count = number(&start, 8, Number::U32);
            let found = format!("a profile of {count} points at {time_s} s");
            return Err(error(
                &mut self.bytes,
                at,
                found,
                "a time, and 65536 points at most",
            ));
        };
        let time_s = match self.times.in_order(time_s) {
            Ok(time_s) => time_s,
            Err(found) => {
                return Err(error(&mut self.bytes, at, found, "profiles in time order"));
            }
        };
        let n = count as usize;
        self.bytes
            .check((POINT * n) as u64, "the points of a profile")?;
        self.record.resize(POINT * n, 0);
        self.bytes
            .take(&mut self.record, "the points of a profile")?;
        for i in 0..n {
            let index = |block: usize| 4 * (block * n + i);
            let [x, y, z] = [0, 1, 2].map(|block| number(&self.record, index(block), Number::F32));
            let position_m = Vec3::new(x, y, z) * 1e-3;
            // NaN is not near.
            let is_near = position_m.norm() < 1e-3 * f64::from(FARTHEST_MM);
            if !is_near {
                let found = format!("the point {x}, {y}, {z} mm");
                let at = at + (HEAD + index(0)) as u64;
                return Err(error(&mut self.bytes, at, found, "coordinates below 100 m"));
            }
            let intensity = number(&self.record, index(3), Number::U32) as f32;
            into.push(ScanPoint {
                time_s,
                position_m,
                intensity,
            });
        }
        Ok(true)
    }
}

impl ProfileReader for ProcessedReader {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        while into.len() < CHUNK_POINTS && self.next_profile(into)? {}
        self.empty &= into.is_empty();
        if into.is_empty() && self.empty {
            return Err(nothing_in(&self.bytes.path, "point"));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.bytes.at
    }

    fn bytes_total(&self) -> u64 {
        self.bytes.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profile(time_s: f64, points: &[[f32; 3]]) -> Vec<u8> {
        let mut bytes = time_s.to_le_bytes().to_vec();
        bytes.extend((points.len() as u32).to_le_bytes());
        for axis in 0..3 {
            bytes.extend(points.iter().flat_map(|point| point[axis].to_le_bytes()));
        }
        bytes.extend((0..points.len() as u32).flat_map(|i| (7 * i).to_le_bytes()));
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Vec<ScanPoint>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plot_l.bin");
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(crate::format::detect(&path)?.id(), "bonn-processed");
        let mut reader = crate::format::open_profiles(&path)?;
        let (mut chunk, mut all) = (Vec::new(), Vec::new());
        while reader.next_chunk(&mut chunk)? {
            all.extend_from_slice(&chunk);
        }
        Ok(all)
    }

    #[test]
    fn points_are_millimetres_in_the_scanner_frame() {
        let points = [[-400.0, 0.0, -250.5], [12.0, 0.5, 100.0]];
        let mut bytes = profile(36_000.25, &points);
        bytes.extend(profile(36_000.255, &[]));
        bytes.extend(profile(36_000.26, &points[1..]));
        let found = read(&bytes).unwrap();
        let expected = [(36_000.25, points[0], 0.0), (36_000.25, points[1], 7.0)];
        let expected = expected.into_iter().chain([(36_000.26, points[1], 0.0)]);
        assert_eq!(found.len(), 3);
        for (point, (time_s, mm, intensity)) in found.iter().zip(expected) {
            let position_m = Vec3::from(mm.map(f64::from)) * 1e-3;
            assert_eq!((point.time_s, point.position_m), (time_s, position_m));
            assert_eq!(point.intensity, intensity);
        }
    }

    #[test]
    fn damage_is_named_with_its_byte() {
        let whole = [profile(1.0, &[[1.0; 3]; 3]), profile(2.0, &[[1.0; 3]; 3])].concat();
        let message = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
        let cut = message(&whole[..whole.len() - 1]);
        assert!(cut.contains("byte 72: found only 47 bytes left"), "{cut}");
        let mut wrong = whole.clone();
        wrong[60 + 12..60 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
        let found = message(&wrong);
        assert!(found.contains("byte 72: found the point NaN"), "{found}");
    }
}
