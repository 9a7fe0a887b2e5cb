//! Text tables that grow.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::whole_lines::WholeLines;
use crate::error::{Error, Location, Result};
use crate::format::input::Input;

/// Number of bytes read at a time until the end of the header is found, if a table is too long to be read at once.
const HEADER: u64 = 4096;
/// Most bytes of a header with its comments; those of the known formats are hundreds of times shorter.
const MOST_HEADER: usize = 1 << 20;

/// Whether a log of which `read` bytes have been read has grown to `length` bytes.
///
/// # Errors
/// It has become shorter.
pub fn has_grown(path: &Path, read: u64, length: u64) -> Result<bool> {
    if length < read {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{length} bytes after {read}"),
            "a log that only grows",
        ));
    }
    Ok(length > read)
}

/// A text table that grows. Its new rows are put below its header as an excerpt for the reader of its format, so that
/// tables of all formats can be followed.
pub struct GrowingTable {
    path: PathBuf,
    /// Largest number of bytes of new rows that are read at a time.
    most: u64,
    /// Whether the older rows are skipped if more have arrived.
    skips: bool,
    /// Number of bytes when it was last read.
    length: u64,
    /// Number of bytes read or skipped.
    read: u64,
    lines: WholeLines,
    /// Lines up to the first that is not a comment.
    header: Vec<u8>,
    header_lines: u64,
    has_header: bool,
    /// Number of lines before the newest rows, including the header; `None` if rows were skipped.
    lines_before: Option<u64>,
    new_lines: u64,
}

impl GrowingTable {
    /// A table that has not been read yet, of which the newest rows are needed: if more than `most` bytes of new rows
    /// have arrived, the older ones are skipped.
    pub fn newest(path: &Path, most: u64) -> Self {
        Self {
            skips: true,
            ..Self::in_pieces(path, most)
        }
    }

    /// A table that has not been read yet, of which all rows are needed: of its new rows, about `most` bytes are read
    /// at a time.
    pub fn in_pieces(path: &Path, most: u64) -> Self {
        Self {
            path: path.to_owned(),
            most,
            skips: false,
            length: 0,
            read: 0,
            lines: WholeLines::default(),
            header: Vec::new(),
            header_lines: 0,
            has_header: false,
            lines_before: Some(0),
            new_lines: 0,
        }
    }

    /// The path of the table.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it has bytes that had arrived at the last call of [`Self::new_rows`], but were left for the next.
    pub fn has_more(&self) -> bool {
        self.read < self.length
    }

    /// The header and the rows that were completed since the last call; `None` if there are no new rows.
    ///
    /// # Errors
    /// The file cannot be read or has become shorter; a header or a row without an end.
    pub fn new_rows(&mut self) -> Result<Option<Input>> {
        let fail = |error| Error::io(&self.path, error);
        let mut file = File::open(&self.path).map_err(fail)?;
        let length = file.metadata().map_err(fail)?.len();
        if !has_grown(&self.path, self.read, length)? {
            return Ok(None);
        }
        self.length = length;
        self.lines_before = self.lines_before.map(|lines| lines + self.new_lines);
        self.new_lines = 0;
        let mut rows = Vec::new();
        let is_blank = |rows: &[u8]| rows.iter().all(u8::is_ascii_whitespace);
        while self.read < length && (self.skips || is_blank(&rows)) {
            let left = length - self.read;
            let mut count = left;
            if left > self.most && self.has_header {
                count = self.most;
                if self.skips {
                    rows.clear();
                    self.skip(left - self.most);
                }
            } else if left > self.most {
                count = HEADER;
            }
            let mut bytes = Vec::new();
            file.seek(SeekFrom::Start(self.read))
                .and_then(|_| (&mut file).take(count).read_to_end(&mut bytes))
                .map_err(|error| Error::io(&self.path, error))?;
            if bytes.is_empty() {
                break;
            }
            self.read += bytes.len() as u64;
            let (lines, _) = self.lines.take(&bytes);
            self.split(&lines, &mut rows);
            if !self.has_header && (self.header.len() + self.lines.begun().len()) > MOST_HEADER {
                return Err(Error::format(
                    &self.path,
                    Location::Whole,
                    format!("no row of a table in the first {} bytes", self.read),
                    "a header and rows",
                ));
            }
            let begun = self.lines.begun().len();
            if self.has_header && !self.skips && begun as u64 > self.most {
                let line = self.lines_before.map(|lines| lines + self.new_lines + 1);
                return Err(Error::format(
                    &self.path,
                    line.map_or(Location::Whole, Location::Line),
                    format!("{begun} bytes without a line end"),
                    "rows of a table",
                ));
            }
        }
        if self.skips && self.lines.begun().len() as u64 > self.most {
            self.skip(0);
        }
        if is_blank(&rows) {
            return Ok(None);
        }
        let text = [self.header.as_slice(), &rows].concat();
        Ok(Some(Input::excerpt(&self.path, text)))
    }

    /// Skips bytes; the next ones may begin in the middle of a row.
    fn skip(&mut self, bytes: u64) {
        self.read += bytes;
        self.lines.interrupt(true);
        self.lines_before = None;
    }

    /// Splits whole lines into the header and rows.
    fn split(&mut self, lines: &[u8], rows: &mut Vec<u8>) {
        for line in lines.split_inclusive(|byte| *byte == b'\n') {
            let text = line.trim_ascii();
            let is_comment = text.is_empty() || text.starts_with(b"#");
            // If a comment names the columns, the rows begin right after it, with a number.
            let is_number = text
                .first()
                .is_some_and(|c| c.is_ascii_digit() || b"+-.".contains(c));
            if self.has_header || (is_number && self.header_lines > 0) {
                self.has_header = true;
                rows.extend_from_slice(line);
                self.new_lines += 1;
                continue;
            }
            self.header.extend_from_slice(line);
            self.header_lines += 1;
            self.lines_before = self.lines_before.map(|lines| lines + 1);
            self.has_header = !is_comment;
        }
    }

    /// The line of the table, from 1, that corresponds to this line of the newest excerpt; `None` if rows were skipped.
    pub fn line(&self, line: u64) -> Option<u64> {
        Some(line.saturating_sub(self.header_lines) + self.lines_before?)
    }

    /// Changes the line in an error of the newest excerpt to the line of the table; drops it if rows were skipped.
    pub fn locate(&self, error: Error) -> Error {
        match error {
            Error::Format {
                path,
                at: Location::Line(line),
                found,
                expected,
                ..
            } => {
                let at = self.line(line).map_or(Location::Whole, Location::Line);
                Error::format(path, at, found, expected)
            }
            other => other,
        }
    }

    /// Whether the end of the last line is missing.
    pub fn has_incomplete_line(&self) -> bool {
        !self.lines.begun().trim_ascii().is_empty()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn all_rows_are_read_in_pieces_of_bounded_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let row = |i: u32| format!("{i},{}\n", i % 360);
        let text: String = (1..=20_000).map(row).collect();
        fs::write(&path, format!("# a comment\ntime_s,heading_deg\n{text}")).unwrap();
        let mut table = GrowingTable::in_pieces(&path, 1 << 13);
        let (mut times_s, mut line) = (Vec::new(), 2);
        while let Some(rows) = table.new_rows().unwrap() {
            let fixes = crate::format::read_heading(&rows).unwrap();
            assert!(fixes.len() <= 1 << 11, "{}", fixes.len());
            assert_eq!(table.line(3), Some(line + 1));
            line += fixes.len() as u64;
            times_s.extend(fixes.iter().map(|fix| fix.time_s));
            assert_eq!(table.has_more(), times_s.len() < 20_000);
        }
        assert!(times_s.into_iter().eq((1..=20_000).map(f64::from)));
        let endless = "1".repeat(1 << 14);
        fs::write(&path, format!("time_s,heading_deg\n1,2\n{endless}")).unwrap();
        let mut table = GrowingTable::in_pieces(&path, 1 << 13);
        assert!(table.new_rows().unwrap().is_some());
        let error = table.new_rows().unwrap_err().to_string();
        assert!(
            error.contains("line 3") && error.contains("without a line end"),
            "{error}"
        );
    }

    #[test]
    fn a_file_without_rows_is_refused_before_it_fills_the_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        for text in ["# ", "# a comment\n"] {
            fs::write(&path, text.repeat(MOST_HEADER)).unwrap();
            let error = GrowingTable::newest(&path, 1 << 16).new_rows().unwrap_err();
            assert!(error.to_string().contains("no row of a table"), "{error}");
        }
    }
}
