//! Point clouds.

mod binary;
mod commands;
mod las;
mod text;
mod times;

use std::path::PathBuf;

use boresight::cloud::PointCloud;
use boresight::format::{Input, inspect, read_cloud};
use boresight::geometry::Vec3;

use crate::common::{boresight, data};

/// The three points of most files.
const UTM: [[f64; 3]; 3] = [
    [364_500.123_4, 5_621_000.567_8, 61.25],
    [364_501.5, 5_621_001.25, 62.5],
    [364_502.75, 5_621_002.125, 63.75],
];
const INTENSITIES: [f32; 3] = [10.0, 20.0, 30.0];

/// A file of `tests/data/field_cases`.
fn case(name: &str) -> PathBuf {
    data("field_cases").join(name)
}

/// The cloud of a file, and what is said about it.
fn read(name: &str) -> (PointCloud, String) {
    let input = Input::from(&case(name));
    (read_cloud(&input).unwrap(), input.remarks().join("\n"))
}

/// Asserts the points of a file, whose coordinates are exact.
fn assert_points(name: &str, expected: &[[f64; 3]]) -> (PointCloud, String) {
    let (cloud, remarks) = read(name);
    let expected: Vec<Vec3> = expected.iter().map(|p| Vec3::from(*p)).collect();
    assert_eq!(cloud.points, expected, "{name}");
    (cloud, remarks)
}

/// The error of reading a file, which `inspect` gives, too.
fn error(name: &str) -> String {
    let error = read_cloud(&case(name)).unwrap_err();
    assert!(inspect(&case(name)).is_err(), "{name}");
    error.to_string()
}

/// Converts a file to text: the lines below the header, and what was said.
fn converted(name: &str) -> (String, Vec<String>, String) {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.csv");
    let run = boresight(&[
        "convert",
        case(name).to_str().unwrap(),
        output.to_str().unwrap(),
    ]);
    assert_eq!(run.code, 0, "{name}: {}", run.err);
    let text = std::fs::read_to_string(output).unwrap();
    let mut lines = text.lines().map(str::to_owned);
    (lines.next().unwrap(), lines.collect(), run.err)
}

/// Values as they compare: NaN as none.
fn some<T: Into<f64> + Copy>(values: &[T]) -> Vec<Option<T>> {
    let is_number = |value: &T| !(*value).into().is_nan();
    values.iter().map(|v| Some(*v).filter(is_number)).collect()
}
