//! The text of a project file, and the lines of its keys.

use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use crate::error::{Error, Location, Result};

/// A project file, or a part of one.
pub struct Source {
    /// Absolute path.
    pub path: PathBuf,
    text: String,
}

/// The keys that a table needs.
#[derive(Debug, Clone, Copy)]
pub struct Required {
    /// Its name.
    pub name: &'static str,
    /// One key of each list must be there.
    pub keys: &'static [&'static [&'static str]],
}

/// A table that lacks keys.
struct Lacking {
    /// Where it begins in the text.
    start: usize,
    at: Location,
    /// Number of missing keys.
    keys: usize,
    /// Which, in words.
    text: String,
}

/// One step from a table to one of its values.
#[derive(Debug, Clone, Copy)]
pub enum Step<'a> {
    /// The key of a table.
    Key(&'a str),
    /// The index of an array element, from 0.
    Index(usize),
}

impl Source {
    /// Reads the text of the file.
    pub fn read(path: &Path) -> Result<Self> {
        if path.is_dir() {
            let expected = "a project file, such as `project.toml` in it";
            return Err(Error::format(path, Location::Whole, "a folder", expected));
        }
        // Opening a pipe would wait for a writer.
        if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
            return Err(Error::format(
                path,
                Location::Whole,
                "a pipe or a device",
                "a file",
            ));
        }
        let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let valid_bytes = error.utf8_error().valid_up_to();
            Error::format(
                path,
                Location::Byte(valid_bytes as u64),
                "bytes that are not UTF-8",
                "UTF-8 text",
            )
        })?;
        Self::of(text, path)
    }

    /// A source with this text, as if it were in the file at `path`.
    pub fn of(text: String, path: &Path) -> Result<Self> {
        let path = std::path::absolute(path).map_err(|source| Error::io(path, source))?;
        Ok(Self { path, text })
    }

    /// The text.
    pub fn into_text(self) -> String {
        self.text
    }

    /// Parses the text.
    pub fn parsed<T: serde::de::DeserializeOwned>(&self) -> Result<T> {
        toml::from_str(&self.text).map_err(|error| self.explain(&error))
    }

    /// As [`Self::parsed`]; if keys that tables need are missing, the error names all of them.
    pub fn parsed_with<T: serde::de::DeserializeOwned>(&self, required: &[Required]) -> Result<T> {
        toml::from_str(&self.text).map_err(|error: toml::de::Error| {
            let is_missing = error.message().starts_with("missing field");
            let all = is_missing.then(|| self.refuse_missing(required).err());
            all.flatten().unwrap_or_else(|| self.explain(&error))
        })
    }

    /// Refuses tables that lack more than one of the keys that they need, all together.
    pub fn refuse_missing(&self, required: &[Required]) -> Result<()> {
        let missing = self.missing(required);
        let (first, found) = match missing.as_slice() {
            [first, _, ..] => (first, "tables without keys that they need"),
            [only] if only.keys > 1 => (only, "a table without keys that it needs"),
            _ => return Ok(()),
        };
        let tables: Vec<&str> = missing.iter().map(|table| &*table.text).collect();
        let found = format!("{found}: {}", tables.join("; "));
        Err(Error::format(&self.path, first.at, found, "these keys"))
    }

    /// The tables that lack keys, in the order of the file.
    fn missing(&self, required: &[Required]) -> Vec<Lacking> {
        let Ok(root) = DeTable::parse(&self.text) else {
            return Vec::new();
        };
        let mut lacking = Vec::new();
        for (name, value) in root.get_ref().iter() {
            let name = name.get_ref();
            let Some(required) = required.iter().find(|table| table.name == name) else {
                continue;
            };
            let elements = value.get_ref().as_array();
            let elements = elements.map_or(vec![value], |elements| elements.iter().collect());
            for element in elements {
                let Some(table) = element.get_ref().as_table() else {
                    continue;
                };
                let has = |key: &str| table.iter().any(|(known, _)| known.get_ref() == key);
                let lacks = |one_of: &&&[&str]| !one_of.iter().any(|key| has(key));
                let keys: Vec<String> = required
                    .keys
                    .iter()
                    .filter(lacks)
                    .map(|one_of| format!("`{}`", one_of.join("` or `")))
                    .collect();
                if !keys.is_empty() {
                    let start = element.span().start;
                    let at = self.line(start);
                    let place = at.to_string();
                    let place = place.trim_start_matches(", ");
                    lacking.push(Lacking {
                        start,
                        at,
                        keys: keys.len(),
                        text: format!("[{name}] ({place}) without {}", keys.join(", ")),
                    });
                }
            }
        }
        lacking.sort_by_key(|table| table.start);
        lacking
    }

    /// Whether the file begins with this text.
    pub fn begins_with(&self, text: &str) -> bool {
        self.text.starts_with(text)
    }

    /// The absolute path of `file`, which is relative to the folder of the project file.
    pub fn absolute(&self, file: &Path) -> PathBuf {
        match self.path.parent() {
            Some(folder) => folder.join(file),
            None => file.to_owned(),
        }
    }

    /// An error at the key reached by `steps`, or at the nearest enclosing table that exists.
    pub fn error(&self, steps: &[Step<'_>], found: impl Into<String>, expected: &str) -> Error {
        Error::format(&self.path, self.locate(steps), found, expected)
    }

    /// The line of the key reached by `steps`, or of the last step that exists.
    pub fn locate(&self, steps: &[Step<'_>]) -> Location {
        let Ok(root) = DeTable::parse(&self.text) else {
            return Location::Whole;
        };
        let mut table = Some(root.get_ref());
        let mut value: Option<&DeValue<'_>> = None;
        let mut at = Location::Whole;
        for step in steps {
            let next = match *step {
                Step::Key(name) => {
                    // `[[prism]]` with one table is equivalent to `[prism]`.
                    let is_single =
                        |value: &DeValue<'_>| value.as_array().is_some_and(|all| all.len() == 1);
                    let inside = match value {
                        Some(value) if is_single(value) => {
                            value.get(0).map(|element| element.get_ref())
                        }
                        other => other,
                    };
                    let current = table.or_else(|| inside.and_then(DeValue::as_table));
                    let entry = current
                        .and_then(|table| table.iter().find(|(key, _)| key.get_ref() == name));
                    entry.map(|(key, value)| (key.span().start, value.get_ref()))
                }
                Step::Index(index) => value
                    .and_then(|value| value.get(index))
                    .map(|element| (element.span().start, element.get_ref())),
            };
            let Some((start, next_value)) = next else {
                break;
            };
            at = self.line(start);
            (table, value) = (None, Some(next_value));
        }
        at
    }

    fn line(&self, byte: usize) -> Location {
        let before = &self.text.as_bytes()[..byte.min(self.text.len())];
        Location::Line(1 + before.iter().filter(|&&b| b == b'\n').count() as u64)
    }

    /// Translates an error of the TOML reader.
    fn explain(&self, error: &toml::de::Error) -> Error {
        let at = error
            .span()
            .map_or(Location::Whole, |span| self.line(span.start));
        let message = error.message().trim();
        let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        let (found, expected) = if message.starts_with("unknown field") {
            unknown_name("the unknown key", &names)
        } else if message.starts_with("unknown variant") {
            unknown_name("the unknown value", &names)
        } else if message.starts_with("missing field") && !names.is_empty() {
            (
                format!("a table without `{}`", names[0]),
                format!("the key `{}`", names[0]),
            )
        } else if let Some((found, expected)) = message
            .strip_prefix("invalid type: ")
            .or_else(|| message.strip_prefix("invalid value: "))
            .or_else(|| message.strip_prefix("invalid length "))
            .and_then(|rest| rest.split_once(", expected "))
        {
            (found.to_owned(), type_in_words(expected))
        } else {
            let message = message.replace('\n', "; ");
            (format!("invalid TOML ({message})"), "valid TOML".to_owned())
        };
        Error::format(&self.path, at, found, expected)
    }
}

/// A user-friendly name of a Rust type.
fn type_in_words(expected: &str) -> String {
    match expected {
        "f64" => "a number",
        "usize" => "a whole number, 0 or more",
        "path string" => "a file name in quotes",
        "an array of length 3" | "tuple of size 3" => "a list of 3 numbers",
        "an array of length 4" | "tuple of size 4" => "a list of 4 numbers",
        other => other,
    }
    .to_owned()
}

/// The texts "found" and "expected" for the unknown name `names[0]`; the rest are the known names, and the nearest
/// comes first.
fn unknown_name(kind: &str, names: &[&str]) -> (String, String) {
    let (unknown, known) = names.split_first().unwrap_or((&"", &[]));
    let found = format!("{kind} `{unknown}`");
    let expected = match nearest(unknown, known) {
        None => "no key here".to_owned(),
        Some(best) if known.len() == 1 => format!("`{best}`"),
        Some(best) => {
            let others: Vec<&str> = known.iter().copied().filter(|name| *name != best).collect();
            format!("`{best}` (or one of: {})", others.join(", "))
        }
    };
    (found, expected)
}

/// The known name closest to `unknown`, ignoring case.
pub(super) fn nearest<'a>(unknown: &str, known: &[&'a str]) -> Option<&'a str> {
    let unknown = unknown.to_lowercase();
    // Edit distance finds swapped and missing letters, the common prefix finds truncated names.
    let similarity = |name: &str| {
        let name = name.to_lowercase();
        strsim::normalized_damerau_levenshtein(&unknown, &name)
            + strsim::jaro_winkler(&unknown, &name)
    };
    known
        .iter()
        .copied()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
}
