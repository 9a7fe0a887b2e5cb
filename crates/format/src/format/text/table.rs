//! Tables with columns in any order, identified by names with units. A table is either text with a header, `#`
//! comments, and numbers separated by commas, semicolons or white space; or Parquet.

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::parquet::Rows;
use crate::format::text::civil::unix_from_iso;
use crate::format::text::lines::{Lines, MOST_COLUMNS, Separator, numbers, without_trailer};
use crate::format::text::numerals::Numerals;
use crate::format::text::unit::factor_of;

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
        self.needed.iter().all(|needed| {
            names
                .iter()
                .any(|name| factor_of(name, needed, names).is_some())
        })
    }

    /// Whether one of the columns has this name.
    pub(crate) fn names(&self, name: &str) -> bool {
        self.wanted()
            .any(|wanted| factor_of(name, wanted, &[]).is_some())
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
    /// Whether it may also hold dates with times of UTC.
    is_time: bool,
}

impl Slot {
    /// The value of a number in the file; NaN stands for a missing one. `None` if it is not finite in the wanted unit.
    fn value(&self, number: f64) -> Option<f64> {
        let value = number * self.factor;
        (value.is_finite() || number.is_nan()).then_some(value)
    }
}

/// What was read of a row.
enum Read {
    Row,
    /// A row without a value in this column of the file, which is needed, and what is in its place.
    Incomplete(usize, String),
    End,
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
    input: Input,
    /// Rows that were returned.
    complete: u64,
    /// Rows without a value in a needed column, which are left out.
    incomplete: u64,
    /// What is said of the first of them if there are too many: its line, and the column.
    first_incomplete: Option<(u64, Error)>,
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
            let mut names = names;
            // A separator behind the last name.
            if names.len() > 1 && names.last().is_some_and(String::is_empty) {
                names.pop();
            }
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
                input: input.clone(),
                complete: 0,
                incomplete: 0,
                first_incomplete: None,
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
            input: input.clone(),
            complete: 0,
            incomplete: 0,
            first_incomplete: None,
        })
    }

    /// Reads the next row into `row`: needed columns first, then optional columns. Values are NaN if the
    /// file has no such column or the cell is empty. Rows without a value in a needed column are left out, which the
    /// input remarks. False at the end.
    ///
    /// # Errors
    /// A cell that is no number; at the end, as many rows without a value as rows with all of them.
    pub(crate) fn next_row(&mut self, row: &mut [f64]) -> Result<bool> {
        debug_assert_eq!(row.len(), self.width);
        loop {
            match self.read_row(row)? {
                Read::Row => {
                    self.complete += 1;
                    return Ok(true);
                }
                Read::Incomplete(column, found) => {
                    if self.first_incomplete.is_none() {
                        let error = bad_cell(&found, &self.names[column], |f, e| self.error(f, e));
                        self.first_incomplete = Some((self.number(), error));
                    }
                    self.incomplete += 1;
                }
                Read::End => {
                    self.conclude()?;
                    return Ok(false);
                }
            }
        }
    }

    /// Remarks on the rows that were left out.
    fn conclude(&mut self) -> Result<()> {
        let Some((line, error)) = self.first_incomplete.take() else {
            return Ok(());
        };
        if self.incomplete >= self.complete {
            return Err(error);
        }
        self.input.remark(format!(
            "rows without a value in a column that is needed left out: {}, the first in line {line}",
            self.incomplete
        ));
        Ok(())
    }

    /// Reads the next row, which may lack values.
    fn read_row(&mut self, row: &mut [f64]) -> Result<Read> {
        let is_first = self.complete + self.incomplete == 0;
        let (names, slots) = (&self.names, &self.slots);
        match &mut self.source {
            Source::Text {
                lines,
                separator,
                numerals,
                pending,
            } => {
                if !std::mem::take(pending) && !lines.next_content()? {
                    return Ok(Read::End);
                }
                let are_units = is_first && are_units(&separator.names(lines.text()), names, slots);
                if are_units && !lines.next_content()? {
                    return Ok(Read::End);
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
                    let read = text_row(lines, of_row, numerals, names, slots, row);
                    *separator = of_row;
                    read.map_err(|_| error)
                })
            }
            Source::Parquet(rows) => {
                if !rows.advance()? {
                    return Ok(Read::End);
                }
                row.fill(f64::NAN);
                let mut missing = None;
                let used = slots.iter().enumerate();
                let used = used.filter_map(|(column, slot)| Some((column, (*slot)?)));
                for (i, (column, slot)) in used.enumerate() {
                    let value = rows.cell(i).unwrap_or(f64::NAN);
                    let error =
                        || bad_cell(&value.to_string(), &names[column], |f, e| rows.error(f, e));
                    row[slot.index] = slot.value(value).ok_or_else(error)?;
                    if row[slot.index].is_nan() && !slot.may_be_empty {
                        missing.get_or_insert_with(|| (column, "null".to_owned()));
                    }
                }
                Ok(missing.map_or(Read::Row, |(at, found)| Read::Incomplete(at, found)))
            }
        }
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

/// Whether the cells below a header repeat the units that the names of the wanted columns end in.
fn are_units(cells: &[String], names: &[String], slots: &[Option<Slot>]) -> bool {
    let is_unit = |cell: &str, name: &str| {
        let unit = cell.trim_matches(['[', ']', '(', ')', '"']).to_lowercase();
        let unit = unit
            .replace('/', "_")
            .replace(['^', '*', 'ˆ'], "")
            .replace('²', "2");
        !unit.is_empty() && name.to_lowercase().ends_with(&format!("_{unit}"))
    };
    let wanted = cells
        .iter()
        .zip(names)
        .zip(slots)
        .filter(|(_, slot)| slot.is_some());
    let mut wanted = wanted
        .map(|((cell, name), _)| is_unit(cell, name))
        .peekable();
    cells.len() == names.len() && wanted.peek().is_some() && wanted.all(|is_unit| is_unit)
}

/// Parses the line last read into `row`. What follows the values, a comment or a separator, is passed over.
fn text_row(
    lines: &Lines,
    separator: Separator,
    numerals: &mut Numerals,
    names: &[String],
    slots: &[Option<Slot>],
    row: &mut [f64],
) -> Result<Read> {
    let mut parse = |text: &str| {
        row.fill(f64::NAN);
        let mut tried = *numerals;
        let mut missing = None;
        let count = separator.split(text, |i, cell| {
            let Some(Some(slot)) = slots.get(i) else {
                return Ok::<(), Error>(());
            };
            let date = || unix_from_iso(cell.trim_matches('"')).filter(|_| slot.is_time);
            let value = tried.number(cell).and_then(|number| slot.value(number));
            let shown = || cell.chars().take(40).collect::<String>();
            let value = value
                .or_else(date)
                .ok_or_else(|| bad_cell(&shown(), &names[i], |f, e| lines.error(f, e)))?;
            row[slot.index] = value;
            if value.is_nan() && !slot.may_be_empty {
                missing.get_or_insert_with(|| (i, shown()));
            }
            Ok(())
        })?;
        // The last tabs of a line are lost with the white space around it.
        let may_end = separator == Separator::Tab && count < slots.len();
        let is_optional = |slot: &Option<Slot>| slot.is_none_or(|slot| slot.may_be_empty);
        if count == slots.len() || may_end && slots[count..].iter().all(is_optional) {
            *numerals = tried;
            return Ok(missing.map_or(Read::Row, |(at, found)| Read::Incomplete(at, found)));
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
            .filter_map(|(column, name)| Some((column, factor_of(name, wanted, names)?)));
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
                    is_time: wanted == "time_s",
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
mod tests;
