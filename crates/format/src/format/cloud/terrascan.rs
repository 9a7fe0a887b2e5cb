//! TerraScan binary files (`.bin` of TerraSolid), as the TerraScan User Guide describes them: a header of 56 bytes, then
//! the points; numbers are little-endian.
//!
//! Header: i32 its size; i32 version; i32 970401; "CXYZ"; i32 number of points; i32 units of a coordinate per metre; f64
//! origin of x, y and z in these units; i32 whether points have times; i32 whether they have colours. A point of version
//! 20010712 has 16 bytes: u8 class, u8 flight line, u16 intensity with the echo in its two highest bits, i32 x, y, z. One
//! of version 20020715 has 20: i32 x, y, z, u8 class, u8 echo, two u8 flags, u16 flight line, u16 intensity. Times (u32,
//! steps of 0.0002 s in the GPS week) and colours (u8 red, green, blue and one more) follow each point. A coordinate in
//! metres is (number − origin) / units.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::{Bytes, Number, bytes_at};
use crate::format::cloud::gathering::{Gathering, counted};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::geometry::{Vec3, is_finite};

/// The number and the letters by which files are recognised, from byte 8.
const NUMBER: [u8; 4] = 970_401_i32.to_le_bytes();
const LETTERS: &[u8] = b"CXYZ";
/// Bytes of the fields of the header, which says how large it is, and more than it may have.
const HEADER: usize = 56;
const LONGEST_HEADER: i32 = 4096;
/// The versions with flight lines of 8 and of 16 bits.
const SHORT_LINES: i32 = 20_010_712;
const LONG_LINES: i32 = 20_020_715;
/// Older versions, of which the guide gives no more than the names.
const OLDER: [i32; 3] = [970_404, 20_010_129, 20_010_130];
/// The step of time stamps, seconds.
const TIME_STEP_S: f64 = 0.0002;
/// The bits of an intensity beside the echo.
const INTENSITY: u16 = 0x3fff;

pub(crate) const FILE: Kind = Kind {
    signature: Some(|start| {
        let is = |at: usize, what: &[u8]| start.bytes.get(at..at + 4) == Some(what);
        is(8, &NUMBER) && is(12, LETTERS)
    }),
    cloud: Some(read),
    frame: Frame::Fixed(
        "the master unit of its TerraScan project, taken for metres (the file does not name it); axes of the file, \
         taken for the world; times in seconds of the GPS week",
    ),
    ..Kind::new("terrascan", "cloud (TerraScan .bin)")
};

struct Header {
    version: i32,
    points: u64,
    units: f64,
    origin: Vec3,
    has_times: bool,
    has_colours: bool,
}

impl Header {
    /// Reads the header; `bytes` then stands at the first point.
    fn read(bytes: &mut Bytes) -> Result<Self> {
        let mut header = [0; HEADER];
        bytes.take(&mut header, "a header of TerraScan")?;
        let number = |at: usize| i32::from_le_bytes(bytes_at(&header, at));
        let origin = Vec3::from_fn(|i, _| Number::F64.read(&header[24 + 8 * i..], false));
        let (size, version, points, units) = (number(0), number(4), number(16), number(20));
        let mut wrong = |at: u64, found: String, expected: &str| {
            bytes.at = at;
            Err(bytes.error(found, expected))
        };
        if !(HEADER as i32..=LONGEST_HEADER).contains(&size) {
            return wrong(
                0,
                format!("a header of {size} bytes"),
                "one of 56 to 4096 bytes",
            );
        }
        if ![SHORT_LINES, LONG_LINES].contains(&version) && !OLDER.contains(&version) {
            let found = format!("version {version} of TerraScan's binary files");
            return wrong(4, found, "version 20010712 or 20020715");
        }
        if points < 0 {
            return wrong(16, format!("{points} points"), "a number of points");
        }
        if units <= 0 || !is_finite(&origin) {
            let found = format!("{units} units per metre and the origin {origin:?}");
            return wrong(20, found, "a positive number of units and a finite origin");
        }
        let mut rest = vec![0; size as usize - HEADER];
        bytes.take(&mut rest, "a header of TerraScan")?;
        Ok(Self {
            version,
            points: points.unsigned_abs().into(),
            units: f64::from(units),
            origin,
            has_times: number(48) != 0,
            has_colours: number(52) != 0,
        })
    }

    /// Bytes of a point without what follows it.
    fn point(&self) -> usize {
        if self.version == LONG_LINES { 20 } else { 16 }
    }

    /// Bytes of a point with what follows it.
    fn record(&self) -> usize {
        self.point() + 4 * (usize::from(self.has_times) + usize::from(self.has_colours))
    }

    /// Adds the point of a record.
    fn push(&self, record: &[u8], to: &mut Gathering<'_>) {
        let (places, intensity) = if self.version == LONG_LINES {
            (0, u16::from_le_bytes(bytes_at(record, 18)))
        } else {
            (4, u16::from_le_bytes(bytes_at(record, 2)) & INTENSITY)
        };
        let position = Vec3::from_fn(|i, _| {
            let number = Number::I32.read(&record[places + 4 * i..], false);
            (number - self.origin[i]) / self.units
        });
        let time_s = if self.has_times {
            TIME_STEP_S * Number::U32.read(&record[self.point()..], false)
        } else {
            f64::NAN
        };
        to.push(position, time_s, f64::from(intensity));
    }
}

/// Reads the points.
///
/// # Errors
/// A header that is damaged or of an unknown version, a file that ends before its points do.
fn read(input: &Input) -> Result<PointCloud> {
    let mut bytes = Bytes::open(input)?;
    let header = Header::read(&mut bytes)?;
    let size = header.points * header.record() as u64;
    let left = bytes.total.saturating_sub(bytes.at);
    if OLDER.contains(&header.version) {
        if size != left {
            bytes.at = 4;
            let found = format!(
                "version {} of TerraScan's binary files, whose points are not described",
                header.version
            );
            return Err(bytes.error(found, "version 20010712 or 20020715"));
        }
        input.remark(format!(
            "the points of version {} are not described: their size is that of version 20010712, and they are read as \
             those",
            header.version
        ));
    }
    bytes.check(size, &counted(header.points, "point"))?;
    let mut gathering = Gathering::new(input);
    gathering.reserve(usize::try_from(header.points).unwrap_or_default());
    let mut record = vec![0; header.record()];
    for _ in 0..header.points {
        bytes.take(&mut record, "a point")?;
        header.push(&record, &mut gathering);
    }
    if left > size {
        input.remark(format!(
            "{} behind the last point left out",
            counted(left - size, "byte")
        ));
    }
    let colours = if header.has_colours { ", colours" } else { "" };
    input.remark(format!(
        "classes, echoes, flight lines{colours} of the points are left out"
    ));
    gathering.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::mutation::for_each_damaged;
    use crate::format::{detect, read_cloud};

    /// A file with two points, 2 and 3 units from the origin on every axis, of 100 units per metre.
    fn file(version: i32, has_times: bool, has_colours: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        for number in [56, version, 970_401] {
            bytes.extend(i32::to_le_bytes(number));
        }
        bytes.extend(b"CXYZ");
        bytes.extend([2_i32, 100].map(i32::to_le_bytes).concat());
        bytes.extend([-36_000_000.0_f64, 5.5, 0.0].map(f64::to_le_bytes).concat());
        bytes.extend(
            [has_times, has_colours]
                .map(|has| i32::from(has).to_le_bytes())
                .concat(),
        );
        for i in 2..4 {
            let places = [i, i - 7, -i].map(i32::to_le_bytes).concat();
            let intensity = 300 + i as u16;
            if version == LONG_LINES {
                bytes.extend(places);
                bytes.extend([2, 3, 0, 0, 7, 1]);
                bytes.extend(intensity.to_le_bytes());
            } else {
                bytes.extend([2, 7]);
                bytes.extend((3 << 14 | intensity).to_le_bytes());
                bytes.extend(places);
            }
            if has_times {
                bytes.extend((u32::MAX - i as u32).to_le_bytes());
            }
            if has_colours {
                bytes.extend([255, 0, 128, 0]);
            }
        }
        bytes
    }

    fn refused(bytes: &[u8], expected: &[&str]) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(detect(&path).unwrap().id(), "terrascan");
        let error = read_cloud(&path).unwrap_err().to_string();
        for part in expected {
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn points_of_all_versions_are_exact() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        for version in [LONG_LINES, SHORT_LINES, 20_010_129, 20_010_130] {
            for (has_times, has_colours) in
                [(false, false), (true, false), (false, true), (true, true)]
            {
                std::fs::write(&path, file(version, has_times, has_colours)).unwrap();
                let input = Input::from(&path);
                let cloud = read_cloud(&input).unwrap();
                let place = |i: f64| Vec3::new(360_000.0 + 0.01 * i, 0.01 * i - 0.125, -0.01 * i);
                for (found, i) in cloud.points.iter().zip([2.0, 3.0]) {
                    assert!((found - place(i)).abs().max() < 1e-10, "{version} {found}");
                }
                assert_eq!(cloud.points.len(), 2);
                assert_eq!(cloud.intensity, [302.0, 303.0]);
                assert_eq!(cloud.time_s.len(), if has_times { 2 } else { 0 });
                for (found_s, expected_s) in cloud.time_s.iter().zip([858_993.458_6, 858_993.458_4])
                {
                    assert!((found_s - expected_s).abs() < 1e-9, "{found_s}");
                }
                let remarks = input.remarks().join("\n");
                assert_eq!(remarks.contains("not described"), version < SHORT_LINES);
                assert_eq!(remarks.contains("colours"), has_colours, "{remarks}");
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let whole = file(LONG_LINES, true, false);
        let with = |at: usize, value: i32| {
            let mut bytes = whole.clone();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            bytes
        };
        refused(&with(0, 48), &["byte 0", "a header of 48 bytes"]);
        refused(
            &with(4, 20_300_101),
            &["byte 4", "version 20300101", "20010712 or 20020715"],
        );
        refused(&with(4, 20_010_129), &["byte 4", "not described"]);
        refused(&with(16, -1), &["byte 16", "-1 points"]);
        refused(
            &with(16, 3),
            &["byte 56", "only 48 bytes left", "72 bytes of 3 points"],
        );
        refused(&with(16, 0), &["no point"]);
        refused(&with(20, 0), &["byte 20", "0 units"]);
        refused(&whole[..20], &["byte 0", "only 20 bytes left"]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        std::fs::write(&path, [whole.clone(), vec![0; 9]].concat()).unwrap();
        let input = Input::from(&path);
        assert_eq!(read_cloud(&input).unwrap().points.len(), 2);
        assert!(
            input
                .remarks()
                .join("\n")
                .contains("9 bytes behind the last point")
        );
        for_each_damaged(&path, &whole, 2000, || drop(read_cloud(&path)));
    }
}
