//! Names and values with units as lines of text.

use std::path::{Path, PathBuf};

use crate::geometry::Vec3;

/// Lines of names and values under headings.
pub(super) struct Lines {
    pub(super) text: String,
    /// Files in it are named relative to it.
    pub(super) folder: PathBuf,
}

impl Lines {
    pub(super) fn section(&mut self, name: &str) {
        self.text.push_str(&format!("\n{name}\n"));
    }

    pub(super) fn value(&mut self, name: &str, value: impl std::fmt::Display) {
        self.text.push_str(&format!("  {name:<24}{value}\n"));
    }

    pub(super) fn file(&mut self, name: &str, path: &Path) {
        let path = path
            .strip_prefix(&self.folder)
            .unwrap_or(path)
            .display()
            .to_string();
        self.value(name, path);
    }

    pub(super) fn log(&mut self, path: &Path, time_offset_s: f64) {
        self.file("file", path);
        self.offset(time_offset_s);
    }

    pub(super) fn offset(&mut self, seconds: f64) {
        if seconds != 0.0 {
            self.value("time offset", format!("{} s (added)", short(seconds)));
        }
    }
}

pub(super) fn millimetres(metres: f64) -> String {
    format!("{} mm", short(metres * 1e3))
}

pub(super) fn degrees(angle_rad: f64) -> String {
    format!("{}°", short(angle_rad.to_degrees()))
}

pub(super) fn vector(v: &Vec3) -> String {
    [v.x, v.y, v.z].map(short).join(", ")
}

/// To a millionth, without the zeros that add nothing.
pub(super) fn short(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0" } else { text }.to_owned()
}
