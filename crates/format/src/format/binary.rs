//! Numbers in binary records with a layout described by a header: PLY, PCD and `.npy`.

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::input::{Input, Stream};
use crate::geometry::Vec3;

/// A number type in a binary record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Number {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number at the start of `bytes`.
    #[inline]
    pub(crate) fn read(self, bytes: &[u8], big_endian: bool) -> f64 {
        fn take<const N: usize>(bytes: &[u8], big_endian: bool) -> [u8; N] {
            let mut out = [0; N];
            out.copy_from_slice(&bytes[..N]);
            if big_endian {
                out.reverse();
            }
            out
        }
        let big = big_endian;
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(take(bytes, big))),
            Self::U16 => f64::from(u16::from_le_bytes(take(bytes, big))),
            Self::I32 => f64::from(i32::from_le_bytes(take(bytes, big))),
            Self::U32 => f64::from(u32::from_le_bytes(take(bytes, big))),
            Self::I64 => i64::from_le_bytes(take(bytes, big)) as f64,
            Self::U64 => u64::from_le_bytes(take(bytes, big)) as f64,
            Self::F32 => f64::from(f32::from_le_bytes(take(bytes, big))),
            Self::F64 => f64::from_le_bytes(take(bytes, big)),
        }
    }
}

/// Indices of the x, y, z, intensity and time fields of a record.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Fields {
    pub(crate) xyz: [Option<usize>; 3],
    pub(crate) intensity: Option<usize>,
    pub(crate) time: Option<usize>,
}

impl Fields {
    /// Stores the `index` of a field if its `name` is that of a coordinate, the intensity or the time.
    pub(crate) fn note(&mut self, name: &str, index: usize) {
        match name.to_ascii_lowercase().as_str() {
            "x" => self.xyz[0] = Some(index),
            "y" => self.xyz[1] = Some(index),
            "z" => self.xyz[2] = Some(index),
            "intensity" | "scalar_intensity" => self.intensity = Some(index),
            "time_s" | "gpstime" | "gps_time" | "scalar_gpstime" => self.time = Some(index),
            _ => {}
        }
    }

    /// Appends a record to a cloud, unless a coordinate is not finite: such a point was not
    /// measured.
    pub(crate) fn push(&self, values: &[f64], cloud: &mut PointCloud) {
        let at = |index: Option<usize>| index.map(|i| values[i]);
        let [Some(x), Some(y), Some(z)] = self.xyz.map(at) else {
            return;
        };
        if !(x.is_finite() && y.is_finite() && z.is_finite()) {
            return;
        }
        cloud.points.push(Vec3::new(x, y, z));
        cloud.intensity.extend(at(self.intensity).map(|v| v as f32));
        cloud.time_s.extend(at(self.time));
    }
}

/// The bytes of a file, read piece by piece.
pub(crate) struct Bytes {
    pub(crate) path: PathBuf,
    pub(crate) reader: BufReader<Stream>,
    pub(crate) at: u64,
    pub(crate) total: u64,
}

impl Bytes {
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let (file, total) = input.open()?;
        Ok(Self {
            path: input.path().to_owned(),
            reader: BufReader::with_capacity(1 << 18, file),
            at: 0,
            total,
        })
    }

    /// A format error at the current position.
    pub(crate) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        let at = Location::Byte(self.at);
        Error::format(&self.path, at, found, expected)
    }

    /// Checks that `n` more bytes exist before memory is allocated for them.
    pub(crate) fn check(&self, n: u64, what: &str) -> Result<()> {
        let left = self.total.saturating_sub(self.at);
        if n <= left {
            return Ok(());
        }
        Err(self.error(
            format!("only {left} bytes left in the file"),
            format!("{n} bytes of {what}"),
        ))
    }

    /// Fills `into`.
    pub(crate) fn take(&mut self, into: &mut [u8], what: &str) -> Result<()> {
        self.check(into.len() as u64, what)?;
        self.reader
            .read_exact(into)
            .map_err(|e| Error::io(&self.path, e))?;
        self.at += into.len() as u64;
        Ok(())
    }

    /// A line of text without its end; an error if the file ends before the line does or if it is
    /// not text.
    pub(crate) fn line(&mut self) -> Result<String> {
        let mut line = Vec::new();
        let read = (&mut self.reader)
            .take(1 << 16)
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::io(&self.path, e))?;
        if read == 0 {
            return Err(self.error("the end of the file", "a line of text"));
        }
        let text = std::str::from_utf8(&line)
            .map(|text| text.trim_ascii().to_owned())
            .map_err(|_| self.error("bytes that are not text", "a line of text"))?;
        self.at += read as u64;
        Ok(text)
    }
}
