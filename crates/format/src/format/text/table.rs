//! Tables with columns in any order, identified by names with units. A table is either text with a header, `#`
//! comments, and numbers separated by commas, semicolons or white space; or Parquet.

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::parquet::Rows;
use crate::format::text::lines::{Lines, MOST_COLUMNS, Separator, numbers, without_trailer};
use crate::format::text::numerals::Numerals;
use crate::format::text::unit::factor;

/// The columns that a reader wants: needed columns, then optional columns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Columns<'a> {
    pub(crate) needed: &'a [&'a str],
    pub(crate) optional: &'a [&'a str],
}

impl<'a> Columns<'a> {
    fn wanted(&self) -> impl Iterator<Item = &'a str> {
        self.needed.iter().chain(self.optional).copied()
    }

    /// Whether all needed columns are among `names`.
    pub(crate) fn are_in(&self, names: &[String]) -> bool {
        self.needed
            .iter()
            .all(|needed| names.iter().any(|name| factor(name, needed).is_some()))
    }

    /// Whether one of the columns has this name.
    pub(crate) fn names(&self, name: &str) -> bool {
        self.wanted().any(|wanted| factor(name, wanted).is_some())
    }

    fn describe(&self) -> String {
        let mut text = format!("columns {}", self.needed.join(", "));
        if !self.optional.is_empty() {
            text += &format!(" and optionally {}", self.optional.join(", "));
        }
        text
    }
}

/// The wanted column that a column of the file supplies.
#[derive(Debug, Clone, Copy)]
struct Slot {
    /// Index among the wanted columns.
    index: usize,
    may_be_empty: bool,
    /// Factor from the file's unit to the wanted unit.
    factor: f64,
}

/// The file from which the rows are read.
#[derive(Debug)]
enum Source {
    Text {
        lines: Lines,
        separator: Separator,
        /// How commas in numbers are read.
        numerals: Numerals,
        /// Whether the last line read is a row that has not been returned yet.
        pending: bool,
    },
    Parquet(Box<Rows>),
}

/// A table, read row by row.
#[derive(Debug)]
pub(crate) struct Table {
    source: Source,
    names: Vec<String>,
    /// Slot of each column of the file; `None` for columns that are not wanted.
    slots: Vec<Option<Slot>>,
    width: usize,
}

impl Table {
    /// Opens a table and looks up the wanted columns in its header. A comment counts as the header
    /// if it names the needed columns and numbers follow.
    pub(crate) fn open(input: &Input, columns: &Columns<'_>) -> Result<Self> {
        if input.is_parquet() {
            return Self::open_parquet(input, columns);
        }
        let mut lines = Lines::open(input)?;
        let mut comment: Option<Vec<String>> = None;
        let mut cells = Vec::new();
        loop {
            if !lines.advance()? {
                return Err(Error::format(
                    input.path(),
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
                    format!("{} numbers without a header", cells.len()),
                    format!("a header with the {}", columns.describe()),
                ));
            }
            if names.len() > MOST_COLUMNS {
                let found = format!("more than {MOST_COLUMNS} columns");
                return Err(lines.error(found, format!("a table with {}", columns.describe())));
            }
            let slots = match_columns(&names, columns, |found, wanted| lines.error(found, wanted))?;
            return Ok(Self {
                source: Source::Text {
                    lines,
                    separator,
                    numerals: Numerals::default(),
                    pending: is_numeric,
                },
                names,
                slots,
                width: columns.wanted().count(),
            });
        }
    }

    fn open_parquet(input: &Input, columns: &Columns<'_>) -> Result<Self> {
        let mut rows = Rows::open(input)?;
        let names = rows.names().to_vec();
        let slots = match_columns(&names, columns, |found, wanted| rows.error(found, wanted))?;
        rows.select((0..slots.len()).filter(|i| slots[*i].is_some()).collect())?;
        Ok(Self {
            source: Source::Parquet(Box::new(rows)),
            names,
            slots,
            width: columns.wanted().count(),
        })
    }

    /// Reads the next row into `row`: needed columns first, then optional columns. Values are NaN if the
    /// file has no such column or the cell is empty. False at the end.
    pub(crate) fn next_row(&mut self, row: &mut [f64]) -> Result<bool> {
        debug_assert_eq!(row.len(), self.width);
        let (names, slots) = (&self.names, &self.slots);
        match &mut self.source {
            Source::Text {
                lines,
                separator,
                numerals,
                pending,
            } => {
                if !std::mem::take(pending) && !lines.next_content()? {
                    return Ok(false);
                }
                let read = text_row(lines, *separator, numerals, names, slots, row);
                read.or_else(|error| {
                    // Rows may have other separators than the header above them.
                    let of_row = match Separator::of(without_trailer(lines.text())) {
                        // Tabs may also be aligned.
                        Separator::Tab => Separator::Space,
                        other => other,
                    };
                    if of_row == *separator {
                        return Err(error);
                    }
                    text_row(lines, of_row, numerals, names, slots, row).map_err(|_| error)?;
                    *separator = of_row;
                    Ok(())
                })?;
            }
            Source::Parquet(rows) => {
                if !rows.advance()? {
                    return Ok(false);
                }
                row.fill(f64::NAN);
                let used = slots.iter().zip(names);
                let used = used.filter_map(|(slot, name)| Some(((*slot)?, name)));
                for (i, (slot, name)) in used.enumerate() {
                    match rows.cell(i) {
                        // The value must be finite in the wanted unit, too.
                        Some(value) if (value * slot.factor).is_finite() => {
                            row[slot.index] = value * slot.factor;
                        }
                        Some(value) if value.is_nan() && slot.may_be_empty => {}
                        None if slot.may_be_empty => {}
                        cell => {
                            let found = cell.map_or("null".to_owned(), |value| value.to_string());
                            return Err(bad_cell(&found, name, |f, e| rows.error(f, e)));
                        }
                    }
                }
            }
        }
        Ok(true)
    }

    /// The names in the header, in the order of the file.
    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    /// The line or the row last read, counted from 1.
    pub(crate) fn number(&self) -> u64 {
        match &self.source {
            Source::Text { lines, .. } => lines.number(),
            Source::Parquet(rows) => rows.number(),
        }
    }

    pub(crate) fn bytes_read(&self) -> u64 {
        match &self.source {
            Source::Text { lines, .. } => lines.bytes_read(),
            Source::Parquet(rows) => rows.bytes_read(),
        }
    }

    pub(crate) fn bytes_total(&self) -> u64 {
        match &self.source {
            Source::Text { lines, .. } => lines.bytes_total(),
            Source::Parquet(rows) => rows.bytes_total(),
        }
    }

    /// A format error at the last row read.
    pub(crate) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        match &self.source {
            Source::Text { lines, .. } => lines.error(found, expected),
            Source::Parquet(rows) => rows.error(found, expected),
        }
    }
}

/// Parses the line last read into `row`. What follows the values, a comment or a separator, is passed over.
fn text_row(
    lines: &Lines,
    separator: Separator,
    numerals: &mut Numerals,
    names: &[String],
    slots: &[Option<Slot>],
    row: &mut [f64],
) -> Result<()> {
    row.fill(f64::NAN);
    let mut parse = |text: &str| {
        let count = separator.split(text, |i, cell| match slots.get(i) {
            None | Some(None) => Ok(()),
            Some(Some(slot)) => match numerals.number(cell) {
                // The value must be finite in the wanted unit, too.
                Some(value) if (value * slot.factor).is_finite() => {
                    row[slot.index] = value * slot.factor;
                    Ok(())
                }
                Some(value) if value.is_nan() && slot.may_be_empty => Ok(()),
                _ => {
                    let found: String = cell.chars().take(40).collect();
                    Err(bad_cell(&found, &names[i], |f, e| lines.error(f, e)))
                }
            },
        })?;
        // The last tabs of a line are lost with the white space around it.
        let may_end = separator == Separator::Tab && count < slots.len();
        let is_optional = |slot: &Option<Slot>| slot.is_none_or(|slot| slot.may_be_empty);
        if count == slots.len() || may_end && slots[count..].iter().all(is_optional) {
            return Ok(());
        }
        let expected = format!("{} as in the header ({})", slots.len(), names.join(", "));
        Err(lines.error(format!("{count} values"), expected))
    };
    let whole = lines.text();
    parse(whole).or_else(|error| match without_trailer(whole) {
        values if values.len() < whole.len() => parse(values).map_err(|_| error),
        _ => Err(error),
    })
}

fn bad_cell(found: &str, name: &str, error: impl FnOnce(String, &str) -> Error) -> Error {
    error(format!("`{found}` in column {name}"), "a finite number")
}

/// Looks up the wanted columns among `names`.
fn match_columns(
    names: &[String],
    columns: &Columns<'_>,
    error: impl Fn(String, String) -> Error,
) -> Result<Vec<Option<Slot>>> {
    let mut slots = vec![None; names.len()];
    let needed = columns.needed.len();
    for (slot, wanted) in columns.wanted().enumerate() {
        let mut matches = names
            .iter()
            .enumerate()
            .filter_map(|(column, name)| Some((column, factor(name, wanted)?)));
        match (matches.next(), matches.next()) {
            (Some(_), Some(_)) => {
                let found = format!("column {wanted} twice");
                return Err(error(found, "each column once".to_owned()));
            }
            (Some((column, factor)), None) => {
                slots[column] = Some(Slot {
                    index: slot,
                    may_be_empty: slot >= needed,
                    factor,
                });
            }
            (None, _) => {
                // A name close to an optional column is a typing error, not an absent column; short
                // names have too many close names.
                let reach = if slot < needed { 2 } else { wanted.len() / 4 };
                let near = nearest(wanted, names, columns, reach.min(2));
                if slot < needed || near.is_some() {
                    let hint = near.map_or_else(String::new, |near| {
                        format!(" (`{near}` looks like `{wanted}`)")
                    });
                    return Err(error(
                        format!("columns {}, without {wanted}{hint}", abbreviated(names)),
                        columns.describe(),
                    ));
                }
            }
        }
    }
    Ok(slots)
}

/// The names in a header, short enough to print.
fn abbreviated(names: &[String]) -> String {
    let text: String = names.join(", ").chars().take(200).collect();
    if text.is_empty() {
        "(none)".to_owned()
    } else {
        text
    }
}

/// The name in the file that is closest to `wanted` and is not itself the name of a wanted column.
fn nearest<'a>(
    wanted: &str,
    names: &'a [String],
    columns: &Columns<'_>,
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
        let mut table = Table::open(&Input::from(&path), &COLUMNS)?;
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
            "time_s\tx_m\tother\tsigma_m\n1\t2\t\t3\n",
            "time_s\tx_m\tsigma_m\n1\t\t2\t\t3\n",
        ] {
            assert_eq!(rows(text).unwrap(), [[1.0, 2.0, 3.0]], "{text}");
        }
        assert!(rows("time_s,x_m\n1,2").unwrap()[0][2].is_nan());
        for text in [
            "time_s,x_m,sigma_m\n1,2,\n",
            "time_s\tx_m\tsigma_m\n1\t2\t\n",
        ] {
            assert!(rows(text).unwrap()[0][2].is_nan(), "{text}");
        }
    }

    #[test]
    fn other_units_are_converted() {
        let found = rows("time_ms,x_mm,sigma_cm\n1500,250,2\n").unwrap();
        assert_eq!(found, [[1.5, 0.25, 0.02]]);
    }

    #[test]
    fn errors_name_line_finding_and_expectation() {
        let text = message("time_s,x_me\n1,2\n");
        assert!(
            text.contains("line 1") && text.contains("`x_me` looks like `x_m`"),
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
        assert!(text.contains("2 numbers without a header"), "{text}");
        let text = message("time_s,x_m,x_m\n1,2,2\n");
        assert!(text.contains("column x_m twice"), "{text}");
        let text = message("time_s,x_m,x_mm\n1,2,2\n");
        assert!(text.contains("column x_m twice"), "{text}");
        let text = message("time_s,x_km\n1,1e307\n");
        assert!(text.contains("`1e307` in column x_km"), "{text}");
        let text = message(&format!("time_s,x_m{}\n", ",a".repeat(MOST_COLUMNS)));
        assert!(
            text.contains("line 1: found more than 1024 columns"),
            "{text}"
        );
        assert!(message("# nothing\n").contains("no header"));
        assert!(message("time_s\0,x_m\n").contains("zero bytes"));
    }
}
