//! The lines of text files, and numbers between commas, semicolons or white space.

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;

use crate::error::{Error, Location, Result};
use crate::format::file::is_in_recording;
use crate::format::input::{Input, Stream};
use crate::format::parquet;

/// Lines of this many bytes do not belong to a table; the limit keeps binary files from filling the memory.
const LONGEST_LINE: u64 = 1 << 20;
/// End of file in texts of DOS.
const DOS_END: u8 = 0x1a;
/// Tables do not have more columns; the limit matters because each name is compared with all known names.
pub(crate) const MOST_COLUMNS: usize = 1024;

/// The lines of a text file, one at a time, without their ends.
#[derive(Debug)]
pub(crate) struct Lines {
    path: PathBuf,
    reader: BufReader<Stream>,
    line: Vec<u8>,
    number: u64,
    bytes: u64,
    total: u64,
    /// Whether a last line without a line end is left out.
    complete_only: bool,
}

impl Lines {
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let (file, total) = input.open()?;
        Ok(Self {
            path: input.path().to_owned(),
            reader: BufReader::with_capacity(1 << 18, file),
            line: Vec::new(),
            number: 0,
            bytes: 0,
            total,
            // A recording may have ended in the middle of a line when the power failed.
            complete_only: is_in_recording(input.path()),
        })
    }

    /// Reads the next line; false at the end.
    pub(crate) fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        let read = (&mut self.reader)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut self.line)
            .map_err(|e| Error::io(&self.path, e))? as u64;
        if self.complete_only && read < LONGEST_LINE && !self.line.ends_with(b"\n") {
            self.line.clear();
            return Ok(false);
        }
        self.number += 1;
        self.bytes += read;
        // DOS programs mark the end of a text with this byte.
        if self.bytes == self.total && self.line.last() == Some(&DOS_END) {
            self.line.pop();
            if self.line.is_empty() {
                return Ok(false);
            }
        }
        let text = match std::str::from_utf8(&self.line) {
            Ok(_) if read == LONGEST_LINE => Err("a line of a mebibyte or more"),
            Ok(text) if text.contains('\0') => Err("zero bytes"),
            Ok(_) => Ok(()),
            Err(_) => Err("bytes that are not text"),
        };
        text.map_err(|found| self.error(found, "a text file (UTF-8)"))?;
        Ok(read > 0)
    }

    /// The line last read, without white space around it.
    pub(crate) fn text(&self) -> &str {
        let bytes = if self.number == 1 {
            self.line
                .strip_prefix(b"\xef\xbb\xbf")
                .unwrap_or(&self.line)
        } else {
            &self.line
        };
        // `advance` has checked that it is UTF-8.
        std::str::from_utf8(bytes).unwrap_or_default().trim_ascii()
    }

    /// Reads the next line that is neither empty nor a comment; false at the end.
    pub(crate) fn next_content(&mut self) -> Result<bool> {
        while self.advance()? {
            if !(self.text().is_empty() || self.text().starts_with('#')) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Reads the next line that is neither empty nor a comment; false at the end. The line must hold
    /// finite numbers only, as many as `fits` accepts.
    pub(crate) fn next_numbers(
        &mut self,
        cells: &mut Vec<f64>,
        fits: impl Fn(usize) -> bool,
        expected: impl FnOnce() -> String,
    ) -> Result<bool> {
        while self.advance()? {
            let text = self.text();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            if numbers(text, cells) && fits(cells.len()) && cells.iter().all(|v| v.is_finite()) {
                return Ok(true);
            }
            let found: String = text.chars().take(80).collect();
            return Err(self.error(format!("`{found}`"), expected()));
        }
        Ok(false)
    }

    /// The line last read, counted from 1.
    pub(crate) fn number(&self) -> u64 {
        self.number
    }

    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes
    }

    pub(crate) fn bytes_total(&self) -> u64 {
        self.total
    }

    /// A format error at the line last read.
    pub(crate) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::format(&self.path, Location::Line(self.number), found, expected)
    }
}

/// The separator between the cells of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Separator {
    Comma,
    Semicolon,
    Space,
}

impl Separator {
    pub(crate) fn of(line: &str) -> Self {
        if line.contains(';') {
            Self::Semicolon
        } else if line.contains(',') {
            Self::Comma
        } else {
            Self::Space
        }
    }

    /// Passes every cell of `line` with its index to `take`, until `take` fails. Returns the number of cells.
    #[inline]
    pub(crate) fn split<E>(
        self,
        line: &str,
        mut take: impl FnMut(usize, &str) -> std::result::Result<(), E>,
    ) -> std::result::Result<usize, E> {
        let mut count = 0;
        match self {
            Self::Space => {
                for cell in line.split_ascii_whitespace() {
                    take(count, cell)?;
                    count += 1;
                }
            }
            Self::Comma | Self::Semicolon => {
                let byte = if self == Self::Comma { ',' } else { ';' };
                for cell in line.split(byte) {
                    take(count, cell.trim_ascii())?;
                    count += 1;
                }
            }
        }
        Ok(count)
    }

    /// The names in a header without quotes, at most one more than [`MOST_COLUMNS`].
    pub(crate) fn names(self, line: &str) -> Vec<String> {
        let mut names = Vec::new();
        let _ = self.split(line, |_, cell| {
            names.push(cell.trim_matches('"').trim_ascii().to_owned());
            if names.len() > MOST_COLUMNS {
                Err(())
            } else {
                Ok(())
            }
        });
        names
    }
}

/// Reads all numbers of a line with any separator; false if a cell is not a number.
pub(crate) fn numbers(line: &str, into: &mut Vec<f64>) -> bool {
    into.clear();
    Separator::of(line)
        .split(line, |_, cell| {
            into.push(cell.parse::<f64>().map_err(|_| ())?);
            Ok::<(), ()>(())
        })
        .is_ok()
}

/// The names in the header of a table, which is the first line that is neither empty nor a comment, or the
/// last comment before numbers; or the column names of a Parquet file.
pub(crate) fn header_names(input: &Input) -> Result<Vec<String>> {
    if input.is_parquet() {
        return Ok(parquet::header(input)?.names);
    }
    let mut lines = Lines::open(input)?;
    let mut comment = Vec::new();
    while lines.advance()? {
        let text = lines.text();
        if let Some(text) = text.strip_prefix('#') {
            comment = Separator::of(text).names(text);
        } else if !text.is_empty() {
            let is_numeric = numbers(text, &mut Vec::new());
            return Ok(if is_numeric {
                comment
            } else {
                Separator::of(text).names(text)
            });
        }
    }
    Ok(comment)
}
