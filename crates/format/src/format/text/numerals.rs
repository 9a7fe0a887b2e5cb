//! Numbers as other programs write them: with decimal commas, grouped digits, quotes, or marks for a missing value.

use std::borrow::Cow;

/// What is said of a file whose numbers have them.
pub(crate) const DECIMAL_COMMAS: &str = "commas are read as decimal marks";
/// Words in place of a missing number, in lower case: those of databases, of tables and their errors, and of C.
const MISSING: [&str; 16] = [
    "-nan(ind)",
    "nan(ind)",
    "-nan(snan)",
    "nan(snan)",
    "-nan(qnan)",
    "null",
    "none",
    "na",
    "n/a",
    "#n/a",
    "#nv",
    "#null!",
    "#num!",
    "#value!",
    "#div/0!",
    "nil",
];

/// Whether a cell is a mark of a missing value: a word, dashes or asterisks in place of digits, or what the C library of
/// Windows writes for a value that is no number, such as `-1.#IND` or `1.#QNAN0`.
fn is_missing(cell: &str) -> bool {
    let consists_of = |mark: char| cell.chars().all(|c| c == mark);
    let unsigned = cell.trim_start_matches(['+', '-']);
    cell.is_empty()
        || consists_of('-') && cell.len() <= 3
        || consists_of('*')
        || unsigned.starts_with("1.#")
        || MISSING.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// Whether the mark `#` at this byte belongs to the mark of a missing value rather than beginning a comment.
pub(crate) fn is_in_missing(line: &str, at: usize) -> bool {
    let (before, from) = line.split_at(at);
    let of_windows = before.strip_suffix("1.");
    let is_whole = |text: &str| !text.ends_with(|c: char| c.is_ascii_digit() || c == '.');
    let word = from.split([',', ';', '"', ' ', '\t']).next();
    of_windows.is_some_and(is_whole) && !from[1..].starts_with([' ', '\t'])
        || word.is_some_and(|word| is_missing(word.trim_ascii()))
}

/// How the commas and points in the numbers of a file have been read so far: each is either its decimal mark or groups
/// its digits.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Numerals {
    pub(crate) has_decimal_commas: bool,
    has_grouping_commas: bool,
    has_decimal_points: bool,
}

impl Numerals {
    /// The number in a cell; NaN for an empty cell and for a mark of a missing value. `None` for other text, and where
    /// a comma or a point would be a decimal mark in one cell of the file and a grouping mark in another one.
    #[inline]
    pub(crate) fn number(&mut self, cell: &str) -> Option<f64> {
        match cell.parse() {
            Ok(_) if self.has_decimal_commas && cell.contains('.') => self.unusual(cell),
            Ok(value) => {
                self.has_decimal_points = self.has_decimal_points || cell.contains('.');
                Some(value)
            }
            Err(_) => self.unusual(cell),
        }
    }

    /// What a cell that is no number should have been.
    pub(crate) fn wanted(&self, cell: &str) -> &'static str {
        if self.has_decimal_points && cell.contains(',')
            || self.has_decimal_commas && cell.contains('.')
        {
            "a number with the decimal mark of the numbers before it"
        } else {
            "a number"
        }
    }

    fn unusual(&mut self, cell: &str) -> Option<f64> {
        let cell = cell.trim_matches('"').trim();
        if is_missing(cell) {
            return Some(f64::NAN);
        }
        let text = without_groups(cell)?;
        let commas = text.matches(',').count();
        let points = text.matches('.').count();
        let (whole, fraction) = match (commas, points) {
            // Beside decimal commas, points group the digits.
            (0, 1) if self.has_decimal_commas => (&*text, ""),
            (0, 0 | 1) => {
                let value = text.parse().ok()?;
                self.has_decimal_points |= points == 1;
                return Some(value);
            }
            // Decimal mark and grouping mark are told apart by their order.
            (_, 1) if text.find(',') < text.find('.') => {
                (self.has_grouping_commas, self.has_decimal_points) = (true, true);
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
        if self.has_decimal_commas && (self.has_grouping_commas || self.has_decimal_points) {
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
        for cell in [
            "",
            "\"\"",
            "nan",
            "-nan(ind)",
            "1.#QNAN",
            "-1.#IND00",
            "1.#INF",
            "NULL",
            "N/A",
            "#N/A",
            "-",
            "*****",
        ] {
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

    #[test]
    fn points_beside_decimal_commas_group_digits() {
        let read = |cells: &[&str]| {
            let mut numerals = Numerals::default();
            cells
                .iter()
                .map(|cell| numerals.number(cell))
                .collect::<Vec<_>>()
        };
        let found = read(&["1.234,5", "2.345", "61,25", "10"]);
        assert_eq!(found, [1234.5, 2345.0, 61.25, 10.0].map(Some));
        // Whether the first one is 364.5 or 364500 is decided too late.
        assert_eq!(read(&["364.500", "61,25"]), [Some(364.5), None]);
        assert_eq!(read(&["61,25", "0.5"]), [Some(61.25), None]);
    }

    #[test]
    fn marks_of_missing_values_are_told_from_comments() {
        for line in ["4 5 1.#INF", "4 5 -1.#IND 7", "4,5,#N/A,7", "4;5;#NV"] {
            assert!(is_in_missing(line, line.find('#').unwrap()), "{line}");
        }
        for line in [
            "4 5 6 # stop",
            "4 5 61.#2",
            "4 5 6 #NAME of it",
            "4 5 1. # good",
        ] {
            assert!(!is_in_missing(line, line.find('#').unwrap()), "{line}");
        }
    }
}
