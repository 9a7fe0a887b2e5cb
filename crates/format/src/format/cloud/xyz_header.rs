//! The header of a cloud in a text of another program, and its rows.

use crate::error::Result;
use crate::format::cloud::names::{Meaning, has_places, meaning, unit_factor};
use crate::format::text::civil::unix_from_iso;
use crate::format::text::lines::{Lines, Separator, without_trailer};
use crate::format::text::numerals::Numerals;

/// A column that is read: its meaning, and the factor to metres or seconds.
type Slot = Option<(Meaning, f64)>;

/// The values of a row: one for each [`Meaning`].
pub(super) const VALUES: usize = 8;

/// The columns that are read, and the separator of lines.
pub(super) struct Header {
    names: Vec<String>,
    slots: Vec<Slot>,
    separator: Separator,
}

impl Header {
    fn of(lines: &Lines, mut names: Vec<String>, separator: Separator) -> Result<Self> {
        // A separator behind the last name.
        if names.last().is_some_and(String::is_empty) {
            names.pop();
        }
        let mut slots: Vec<Slot> = names
            .iter()
            .map(|name| meaning(name).map_err(|unit| lines.error(unit, "m, mm, cm, km or ft")))
            .collect::<Result<_>>()?;
        // Of several places of sensors, the first is taken.
        for at in 1..slots.len() {
            let is_repeated = |(meaning, _): (Meaning, f64)| {
                meaning.is_viewpoint() && slots[..at].iter().flatten().any(|(m, _)| *m == meaning)
            };
            if slots[at].is_some_and(is_repeated) {
                slots[at] = None;
            }
        }
        for (at, slot) in slots.iter().enumerate() {
            let Some((meaning, _)) = slot else { continue };
            let is_same = |other: &&Slot| other.is_some_and(|(other, _)| other == *meaning);
            if let Some(before) = slots[..at].iter().position(|slot| is_same(&slot)) {
                let found = format!(
                    "the columns {} and {} with the same meaning",
                    names[before], names[at]
                );
                return Err(lines.error(found, "each of x, y, z, time and intensity once"));
            }
        }
        Ok(Self {
            names,
            slots,
            separator,
        })
    }

    /// Takes a line with the units of the columns; false, and nothing changes, if it is none.
    pub(super) fn take_units(&mut self, text: &str) -> bool {
        let units = self.separator.names(text);
        if units.len() != self.names.len() {
            return false;
        }
        let mut slots = self.slots.clone();
        for (slot, unit) in slots.iter_mut().zip(&units) {
            match slot {
                Some((Meaning::Intensity, _)) | None => {}
                Some((_, factor)) => match unit_factor(unit) {
                    Some(of_unit) => *factor = of_unit,
                    None => return false,
                },
            }
        }
        self.slots = slots;
        true
    }

    /// The names of the columns that are not read.
    pub(super) fn left_out(&self) -> Option<String> {
        let columns = self.names.iter().zip(&self.slots);
        let names = columns.filter(|(name, slot)| slot.is_none() && !name.is_empty());
        let names: Vec<&str> = names.map(|(name, _)| name.as_str()).collect();
        (!names.is_empty()).then(|| format!("the columns {} are left out", names.join(", ")))
    }

    /// The numbers of a line by their meaning; absent columns and empty cells are NaN. The error holds the text found and the text
    /// expected.
    fn row(
        &self,
        text: &str,
        separator: Separator,
        numerals: &mut Numerals,
    ) -> std::result::Result<[f64; VALUES], (String, String)> {
        let mut row = [f64::NAN; VALUES];
        let count = separator.split(text, |at, cell| {
            let Some(Some((meaning, factor))) = self.slots.get(at) else {
                return Ok::<(), (String, String)>(());
            };
            let number = numerals.number(cell);
            let number = match meaning {
                Meaning::Time => number.or_else(|| unix_from_iso(cell.trim_matches('"'))),
                _ => number,
            };
            let value = number.filter(|value| !value.is_infinite()).ok_or_else(|| {
                let shown: String = cell.chars().take(40).collect();
                let found = format!("`{shown}` in column {}", self.names[at]);
                (found, numerals.wanted(cell).to_owned())
            })?;
            row[*meaning as usize] = factor * value;
            Ok(())
        })?;
        // The last tabs of a line are lost with the white space around it.
        let may_end = separator == Separator::Tab && (3..self.names.len()).contains(&count);
        if count == self.names.len() || may_end {
            return Ok(row);
        }
        let mut expected = format!(
            "{} as in the header ({})",
            self.names.len(),
            self.names.join(", ")
        );
        if separator == Separator::Comma && count >= 2 * self.names.len() - 1 {
            expected += ", with decimal points, not commas";
        }
        Err((format!("{count} values"), expected))
    }

    /// The numbers of a line, with the header's separator or, if it does not fit, with that of the line; without what
    /// follows the values, a comment or a separator.
    pub(super) fn any_row(
        &mut self,
        text: &str,
        numerals: &mut Numerals,
    ) -> std::result::Result<[f64; VALUES], (String, String)> {
        let mut tried = *numerals;
        let first_error = match self.row(text, self.separator, &mut tried) {
            Ok(row) => {
                *numerals = tried;
                return Ok(row);
            }
            Err(error) => error,
        };
        let values = without_trailer(text);
        let of_row = Separator::of(values);
        for (text, separator) in [
            (values, self.separator),
            (text, of_row),
            (values, of_row),
            // Tabs may also be aligned.
            (values, Separator::Space),
        ] {
            let mut tried = *numerals;
            if let Ok(row) = self.row(text, separator, &mut tried) {
                (*numerals, self.separator) = (tried, separator);
                return Ok(row);
            }
        }
        Err(first_error)
    }
}

/// The headers that a line may be: between tabs, names may contain blanks.
pub(super) fn headers(lines: &Lines, title: &str) -> Vec<Result<Header>> {
    let is_tabbed = title.contains('\t') && !title.contains("\t\t");
    let tab = is_tabbed.then_some(Separator::Tab);
    let usual = Some(Separator::of(title)).filter(|usual| Some(*usual) != tab);
    let both = [tab, usual].into_iter().flatten();
    let both = both.map(|separator| (separator, separator.names(title)));
    both.filter(|(_, names)| has_places(names))
        .map(|(separator, names)| Header::of(lines, names, separator))
        .collect()
}

/// The header of these that has as many columns as the first row.
pub(super) fn fitting(headers: Vec<Result<Header>>, row: &str) -> Result<Option<Header>> {
    let cells = row.matches('\t').count() + 1;
    let fits = |header: &Header| {
        header.separator != Separator::Tab || (3..=header.names.len()).contains(&cells)
    };
    let is_fitting = |header: &Result<Header>| header.as_ref().is_ok_and(fits);
    let last = headers.len().saturating_sub(1);
    let at = headers.iter().position(is_fitting).unwrap_or(last);
    headers.into_iter().nth(at).transpose()
}
