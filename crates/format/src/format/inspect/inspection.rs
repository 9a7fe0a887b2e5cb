//! The result of inspecting a file, and its text.

use std::fmt;
use std::path::PathBuf;

use crate::format::kind::Format;
use crate::format::text::civil::utc;

/// An interval between neighbouring times that is much longer than the others.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Gap {
    /// Last time before the gap, seconds.
    pub start_s: f64,
    /// Length, seconds.
    pub duration_s: f64,
}

/// The smallest and the largest value of a column; its name ends in the unit.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Bounds {
    /// Name with unit.
    pub column: String,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

/// A summary of the content of a file.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Inspection {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: Format,
    /// Units and frame of the content, and whether the file or its format states them or they are assumed.
    pub frame: String,
    /// Its size in bytes.
    pub bytes: u64,
    /// Rows, samples, poses or points.
    pub count: u64,
    /// Number of distinct times, if rows are in time order.
    pub epochs: Option<u64>,
    /// First and last time, seconds.
    pub span_s: Option<[f64; 2]>,
    /// One over the median interval between distinct times, hertz.
    pub rate_hz: Option<f64>,
    /// Robust standard deviation of these intervals, seconds.
    pub jitter_s: Option<f64>,
    /// The longest gaps of more than five median intervals, longest first; ten at most.
    pub gaps: Vec<Gap>,
    /// Range of each column.
    pub bounds: Vec<Bounds>,
    /// Names of the columns or fields in the file.
    pub columns: Vec<String>,
    /// Points from above, in lines of characters with eight dots each; not part of the JSON.
    #[serde(skip)]
    pub picture: Vec<String>,
    /// Further remarks for the user.
    pub notes: Vec<String>,
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.path.display())?;
        writeln!(f, "  format   {}", self.format)?;
        writeln!(f, "  frame    {}", self.frame)?;
        writeln!(f, "  size     {} bytes", self.bytes)?;
        // Nothing is counted where no part of the file was summarised; of points, none were found.
        if self.count > 0 || self.format.is_las() {
            writeln!(f, "  rows     {}", self.count)?;
        }
        if let Some(epochs) = self.epochs.filter(|n| *n != self.count) {
            writeln!(f, "  epochs   {epochs}")?;
        }
        if let Some([first, last]) = self.span_s {
            let length = last - first;
            writeln!(
                f,
                "  time     {first:.6} s to {last:.6} s, {length:.3} s long"
            )?;
            if let (Some(from), Some(to)) = (utc(first), utc(last)) {
                writeln!(
                    f,
                    "  UTC      {from} to {to}, if these are seconds since 1970"
                )?;
            }
        }
        if let Some(rate_hz) = self.rate_hz {
            let jitter_ms = 1e3 * self.jitter_s.unwrap_or(0.0);
            writeln!(
                f,
                "  rate     {rate_hz:.3} Hz (median), jitter {jitter_ms:.3} ms"
            )?;
        }
        for gap in &self.gaps {
            let Gap {
                start_s,
                duration_s,
            } = gap;
            writeln!(f, "  gap      {duration_s:.3} s after {start_s:.3} s")?;
        }
        for Bounds { column, min, max } in &self.bounds {
            let (name, unit) = split_unit(column);
            // Angles are shown in degrees.
            let (factor, unit) = match unit {
                "rad" => (1f64.to_degrees(), "°"),
                _ => (1.0, unit),
            };
            let (min, max) = (factor * min, factor * max);
            writeln!(f, "  {name:<22} {min:.6} to {max:.6} {unit}")?;
        }
        if !self.columns.is_empty() {
            writeln!(f, "  columns  {}", self.columns.join(", "))?;
        }
        for line in &self.picture {
            writeln!(f, "           {line}")?;
        }
        for note in &self.notes {
            writeln!(f, "  note     {note}")?;
        }
        Ok(())
    }
}

/// Name and unit of a column.
fn split_unit(column: &str) -> (&str, &str) {
    const UNITS: [(&str, &str); 7] = [
        ("_rad_s", "rad/s"),
        ("_m_s2", "m/s²"),
        ("_m_s", "m/s"),
        ("_rad", "rad"),
        ("_deg", "°"),
        ("_m", "m"),
        ("_s", "s"),
    ];
    for (ending, unit) in UNITS {
        if let Some(name) = column.strip_suffix(ending) {
            return (name, unit);
        }
    }
    (column, "")
}
