//! Text tables: a header with column names and units, `#` comments, and numbers separated by
//! commas, semicolons or white space, in any column order.

use std::path::Path;

use super::lines::{Lines, Separator, numbers};
use super::unit::factor;
use crate::error::{Error, Location, Result};

/// The columns that a reader wants: those it needs, then those it can use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Columns<'a> {
    pub(crate) needed: &'a [&'a str],
    pub(crate) optional: &'a [&'a str],
}

impl<'a> Columns<'a> {
    fn wanted(&self) -> impl Iterator<Item = &'a str> {
        self.needed.iter().chain(self.optional).copied()
    }

    /// Whether all required columns are among `names`.
    pub(crate) fn are_in(&self, names: &[String]) -> bool {
        self.needed
            .iter()
            .all(|needed| names.iter().any(|name| factor(name, needed).is_some()))
    }

    fn describe(&self) -> String {
        let mut text = format!("columns {}", self.needed.join(", "));
        if !self.optional.is_empty() {
            text += &format!(" and optionally {}", self.optional.join(", "));
        }
        text
    }
}

/// What a column of the file is among the wanted columns.
#[derive(Debug, Clone, Copy)]
struct Slot {
    index: usize,
    may_be_empty: bool,
    /// From the file's unit to the wanted one.
    factor: f64,
}

/// A table, read row by row.
#[derive(Debug)]
pub(crate) struct Table {
    lines: Lines,
    separator: Separator,
    names: Vec<String>,
    /// Of each column of the file.
    slots: Vec<Option<Slot>>,
    width: usize,
    /// The last line read is a row that has not been returned yet.
    pending: bool,
}

impl Table {
    /// Opens a table and looks up the wanted columns in its header. A comment counts as the header
    /// if it names the required columns and numbers follow.
    pub(crate) fn open(path: &Path, columns: &Columns<'_>) -> Result<Self> {
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
                    format!("{} numbers without a header", cells.len()),
                    format!("a header with the {}", columns.describe()),
                ));
            }
            let slots = match_columns(&lines, &names, columns)?;
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

    /// Reads the next row into `row`: required columns first, then optional ones, NaN if the file
    /// has no such column or the cell is empty. False at the end.
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
                Some(Some(slot)) => match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => {
                        row[slot.index] = value * slot.factor;
                        Ok(())
                    }
                    _ if cell.is_empty() && slot.may_be_empty => Ok(()),
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

    /// A format error at the last row read.
    pub(crate) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        self.lines.error(found, expected)
    }
}

/// Looks up the wanted columns among `names`.
fn match_columns(
    lines: &Lines,
    names: &[String],
    columns: &Columns<'_>,
) -> Result<Vec<Option<Slot>>> {
    let mut slots = vec![None; names.len()];
    let needed = columns.needed.len();
    for (slot, wanted) in columns.wanted().enumerate() {
        let mut places = names
            .iter()
            .enumerate()
            .filter_map(|(place, name)| Some((place, factor(name, wanted)?)));
        match (places.next(), places.next()) {
            (Some(_), Some(_)) => {
                return Err(lines.error(format!("column {wanted} twice"), "each column once"));
            }
            (Some((place, factor)), None) => {
                slots[place] = Some(Slot {
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
                    return Err(lines.error(
                        format!("columns {}, without {wanted}{hint}", abbreviated(names)),
                        columns.describe(),
                    ));
                }
            }
        }
    }
    Ok(slots)
}

/// The header of an arbitrary file, short enough to print.
fn abbreviated(names: &[String]) -> String {
    let text: String = names.join(", ").chars().take(200).collect();
    if text.is_empty() {
        "(none)".to_owned()
    } else {
        text
    }
}

/// The name in the file that is closest to `wanted` and is not itself a wanted one.
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
        assert!(message("# nothing\n").contains("no header"));
        assert!(message("time_s\0,x_m\n").contains("zero bytes"));
    }
}
