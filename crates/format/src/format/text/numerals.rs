//! Numbers as other programs write them: with decimal commas, grouped digits, quotes, or marks for a missing value.

use std::borrow::Cow;

/// Marks of a missing number other than `nan`, in lower case: those of the C libraries of Windows, and of tables.
const MISSING: [&str; 14] = [
    "-nan(ind)",
    "nan(ind)",
    "-nan(snan)",
    "nan(snan)",
    "-nan(qnan)",
    "1.#qnan",
    "-1.#qnan",
    "1.#ind",
    "-1.#ind",
    "null",
    "none",
    "na",
    "n/a",
    "#n/a",
];

/// How the commas in the numbers of a file have been read so far: a comma is either its decimal mark or groups its
/// digits.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Numerals {
    pub(crate) has_decimal_commas: bool,
    has_grouping_commas: bool,
}

impl Numerals {
    /// The number in a cell; NaN for an empty cell and for a mark of a missing value. `None` for other text, and where
    /// a comma would be a decimal mark in one cell of the file and a grouping mark in another one.
    #[inline]
    pub(crate) fn number(&mut self, cell: &str) -> Option<f64> {
        match cell.parse() {
            Ok(value) => Some(value),
            Err(_) => self.unusual(cell),
        }
    }

    fn unusual(&mut self, cell: &str) -> Option<f64> {
        let cell = cell.trim_matches('"').trim();
        if cell.is_empty() || MISSING.contains(&cell.to_ascii_lowercase().as_str()) {
            return Some(f64::NAN);
        }
        let text = without_groups(cell)?;
        let commas = text.matches(',').count();
        let points = text.matches('.').count();
        let (whole, fraction) = match (commas, points) {
            (0, 0 | 1) => return text.parse().ok(),
            // Decimal mark and grouping mark are told apart by their order.
            (_, 1) if text.find(',') < text.find('.') => {
                self.has_grouping_commas = true;
                text.split_once('.')?
            }
            (1, _) => {
                self.has_decimal_commas = true;
                text.split_once(',')?
            }
            (_, 0) => {
                self.has_grouping_commas = true;
                (&*text, "")
            }
            _ => return None,
        };
        if self.has_decimal_commas && self.has_grouping_commas {
            return None;
        }
        let mark = if self.has_decimal_commas { '.' } else { ',' };
        let digits = ungrouped(whole, mark)?;
        let is_fraction = !fraction.starts_with(['+', '-']);
        let number = format!("{digits}.{fraction}").parse().ok();
        number.filter(|_| is_fraction)
    }
}

/// A number without the apostrophes and fixed spaces that group its digits.
fn without_groups(cell: &str) -> Option<Cow<'_, str>> {
    const MARKS: [char; 4] = ['\'', '\u{2019}', '\u{a0}', '\u{202f}'];
    match MARKS.into_iter().find(|mark| cell.contains(*mark)) {
        None => Some(cell.into()),
        Some(mark) => {
            let at = cell.find(['.', ',']).unwrap_or(cell.len());
            let (whole, rest) = cell.split_at(at);
            Some((ungrouped(whole, mark)? + rest).into())
        }
    }
}

/// Digits without the `mark` between groups of three; `None` if the groups have other lengths.
fn ungrouped(whole: &str, mark: char) -> Option<String> {
    let mut groups = whole.split(mark);
    let first = groups.next()?;
    let digits = first.trim_start_matches(['+', '-']);
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let mut has_groups = false;
    let are_groups = groups.all(|group| {
        has_groups = true;
        group.len() == 3 && is_number(group)
    });
    let fits = is_number(digits) && are_groups && (!has_groups || digits.len() <= 3);
    fits.then(|| whole.replace(mark, ""))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(cell: &str) -> Option<f64> {
        Numerals::default().number(cell)
    }

    #[test]
    fn numbers_of_other_languages_are_read() {
        for (cell, expected) in [
            ("1.5", 1.5),
            ("1,5", 1.5),
            ("-364500,1234", -364_500.123_4),
            ("\"2,5\"", 2.5),
            ("5,621,000.25", 5_621_000.25),
            ("5.621.000,25", 5_621_000.25),
            ("5,621,000", 5_621_000.0),
            ("5'621'000.5", 5_621_000.5),
            ("1\u{a0}234,5", 1234.5),
            ("1,5e3", 1500.0),
            ("+7", 7.0),
        ] {
            assert_eq!(read(cell), Some(expected), "{cell}");
        }
        for cell in ["", "\"\"", "nan", "-nan(ind)", "1.#QNAN", "NULL", "N/A"] {
            assert!(read(cell).is_some_and(f64::is_nan), "{cell}");
        }
        for cell in ["a", "1,2,3", "12,34.5", "1.2.3", "1,-5", "5'62", "1;2", ","] {
            assert_eq!(read(cell), None, "{cell}");
        }
    }

    #[test]
    fn a_comma_has_one_meaning_in_a_file() {
        let mut numerals = Numerals::default();
        assert_eq!(numerals.number("364,500"), Some(364.5));
        assert_eq!(numerals.number("5,621,000"), None);
    }
}
