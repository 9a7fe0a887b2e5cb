//! The results of a run, to be compared with those of another run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

/// `document` without the values that differ from run to run: times and memory.
pub fn timeless(mut document: Value) -> Value {
    match &mut document {
        Value::Object(entries) => {
            entries.retain(|key, _| key != "seconds" && key != "peak_memory_bytes");
            for value in entries.values_mut() {
                *value = timeless(value.take());
            }
        }
        Value::Array(values) => {
            for value in values {
                *value = timeless(value.take());
            }
        }
        _ => {}
    }
    document
}

/// A page without the lines that differ from run to run: its date, the times of stages and scales, and memory.
fn timeless_page(page: &str) -> String {
    let marks = [
        "class=\"provenance\"",
        "class=\"bar\"",
        "all stages",
        "Peak memory",
        "<th scope=\"row\">two steps",
    ];
    let is_timeless = |line: &&str| !marks.iter().any(|mark| line.contains(mark));
    page.lines()
        .filter(is_timeless)
        .collect::<Vec<_>>()
        .join("\n")
}

/// Results whose bytes depend only on the input.
pub const EXACT: [&str; 6] = [
    "calibration.toml",
    "mounting.csv",
    "trajectory.csv",
    "cloud-left.laz",
    "cloud-right.laz",
    "project.toml",
];

/// The results in `out` by name, without times; panics if a file is missing or incomplete.
pub fn results(out: &Path) -> BTreeMap<&'static str, Vec<u8>> {
    let mut results = BTreeMap::new();
    for name in EXACT {
        results.insert(name, fs::read(out.join(name)).unwrap());
    }
    let document: Value =
        serde_json::from_slice(&fs::read(out.join("result.json")).unwrap()).unwrap();
    results.insert("result.json", timeless(document).to_string().into_bytes());
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.trim_end().ends_with("</html>"), "incomplete report");
    results.insert("report.html", timeless_page(&report).into_bytes());
    results
}

/// Asserts that results are the same; names the first file, and in a text the first line, that differs.
pub fn assert_same(
    found: &BTreeMap<&'static str, Vec<u8>>,
    expected: &BTreeMap<&'static str, Vec<u8>>,
) {
    for (name, bytes) in expected {
        if found[name] == *bytes {
            continue;
        }
        let [found, expected] = [&found[name], bytes].map(|bytes| String::from_utf8_lossy(bytes));
        let mut lines = found.lines().zip(expected.lines());
        let line = lines.find(|(found, expected)| found != expected);
        panic!("{name} differs: {line:?}");
    }
}
