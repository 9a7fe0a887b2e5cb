//! What files of a format are for.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use crate::format::Format;

/// Rows and bytes of a table that are looked at to tell a log from a cloud.
const ROWS: usize = 1000;
const BYTES: u64 = 1 << 20;

/// Whether a table that was taken for a cloud looks like a log: it has a header, and the first column, which is not a
/// coordinate, increases from row to row. Scanners measure many points at a time, or list their coordinates first.
pub fn is_log(path: &Path) -> bool {
    let Ok(file) = File::open(path) else {
        return false;
    };
    let mut lines = BufReader::new(file.take(BYTES))
        .lines()
        .map_while(std::io::Result::ok);
    let is_separator = |c: char| c == ',' || c == ';' || c.is_whitespace();
    let Some(header) = lines.next() else {
        return false;
    };
    let name = header
        .trim_start_matches(['\u{feff}', '#', '/', ' ', '"'])
        .to_lowercase();
    let name = name
        .split(is_separator)
        .next()
        .unwrap_or_default()
        .trim_matches('"');
    let is_coordinate = ["x", "e", "r", "y", "n", "h"]
        .iter()
        .any(|start| name.starts_with(start));
    if name.is_empty() || is_coordinate || name.parse::<f64>().is_ok() {
        return false;
    }
    let times = lines.take(ROWS).map_while(|line| {
        let cell = line
            .split(is_separator)
            .next()?
            .trim_matches('"')
            .to_owned();
        cell.parse::<f64>().ok()
    });
    let times: Vec<f64> = times.collect();
    times.len() > 2 && times.windows(2).all(|pair| pair[0] < pair[1])
}

/// The purpose of files of a format.
pub enum Role {
    Cloud,
    Profiles,
    Poses,
    Positions,
    /// A log that may hold several kinds of measurements.
    Log,
    None,
}

impl Role {
    /// The purpose of a format.
    pub fn of(format: Format) -> Self {
        match format {
            _ if format.has_imu() || format.has_heading() || format.has_geographic() => Self::Log,
            _ if format.has_geographic_poses() => Self::Log,
            _ if format.has_positions() => Self::Positions,
            _ if format.has_cloud() => Self::Cloud,
            _ if format.has_profiles() => Self::Profiles,
            _ if format.has_poses() => Self::Poses,
            _ => Self::None,
        }
    }
}
