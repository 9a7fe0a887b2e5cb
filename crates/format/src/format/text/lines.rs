//! The lines of text files, and numbers between commas, semicolons or white space.

use std::io::{BufRead, BufReader, Read};

use crate::error::{Error, Location, Result};
use crate::format::file::is_in_recording;
use crate::format::input::{Input, Stream};
use crate::format::parquet;
use crate::format::text::numerals::{Numerals, is_in_missing};
use crate::format::text::windows;

/// Lines of this many bytes do not belong to a table; the limit keeps binary files from filling the memory.
const LONGEST_LINE: u64 = 1 << 20;
/// End of file in texts of DOS.
const DOS_END: u8 = 0x1a;
/// Tables do not have more columns; the limit matters because each name is compared with all known names.
pub(crate) const MOST_COLUMNS: usize = 1024;

/// The lines of a text file, one at a time, without their ends.
#[derive(Debug)]
pub(crate) struct Lines {
    input: Input,
    reader: BufReader<Stream>,
    line: Vec<u8>,
    number: u64,
    bytes: u64,
    total: u64,
    /// Whether a last line without a line end is left out.
    complete_only: bool,
    numerals: Numerals,
}

impl Lines {
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let (file, total) = utf8(input)?;
        Ok(Self {
            input: input.clone(),
            reader: BufReader::with_capacity(1 << 18, file),
            line: Vec::new(),
            number: 0,
            bytes: 0,
            total,
            // A recording may have ended in the middle of a line when the power failed.
            complete_only: is_in_recording(input.path()),
            numerals: Numerals::default(),
        })
    }

    /// Reads the next line; false at the end.
    pub(crate) fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        self.read_line()
            .map_err(|e| Error::io(self.input.path(), e))?;
        let read = self.line.len() as u64;
        let is_complete = self.line.ends_with(b"\n") || self.line.ends_with(b"\r");
        if self.complete_only && read < LONGEST_LINE && !is_complete {
            self.line.clear();
            return Ok(false);
        }
        self.number += 1;
        self.bytes += read;
        // DOS programs mark the end of a text with this byte, some of them twice.
        if self.bytes == self.total && self.line.contains(&DOS_END) {
            let is_end = |byte: &u8| *byte == DOS_END || byte.is_ascii_whitespace();
            let end = self.line.iter().rposition(|byte| !is_end(byte));
            self.line.truncate(end.map_or(0, |end| end + 1));
            if self.line.is_empty() {
                return Ok(false);
            }
        }
        if std::str::from_utf8(&self.line).is_err()
            && let Some(text) = windows::decode(&self.line)
        {
            self.input
                .remark("text that is not UTF-8 is read as Windows-1252");
            self.line = text.into_bytes();
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

    /// Reads a line with its end: a line feed, a carriage return, or both.
    fn read_line(&mut self) -> std::io::Result<()> {
        while (self.line.len() as u64) < LONGEST_LINE {
            let buffer = self.reader.fill_buf()?;
            if buffer.is_empty() {
                break;
            }
            if self.line.ends_with(b"\r") {
                // The rest of the end of this line, or the next line.
                if buffer[0] == b'\n' {
                    self.line.push(b'\n');
                    self.reader.consume(1);
                }
                break;
            }
            let most = buffer.len().min(LONGEST_LINE as usize - self.line.len());
            let end = memchr::memchr2(b'\n', b'\r', &buffer[..most]);
            let taken = end.map_or(most, |end| end + 1);
            self.line.extend_from_slice(&buffer[..taken]);
            self.reader.consume(taken);
            if self.line.ends_with(b"\n") {
                break;
            }
        }
        Ok(())
    }

    /// The line last read, without white space around it. A first line that only names the separator, as Excel reads
    /// it, is empty.
    pub(crate) fn text(&self) -> &str {
        let bytes = if self.number == 1 {
            self.line
                .strip_prefix(b"\xef\xbb\xbf")
                .unwrap_or(&self.line)
        } else {
            &self.line
        };
        // `advance` has checked that it is UTF-8.
        let text = std::str::from_utf8(bytes).unwrap_or_default().trim_ascii();
        let is_separator = |rest: &str| rest.len() <= 1 || rest == "\\t";
        let has_mark = self.number == 1
            && text
                .get(..4)
                .is_some_and(|t| t.eq_ignore_ascii_case("sep="));
        if has_mark && is_separator(&text[4..]) {
            ""
        } else {
            text
        }
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

    /// Reads the next line that is neither empty nor a comment; false at the end. The line must hold finite numbers
    /// only, as many as `fits` accepts.
    pub(crate) fn next_numbers(
        &mut self,
        cells: &mut Vec<f64>,
        fits: impl Fn(usize) -> bool,
        expected: impl FnOnce() -> String,
    ) -> Result<bool> {
        self.next_row(
            cells,
            |row| fits(row.len()) && row.iter().all(|v| v.is_finite()),
            expected,
        )
    }

    /// As [`Self::next_numbers`], but `fits` sees the numbers, which are NaN where a value is missing.
    pub(crate) fn next_row(
        &mut self,
        cells: &mut Vec<f64>,
        fits: impl Fn(&[f64]) -> bool,
        expected: impl FnOnce() -> String,
    ) -> Result<bool> {
        while self.advance()? {
            let text = self.text();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let mut numerals = self.numerals;
            if row(text, &mut numerals, cells) && fits(cells) {
                self.numerals = numerals;
                return Ok(true);
            }
            let found: String = text.chars().take(80).collect();
            return Err(self.error(format!("`{found}`"), expected()));
        }
        Ok(false)
    }

    /// How commas in numbers are read.
    pub(crate) fn numerals(&self) -> Numerals {
        self.numerals
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
        let path = self.input.path();
        Error::format(path, Location::Line(self.number), found, expected)
    }
}

/// Text as UTF-8, and its number of bytes. Text that begins with the mark of UTF-16 is converted in memory.
fn utf8(input: &Input) -> Result<(Stream, u64)> {
    let (mut stream, total) = input.open()?;
    let start = input.first_bytes(&mut stream)?;
    let read: fn([u8; 2]) -> u16 = match start.as_slice() {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        _ => return Ok((stream, total)),
    };
    let mut bytes = Vec::new();
    stream
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(input.path(), e))?;
    let units = bytes.as_chunks::<2>().0.iter().map(|unit| read(*unit));
    let text: String = char::decode_utf16(units)
        .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
        .collect();
    let total = text.len() as u64;
    Ok((Stream::in_memory(text.into_bytes()), total))
}

/// The separator between the cells of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Separator {
    Comma,
    Semicolon,
    /// One tab between cells, which may be empty.
    Tab,
    Space,
}

impl Separator {
    pub(crate) fn of(line: &str) -> Self {
        if memchr::memchr3(b';', b',', b'\t', line.as_bytes()).is_none() {
            Self::Space
        } else if line.contains(';') {
            Self::Semicolon
        } else if line.contains(',') && !has_decimal_commas(line) {
            Self::Comma
        } else if line.contains('\t') && !line.contains(' ') && !line.contains("\t\t") {
            Self::Tab
        } else {
            Self::Space
        }
    }

    /// Passes every cell of `line` with its index to `take`, until `take` fails. Returns the number of cells. Commas and
    /// semicolons between quotes do not separate cells.
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
            Self::Comma | Self::Semicolon | Self::Tab => {
                let mark = match self {
                    Self::Comma => ',',
                    Self::Semicolon => ';',
                    _ => '\t',
                };
                if !line.contains('"') {
                    for cell in line.split(mark) {
                        take(count, cell.trim_ascii())?;
                        count += 1;
                    }
                    return Ok(count);
                }
                let mut is_quoted = false;
                let mut rest = Some(line);
                while let Some(text) = rest {
                    let end = text.find(|c: char| {
                        is_quoted ^= c == '"';
                        c == mark && !is_quoted
                    });
                    let cell = &text[..end.unwrap_or(text.len())];
                    take(count, cell.trim_ascii())?;
                    count += 1;
                    rest = end.map(|end| &text[end + 1..]);
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

/// Whether a line consists of numbers with decimal commas between blanks.
fn has_decimal_commas(line: &str) -> bool {
    let is_number = |cell: &str| {
        let digits = cell.trim_start_matches(['+', '-']);
        digits.starts_with(|c: char| c.is_ascii_digit())
            && !digits.ends_with(',')
            && !digits.contains('.')
            && digits.matches(',').count() <= 1
            && Numerals::default().number(cell).is_some()
    };
    let mut cells = line.split_ascii_whitespace();
    cells.clone().count() > 1 && cells.all(is_number)
}

/// A line of numbers without a comment behind them and without a separator behind the last one.
pub(crate) fn without_trailer(line: &str) -> &str {
    let content = match memchr::memchr2(b'#', b'/', line.as_bytes()) {
        None => line,
        Some(_) => {
            let is_mark = |at: &usize| line.as_bytes()[*at] == b'/' || !is_in_missing(line, *at);
            let hashes = line.match_indices('#').map(|(at, _)| at);
            let end = hashes.chain(line.find("//")).filter(is_mark).min();
            line[..end.unwrap_or(line.len())].trim_ascii()
        }
    };
    let content = if content.is_empty() { line } else { content };
    content.strip_suffix([',', ';']).unwrap_or(content)
}

/// Reads all numbers of a line with any separator; false if a cell is not a number. Empty cells are NaN.
pub(crate) fn row(line: &str, numerals: &mut Numerals, into: &mut Vec<f64>) -> bool {
    into.clear();
    let line = without_trailer(line);
    Separator::of(line)
        .split(line, |_, cell| {
            into.push(numerals.number(cell).ok_or(())?);
            Ok::<(), ()>(())
        })
        .is_ok()
}

/// As [`row`], for a line alone.
pub(crate) fn numbers(line: &str, into: &mut Vec<f64>) -> bool {
    row(line, &mut Numerals::default(), into)
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
