//! Patterns of paths in which `{plot}` and `{date}` stand for names of plots and for dates.

use crate::format::day_number;

/// The plot and the date that a path names.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Place {
    /// Letters, digits, `-`, `_` and `.`; `None` if the pattern has no `{plot}`.
    pub plot: Option<String>,
    /// As YYYY-MM-DD; `None` if the pattern has no `{date}`.
    pub date: Option<String>,
}

impl Place {
    /// Whether this place includes a plot and a date; a part that is `None` includes all.
    pub fn is_of(&self, plot: &str, date: &str) -> bool {
        let includes =
            |part: &Option<String>, name: &str| part.as_deref().is_none_or(|part| part == name);
        includes(&self.plot, plot) && includes(&self.date, date)
    }
}

/// A part of a pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Text(String),
    Plot,
    Date,
    /// `*`: any characters of one name.
    Any,
}

/// A pattern of paths with `/` between folders: `{plot}`, `{date}` (YYYY-MM-DD, YYYY_MM_DD, YYYYMMDD or YYMMDD), and
/// `*` for any part of a name. A plot or date that occurs twice must be the same both times.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    parts: Vec<Part>,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// The error in the pattern, and what was expected.
    pub fn new(text: &str) -> Result<Self, (String, &'static str)> {
        let mut parts = Vec::new();
        let mut rest = text.trim_start_matches("./").trim_end_matches('/');
        if rest.is_empty() {
            return Err((
                "an empty pattern".into(),
                "a path, such as \"{date}/{plot}/project.toml\"",
            ));
        }
        while !rest.is_empty() {
            let special = rest.find(['{', '*']).unwrap_or(rest.len());
            if special > 0 {
                parts.push(Part::Text(rest[..special].to_owned()));
                rest = &rest[special..];
                continue;
            }
            let (part, length) = match rest {
                _ if rest.starts_with("{plot}") => (Part::Plot, 6),
                _ if rest.starts_with("{date}") => (Part::Date, 6),
                _ if rest.starts_with('*') => (Part::Any, 1),
                _ => {
                    return Err((
                        format!("`{text}`"),
                        "`{plot}`, `{date}`, `*` and plain text",
                    ));
                }
            };
            parts.push(part);
            rest = &rest[length..];
        }
        Ok(Self { parts })
    }

    /// The pattern as it was written.
    pub fn text(&self) -> String {
        let parts = self.parts.iter().map(|part| match part {
            Part::Text(text) => text.as_str(),
            Part::Plot => "{plot}",
            Part::Date => "{date}",
            Part::Any => "*",
        });
        parts.collect()
    }

    /// Whether it has a `{date}`.
    pub fn has_date(&self) -> bool {
        self.parts.contains(&Part::Date)
    }

    /// Whether it can match more than one path.
    pub fn is_open(&self) -> bool {
        self.parts.iter().any(|part| !matches!(part, Part::Text(_)))
    }

    /// The plot and date of a path; `None` if it does not match.
    pub fn place_of(&self, path: &str) -> Option<Place> {
        matched(&self.parts, path, Place::default())
    }

    /// The number of names in a path, folders included.
    pub fn depth(&self) -> usize {
        let slashes = |part: &Part| match part {
            Part::Text(text) => text.matches('/').count(),
            _ => 0,
        };
        1 + self.parts.iter().map(slashes).sum::<usize>()
    }
}

/// Matches parts one by one, the longest names first.
fn matched(parts: &[Part], path: &str, place: Place) -> Option<Place> {
    let Some((first, rest)) = parts.split_first() else {
        return path.is_empty().then_some(place);
    };
    match first {
        Part::Text(text) => matched(rest, path.strip_prefix(text.as_str())?, place),
        Part::Any => {
            let end = path.find('/').unwrap_or(path.len());
            let mut ends = (0..=end).rev().filter(|end| path.is_char_boundary(*end));
            ends.find_map(|end| matched(rest, &path[end..], place.clone()))
        }
        Part::Date => [10, 8, 6].into_iter().find_map(|length| {
            let date = iso_date(path.get(..length)?)?;
            let is_other = place.date.as_ref().is_some_and(|other| *other != date);
            let place = Place {
                date: Some(date),
                ..place.clone()
            };
            (!is_other).then(|| matched(rest, &path[length..], place))?
        }),
        Part::Plot => {
            let is_name = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
            let end = path.find(|c| !is_name(c)).unwrap_or(path.len());
            (1..=end).rev().find_map(|end| {
                let plot = path[..end].to_owned();
                let is_other = place.plot.as_ref().is_some_and(|other| *other != plot);
                let place = Place {
                    plot: Some(plot),
                    ..place.clone()
                };
                (!is_other).then(|| matched(rest, &path[end..], place))?
            })
        }
    }
}

/// A date as YYYY-MM-DD.
fn iso_date(text: &str) -> Option<String> {
    let bytes = text.as_bytes();
    let digits: String = match bytes.len() {
        10 if bytes[4] == bytes[7] && b"-_".contains(&bytes[4]) => {
            [&text[..4], &text[5..7], &text[8..]].concat()
        }
        8 => text.to_owned(),
        6 => format!("20{text}"),
        _ => return None,
    };
    let date = [digits.get(..4)?, digits.get(4..6)?, digits.get(6..)?].join("-");
    day_number(&date).map(|_| date)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(pattern: &str, path: &str) -> Option<(String, String)> {
        let place = Pattern::new(pattern).unwrap().place_of(path)?;
        Some((
            place.plot.unwrap_or_default(),
            place.date.unwrap_or_default(),
        ))
    }

    #[test]
    fn plots_and_dates_are_found_in_paths() {
        let names = |plot: &str, date: &str| Some((plot.to_owned(), date.to_owned()));
        let cases = [
            (
                "{plot}/{date}",
                "Plot01/230516",
                names("Plot01", "2023-05-16"),
            ),
            (
                "{date}/{plot}/project.toml",
                "2025-05-01/b-3/project.toml",
                names("b-3", "2025-05-01"),
            ),
            (
                "{date}/{plot}/project.toml",
                "2025-05-01/b-3/other.toml",
                None,
            ),
            (
                "a/{date}_{plot}_*.bin",
                "a/20250501_p_7_l.bin",
                names("p_7", "2025-05-01"),
            ),
            (
                "{plot}/{date}/{plot}.laz",
                "p/2025_05_01/p.laz",
                names("p", "2025-05-01"),
            ),
            ("{plot}/{date}/{plot}.laz", "p/2025_05_01/q.laz", None),
            ("{date}/{plot}", "2025-02-29/p", None),
            ("{date}/{plot}", "2025-05-01/p/q", None),
            ("tls.laz", "tls.laz", names("", "")),
        ];
        for (pattern, path, expected) in cases {
            assert_eq!(place(pattern, path), expected, "{pattern} {path}");
        }
    }

    #[test]
    fn a_mistyped_placeholder_is_named() {
        let (found, expected) = Pattern::new("{day}/{plot}").unwrap_err();
        assert!(found.contains("{day}") && expected.contains("{date}"));
        assert!(Pattern::new("").is_err());
        assert_eq!(Pattern::new("a/{date}/{plot}").unwrap().depth(), 3);
    }

    #[test]
    fn a_pattern_without_a_plot_includes_all_plots() {
        let place = Pattern::new("{date}.toml")
            .unwrap()
            .place_of("20250501.toml")
            .unwrap();
        assert!(place.is_of("any", "2025-05-01") && !place.is_of("any", "2025-05-02"));
    }
}
