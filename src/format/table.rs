//! Text tables: a header that names columns and units, `#` comments, and numbers between commas,
//! semicolons or white space, in any column order.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};

/// Longer lines are not of a table; the limit keeps binary files from filling the memory.
const LONGEST_LINE: u64 = 1 << 20;

/// The lines of a text file, one at a time, without their ends.
#[derive(Debug)]
pub(crate) struct Lines {
    path: PathBuf,
    reader: BufReader<File>,
    line: Vec<u8>,
    number: u64,
    bytes: u64,
    total: u64,
}

impl Lines {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let (file, total) = super::open(path)?;
        Ok(Self {
            path: path.to_owned(),
            reader: BufReader::with_capacity(1 << 18, file),
            line: Vec::new(),
            number: 0,
            bytes: 0,
            total,
        })
    }

    /// Reads the next line; false at the end.
    pub(crate) fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        let read = (&mut self.reader)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut self.line)
            .map_err(|e| Error::io(&self.path, e))? as u64;
        self.number += 1;
        self.bytes += read;
        let text = match std::str::from_utf8(&self.line) {
            Ok(_) if read == LONGEST_LINE => Err("a line of more than a mebibyte"),
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
        // Checked when it was read.
        std::str::from_utf8(bytes).unwrap_or_default().trim_ascii()
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

/// What stands between the cells of a table.
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

    /// Hands every cell of `line` to `take`, with its index, until it fails.
    #[inline]
    fn split<E>(
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

    /// The cells of a header: names without quotes.
    pub(crate) fn names(self, line: &str) -> Vec<String> {
        let mut names = Vec::new();
        let _ = self.split::<()>(line, |_, cell| {
            names.push(cell.trim_matches('"').trim_ascii().to_owned());
            Ok(())
        });
        names
    }
}

/// All numbers of a line, whatever separates them; `None` where a cell is no number.
pub(crate) fn numbers(line: &str, into: &mut Vec<f64>) -> bool {
    into.clear();
    Separator::of(line)
        .split(line, |_, cell| {
            into.push(cell.parse::<f64>().map_err(|_| ())?);
            Ok::<(), ()>(())
        })
        .is_ok()
}

/// The names in the header of a table: the first line that is neither empty nor a comment, or the
/// last comment before numbers.
pub(crate) fn header_names(path: &Path) -> Result<Vec<String>> {
    let mut lines = Lines::open(path)?;
    let mut comment = Vec::new();
    while lines.advance()? {
        let text = lines.text();
        if let Some(text) = text.strip_prefix('#') {
            comment = Separator::of(text).names(text);
        } else if !text.is_empty() {
            let is_numeric = numbers(text, &mut Vec::new());
            return Ok(match is_numeric {
                true => comment,
                false => Separator::of(text).names(text),
            });
        }
    }
    Ok(comment)
}

/// The columns that a reader wants: those it needs, then those it can use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Columns {
    pub(crate) needed: &'static [&'static str],
    pub(crate) optional: &'static [&'static str],
}

impl Columns {
    fn wanted(&self) -> impl Iterator<Item = &'static str> {
        self.needed.iter().chain(self.optional).copied()
    }

    /// Are all needed columns among `names`?
    pub(crate) fn are_in(&self, names: &[String]) -> bool {
        self.needed
            .iter()
            .all(|needed| names.iter().any(|name| name == needed))
    }

    fn describe(&self) -> String {
        let mut text = format!("columns {}", self.needed.join(", "));
        if !self.optional.is_empty() {
            text += &format!(" and perhaps {}", self.optional.join(", "));
        }
        text
    }
}

/// A table, read row by row.
#[derive(Debug)]
pub(crate) struct Table {
    lines: Lines,
    separator: Separator,
    names: Vec<String>,
    /// For each column of the file: which of the wanted it is, and whether it may be empty.
    slots: Vec<Option<(usize, bool)>>,
    width: usize,
    /// The line last read is a row that has not been handed out.
    pending: bool,
}

impl Table {
    /// Opens a table and finds the wanted columns in its header. A comment is taken for the
    /// header where numbers follow it and it names the needed columns.
    pub(crate) fn open(path: &Path, columns: &Columns) -> Result<Self> {
        let mut lines = Lines::open(path)?;
        let mut comment: Option<Vec<String>> = None;
        let mut cells = Vec::new();
        loop {
            if !lines.advance()? {
                return Err(Error::format(
                    path,
                    Location::Whole,
                    "no header",
                    columns.describe(),
                ));
            }
            let text = lines.text();
            if text.is_empty() {
                continue;
            }
            if let Some(text) = text.strip_prefix('#') {
                comment = Some(Separator::of(text).names(text));
                continue;
            }
            let separator = Separator::of(text);
            let is_numeric = numbers(text, &mut cells);
            let names = match comment.take() {
                Some(names) if is_numeric && columns.are_in(&names) => names,
                _ => separator.names(text),
            };
            if is_numeric && !columns.are_in(&names) {
                return Err(lines.error(
                    format!("{} numbers and no header before them", cells.len()),
                    format!("a header with the {}", columns.describe()),
                ));
            }
            let slots = find(&lines, &names, columns)?;
            return Ok(Self {
                lines,
                separator,
                names,
                slots,
                width: columns.wanted().count(),
                pending: is_numeric,
            });
        }
    }

    /// Reads the next row into `row`: needed columns first, then optional ones, NaN where the
    /// file has no such column or an empty cell. False at the end.
    pub(crate) fn next_row(&mut self, row: &mut [f64]) -> Result<bool> {
        debug_assert_eq!(row.len(), self.width);
        loop {
            if self.pending {
                self.pending = false;
            } else if !self.lines.advance()? {
                return Ok(false);
            }
            let text = self.lines.text();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            row.fill(f64::NAN);
            let slots = &self.slots;
            let outcome = self.separator.split(text, |i, cell| match slots.get(i) {
                None | Some(None) => Ok(()),
                Some(Some((slot, may_be_empty))) => match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => {
                        row[*slot] = value;
                        Ok(())
                    }
                    _ if cell.is_empty() && *may_be_empty => Ok(()),
                    _ => Err(i),
                },
            });
            return match outcome {
                Ok(count) if count == slots.len() => Ok(true),
                Ok(count) => Err(self.lines.error(
                    format!("{count} values"),
                    format!(
                        "{} as in the header ({})",
                        slots.len(),
                        self.names.join(", ")
                    ),
                )),
                Err(i) => Err(self.bad_cell(i)),
            };
        }
    }

    fn bad_cell(&self, column: usize) -> Error {
        let mut found = String::new();
        let _ = self.separator.split::<()>(self.lines.text(), |i, cell| {
            if i == column {
                found = cell.chars().take(40).collect();
            }
            Ok(())
        });
        self.lines.error(
            format!("`{found}` in column {}", self.names[column]),
            "a finite number",
        )
    }

    /// The names in the header, in the order of the file.
    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    pub(crate) fn lines(&self) -> &Lines {
        &self.lines
    }

    /// A format error at the row last read.
    pub(crate) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        self.lines.error(found, expected)
    }
}

/// Finds the wanted columns among `names`.
fn find(lines: &Lines, names: &[String], columns: &Columns) -> Result<Vec<Option<(usize, bool)>>> {
    let mut slots = vec![None; names.len()];
    let needed = columns.needed.len();
    for (slot, wanted) in columns.wanted().enumerate() {
        let mut places = names.iter().enumerate().filter(|(_, name)| *name == wanted);
        match (places.next(), places.next()) {
            (Some(_), Some(_)) => {
                return Err(lines.error(format!("column {wanted} twice"), "each column once"));
            }
            (Some((place, _)), None) => slots[place] = Some((slot, slot >= needed)),
            (None, _) => {
                // An optional column that is nearly there is a slip of the pen, not an absence; of
                // short names every other one is near.
                let reach = if slot < needed { 2 } else { wanted.len() / 4 };
                let near = nearest(wanted, names, columns, reach.min(2));
                if slot < needed || near.is_some() {
                    let hint = near.map_or_else(String::new, |near| {
                        format!(" (`{near}` looks like `{wanted}`)")
                    });
                    return Err(lines.error(
                        format!("columns {}, without {wanted}{hint}", shown(names)),
                        columns.describe(),
                    ));
                }
            }
        }
    }
    Ok(slots)
}

/// The header of a file that may be anything, short enough to print.
fn shown(names: &[String]) -> String {
    let text: String = names.join(", ").chars().take(200).collect();
    if text.is_empty() {
        "(none)".to_owned()
    } else {
        text
    }
}

/// The name in the file that is most like `wanted` and is not itself a wanted one.
fn nearest<'a>(
    wanted: &str,
    names: &'a [String],
    columns: &Columns,
    reach: usize,
) -> Option<&'a str> {
    names
        .iter()
        .filter(|name| !columns.wanted().any(|other| other == name.as_str()))
        .map(|name| (strsim::osa_distance(&name.to_lowercase(), wanted), name))
        .filter(|(distance, _)| *distance <= reach)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: Columns = Columns {
        needed: &["time_s", "x_m"],
        optional: &["sigma_m"],
    };

    fn rows(text: &str) -> Result<Vec<[f64; 3]>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        std::fs::write(&path, text).unwrap();
        let mut table = Table::open(&path, &COLUMNS)?;
        let mut rows = Vec::new();
        let mut row = [0.0; 3];
        while table.next_row(&mut row)? {
            rows.push(row);
        }
        Ok(rows)
    }

    fn message(text: &str) -> String {
        rows(text).unwrap_err().to_string()
    }

    #[test]
    fn separators_order_comments_and_line_ends_do_not_matter() {
        for text in [
            "time_s,x_m,sigma_m\n1,2,3\n",
            "\u{feff}# made by hand\r\n\r\n x_m ; sigma_m;time_s\r\n2;3; 1\r\n",
            "x_m\ttime_s  other sigma_m\n# half way\n2 1 red 3",
            "# time_s, x_m, sigma_m\n1, 2, 3\n",
            "\"time_s\",\"x_m\",\"sigma_m\"\n1e0,+2.0,3\n\n",
        ] {
            assert_eq!(rows(text).unwrap(), [[1.0, 2.0, 3.0]], "{text}");
        }
        assert!(rows("time_s,x_m\n1,2").unwrap()[0][2].is_nan());
        assert!(rows("time_s,x_m,sigma_m\n1,2,\n").unwrap()[0][2].is_nan());
    }

    #[test]
    fn errors_name_line_finding_and_expectation() {
        let text = message("time_s,x_mm\n1,2\n");
        assert!(
            text.contains("line 1") && text.contains("`x_mm` looks like `x_m`"),
            "{text}"
        );
        let text = message("time_s,x_m,sgma_m\n1,2,3\n");
        assert!(text.contains("`sgma_m` looks like `sigma_m`"), "{text}");
        let text = message("time_s,x_m\n1,2\n3,NaN\n");
        assert!(
            text.contains("line 3") && text.contains("`NaN` in column x_m"),
            "{text}"
        );
        let text = message("time_s,x_m\n1,\n");
        assert!(text.contains("`` in column x_m"), "{text}");
        let text = message("time_s,x_m\n# c\n1,2,3\n");
        assert!(
            text.contains("line 3: found 3 values, expected 2"),
            "{text}"
        );
        let text = message("1,2\n");
        assert!(text.contains("2 numbers and no header"), "{text}");
        let text = message("time_s,x_m,x_m\n1,2,2\n");
        assert!(text.contains("column x_m twice"), "{text}");
        assert!(message("# nothing\n").contains("no header"));
        assert!(message("time_s\0,x_m\n").contains("zero bytes"));
    }
}
