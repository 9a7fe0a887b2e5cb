//! The values of YAML files that describe data, such as `metadata.yaml` of rosbag2 and `sensor.yaml` of EuRoC.

use std::io::Read;

use yaml_rust2::parser::{Event, Parser};
use yaml_rust2::scanner::{Marker, ScanError};

use crate::error::{Error, Location, Result};
use crate::format::file::guarded;
use crate::format::input::Input;

/// Bytes of the largest file. Metadata have some hundred bytes for each file and topic.
const MOST_BYTES: u64 = 8 << 20;
/// Levels of the deepest value.
const DEEPEST: usize = 32;

/// A value of a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entry {
    /// The keys that lead to it, joined by dots; the items of a list have the keys of the list.
    pub(crate) keys: String,
    /// Its text.
    pub(crate) text: String,
    /// Its line, counted from 1.
    pub(crate) line: u64,
}

/// What is open around a value.
enum Level {
    /// A mapping, and the key whose value comes next.
    Mapping(Option<String>),
    List,
}

/// Reads all values in the order of the file. Aliases are left out, so that no file unpacks to more than it has.
///
/// # Errors
/// A file that cannot be read, is too large, or is not YAML.
pub(crate) fn values(input: &Input) -> Result<Vec<Entry>> {
    let (file, size) = input.open()?;
    let mut bytes = Vec::new();
    file.take(MOST_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(input.path(), e))?;
    if size > MOST_BYTES {
        let found = format!("{size} bytes of YAML");
        let expected = format!("at most {MOST_BYTES}");
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    }
    let text = String::from_utf8_lossy(&bytes);
    guarded(input.path(), "YAML", || {
        parse(&text).map_err(|(line, found)| {
            Error::format(input.path(), Location::Line(line), found, "YAML")
        })
    })
}

fn parse(text: &str) -> std::result::Result<Vec<Entry>, (u64, String)> {
    let mut parser = Parser::new_from_str(text);
    let mut levels: Vec<Level> = Vec::new();
    let mut entries = Vec::new();
    let line = |at: &Marker| at.line() as u64;
    loop {
        let next = parser.next_token();
        let (event, at) =
            next.map_err(|e: ScanError| (line(e.marker()), format!("{} in YAML", e.info())))?;
        let is_open = matches!(event, Event::SequenceStart(..) | Event::MappingStart(..));
        match event {
            Event::StreamEnd => return Ok(entries),
            Event::Scalar(text, ..) => {
                if let Some(Level::Mapping(key @ None)) = levels.last_mut() {
                    *key = Some(text);
                    continue;
                }
                entries.push(Entry {
                    keys: keys(&levels),
                    text,
                    line: line(&at),
                });
            }
            Event::SequenceStart(..) => levels.push(Level::List),
            Event::MappingStart(..) => levels.push(Level::Mapping(None)),
            Event::SequenceEnd | Event::MappingEnd => {
                levels.pop();
            }
            Event::Alias(_) => {}
            _ => continue,
        }
        if levels.len() > DEEPEST {
            return Err((line(&at), format!("more than {DEEPEST} levels")));
        }
        // A key or a value has ended: in a mapping, the next one is a key after a value.
        if !is_open && let Some(Level::Mapping(key)) = levels.last_mut() {
            *key = key.take().is_none().then(String::new);
        }
    }
}

/// The keys of the mappings around a value.
fn keys(levels: &[Level]) -> String {
    let keys = levels.iter().filter_map(|level| match level {
        Level::Mapping(key) => key.as_deref(),
        Level::List => None,
    });
    keys.collect::<Vec<_>>().join(".")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_keys_that_lead_to_them() {
        let text = "# a comment\n? [1, 2]\n: x\na: &one\n  b: 1e-3  # unit\n  c:\n  - p\n  - {d: q}\ne: *one\nf: r\n";
        let entries = parse(text).unwrap();
        let found: Vec<_> = entries
            .iter()
            .map(|entry| (entry.keys.as_str(), entry.text.as_str(), entry.line))
            .collect();
        assert_eq!(
            found[2..],
            [
                ("", "x", 3),
                ("a.b", "1e-3", 5),
                ("a.c", "p", 7),
                ("a.c.d", "q", 8),
                ("f", "r", 10),
            ]
        );
        let (line, found) = parse("a: 1\nb: [1, 2\n").unwrap_err();
        assert!(line >= 2 && found.contains("YAML"), "{line} {found}");
        assert!(parse(&"[".repeat(100)).is_err());
        assert!(parse(&"- ".repeat(100)).is_err());
    }
}
