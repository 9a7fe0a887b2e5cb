//! The results of a run, to be compared with those of another.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

/// `document` without what differs from run to run: times and memory.
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

/// Results whose bytes depend on nothing but the input.
pub const EXACT: [&str; 6] = [
    "calibration.toml",
    "mounting.csv",
    "trajectory.csv",
    "cloud-left.laz",
    "cloud-right.laz",
    "project.toml",
];

/// The results in `out` by name, without times; panics where a file is missing or not whole.
pub fn results(out: &Path) -> BTreeMap<&'static str, Vec<u8>> {
    let mut found = BTreeMap::new();
    for name in EXACT {
        found.insert(name, fs::read(out.join(name)).unwrap());
    }
    let document: Value =
        serde_json::from_slice(&fs::read(out.join("result.json")).unwrap()).unwrap();
    found.insert("result.json", timeless(document).to_string().into_bytes());
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.trim_end().ends_with("</html>"), "half a report");
    found
}
