//! Numbers in binary records with a layout described by a header: PLY, PCD and `.npy`.

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;

use crate::error::{Error, Location, Result};
use crate::format::cloud::gathering::counted;
use crate::format::input::{Input, Stream};

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

/// `N` bytes of a record.
pub(crate) fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[at..at + N]);
    out
}

/// The bytes of a file, read piece by piece.
pub(crate) struct Bytes {
    pub(crate) path: PathBuf,
    pub(crate) reader: BufReader<Stream>,
    pub(crate) at: u64,
    pub(crate) total: u64,
    /// Whether lines end with a carriage return alone; unknown before the first line.
    ends_with_return: Option<bool>,
}

/// Bytes of the longest line.
const LONGEST_LINE: u64 = 1 << 16;

impl Bytes {
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let (file, total) = input.open()?;
        Ok(Self {
            path: input.path().to_owned(),
            reader: BufReader::with_capacity(1 << 18, file),
            at: 0,
            total,
            ends_with_return: None,
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

    /// Remarks on records of `length` bytes, or in text on lines, that follow the last one of which the header knows.
    pub(crate) fn remark_on_rest(&mut self, input: &Input, length: Option<usize>) -> Result<()> {
        let mut further = 0;
        if let Some(length) = length {
            further = self.total.saturating_sub(self.at) / (length.max(1) as u64);
        } else {
            while self.at < self.total {
                let line = self.raw_line()?;
                further += u64::from(!line.trim_ascii().is_empty());
            }
        }
        if further > 0 {
            input.remark(format!(
                "left out: {} beyond the number in the header",
                counted(further, "record")
            ));
        }
        Ok(())
    }

    /// A line of text without its end, which is that of the first line: a line feed, a carriage return or both. An
    /// error if the file ends before the line does.
    pub(crate) fn line(&mut self) -> Result<String> {
        let line = self.raw_line()?;
        let text = std::str::from_utf8(&line).map(|text| text.trim_ascii().to_owned());
        text.map_err(|_| self.error("bytes that are not text", "a line of text"))
    }

    /// As [`Self::line`], with marks in place of bytes that are not UTF-8.
    pub(crate) fn line_of_any_text(&mut self) -> Result<String> {
        let line = self.raw_line()?;
        Ok(String::from_utf8_lossy(&line).trim_ascii().to_owned())
    }

    fn raw_line(&mut self) -> Result<Vec<u8>> {
        let end = if self.ends_with_return == Some(true) {
            b'\r'
        } else {
            b'\n'
        };
        let mut line = Vec::new();
        if self.ends_with_return.is_none() {
            self.read_first_line(&mut line)?;
        } else {
            (&mut self.reader)
                .take(LONGEST_LINE)
                .read_until(end, &mut line)
                .map_err(|e| Error::io(&self.path, e))?;
        }
        if line.is_empty() {
            return Err(self.error("the end of the file", "a line of text"));
        }
        self.at += line.len() as u64;
        Ok(line)
    }

    /// Reads the first line, and finds out how lines end.
    fn read_first_line(&mut self, line: &mut Vec<u8>) -> Result<()> {
        loop {
            let buffered = self.reader.fill_buf();
            let Some(byte) = buffered
                .map_err(|e| Error::io(&self.path, e))?
                .first()
                .copied()
            else {
                break;
            };
            if line.last() == Some(&b'\r') && byte != b'\n' {
                self.ends_with_return = Some(true);
                return Ok(());
            }
            self.reader.consume(1);
            line.push(byte);
            if byte == b'\n' || line.len() as u64 == LONGEST_LINE {
                break;
            }
        }
        self.ends_with_return = Some(false);
        Ok(())
    }
}
