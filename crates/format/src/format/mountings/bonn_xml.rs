//! Mountings in the Bonn group's format: XML `<SystemCalibration>` with `x y z` (m) and `rx ry rz`
//! (degrees, convention `bonn`).

use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::lines::Lines;
use crate::geometry::euler::{euler_deg_from_rotation, rotation_from_euler_deg};
use crate::geometry::{BodyFromScanner, EulerConvention, Vec3};
use crate::output::write_whole;

const KEYS: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];
const ROOT: &str = "SystemCalibration";

pub(crate) const MOUNTING: Kind = Kind {
    signature: Some(|start| start.contains(b"<SystemCalibration")),
    frame: Frame::Fixed(
        "metres, and degrees in the convention `bonn` (the format); scanner in the body frame",
    ),
    ..Kind::new("bonn-mounting", "mounting (Bonn XML)")
};

/// Reads body_from_scanner; the values may be elements or attributes.
///
/// # Errors
/// No `<SystemCalibration>`, or one of its six values is missing or not a finite number.
pub fn read_mounting(input: impl Into<Input>) -> Result<BodyFromScanner> {
    let input = &input.into();
    let mut lines = Lines::open(input)?;
    let mut text = String::new();
    while lines.advance()? {
        text += lines.text();
        text.push('\n');
    }
    let error = |found: String, expected: &str| {
        Error::format(input.path(), Location::Whole, found, expected.to_owned())
    };
    let body = text
        .split_once(&format!("<{ROOT}"))
        .and_then(|(_, rest)| {
            rest.split_once(&format!("</{ROOT}>"))
                .or(rest.split_once("/>"))
        })
        .map(|(body, _)| body)
        .ok_or_else(|| error(format!("no <{ROOT}>"), "a mounting of the Bonn group"))?;
    let mut values = [0.0; 6];
    for (value, key) in values.iter_mut().zip(KEYS) {
        let cell = body
            .split_once(&format!("<{key}>"))
            .and_then(|(_, rest)| rest.split_once('<'))
            .or_else(|| {
                body.split_ascii_whitespace()
                    .find_map(|word| word.strip_prefix(key)?.strip_prefix("=\""))
                    .and_then(|rest| rest.split_once('"'))
            })
            .map(|(cell, _)| cell.trim())
            .ok_or_else(|| error(format!("no {key}"), "x, y, z (m), rx, ry, rz (degrees)"))?;
        *value = cell
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| error(format!("{key} = `{cell}`"), "a finite number"))?;
    }
    let [x, y, z, rx, ry, rz] = values;
    Ok(BodyFromScanner::new(
        rotation_from_euler_deg(EulerConvention::Bonn, [rx, ry, rz]),
        Vec3::new(x, y, z),
    ))
}

/// Writes body_from_scanner; the file is never incomplete.
///
/// # Errors
/// The file cannot be written.
pub fn write_mounting(path: &Path, body_from_scanner: &BodyFromScanner) -> Result<()> {
    let t = body_from_scanner.translation_m;
    let angles = euler_deg_from_rotation(EulerConvention::Bonn, &body_from_scanner.rotation);
    let mut text = format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<{ROOT}>\n");
    for (key, value) in KEYS.iter().zip(t.iter().chain(&angles)) {
        text += &format!("  <{key}>{value}</{key}>\n");
    }
    text += &format!("</{ROOT}>\n");
    write_whole(path, text.as_bytes())
}
