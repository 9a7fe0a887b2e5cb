//! The blocks of a Gocator CSV export and the rows of profiles.

use crate::error::{Error, Result};
use crate::format::text::lines::{Lines, Separator};

/// The version of the file that the manual describes.
const VERSION: f64 = 2.0;
/// Largest accepted tilt of the profile plane: 17 µm in y at 1 m.
const MOST_TILT_DEG: f64 = 0.001;
/// More sensors than any system has.
const MOST_DEVICES: usize = 1000;
/// Beyond the range of any profile scanner, millimetres.
const FARTHEST_MM: f64 = 1e6;

/// The block of point cloud profiles.
pub(super) const RAW: &str = "RawProfile";

/// The values in a row of a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Axis {
    X,
    Z,
    Intensity,
}

/// A row of a profile; NaN marks a point that was not measured.
pub(super) struct Row {
    /// Frame, source and time stamp: the same for all rows of a profile.
    pub(super) key: [f64; 3],
    pub(super) axis: Axis,
    pub(super) values: Vec<f64>,
}

/// The columns of the rows of a block.
pub(super) struct Layout {
    /// Columns of frame, source, time and axis.
    indices: [usize; 4],
    names: Vec<String>,
    /// First column of the profile.
    first: usize,
    /// x of each column, millimetres; `None` for point cloud profiles, which have x in their rows.
    pub(super) x_mm: Option<Vec<f64>>,
    width: usize,
}

fn cells(line: &str) -> Vec<String> {
    let mut cells = Separator::Comma.names(line);
    while cells.last().is_some_and(String::is_empty) {
        cells.pop();
    }
    cells
}

/// Goes to the next line that is not empty.
pub(super) fn next_line(lines: &mut Lines, expected: &str) -> Result<()> {
    while lines.advance()? {
        if !lines.text().is_empty() {
            return Ok(());
        }
    }
    Err(lines.error("the end of the file", expected))
}

/// The next header and the rows below it, up to `End`.
fn table(lines: &mut Lines, block: &str) -> Result<(Vec<String>, Vec<Vec<String>>)> {
    next_line(lines, &format!("the header of {block}"))?;
    let header = cells(lines.text());
    let mut rows = Vec::new();
    loop {
        next_line(lines, &format!("`End` of {block}"))?;
        match lines.text() {
            "End" => return Ok((header, rows)),
            text if rows.len() < MOST_DEVICES => rows.push(cells(text)),
            _ => {
                return Err(
                    lines.error(format!("more than {MOST_DEVICES} rows of {block}"), "`End`")
                );
            }
        }
    }
}

/// Skips a block whose name has been read.
pub(super) fn skip(lines: &mut Lines, block: &str) -> Result<()> {
    while lines.advance()? {
        if lines.text() == "End" {
            return Ok(());
        }
    }
    Err(lines.error("the end of the file", format!("`End` of {block}")))
}

/// Checks that no other block of profiles follows.
pub(super) fn check_rest(lines: &mut Lines) -> Result<()> {
    while lines.advance()? {
        match lines.text().to_owned().as_str() {
            "" => {}
            block @ ("Profile" | RAW) => {
                let found = format!("a second block of profiles, {block}");
                return Err(lines.error(found, "one block of profiles per file"));
            }
            block => skip(lines, &block.chars().take(40).collect::<String>())?,
        }
    }
    Ok(())
}

/// The number in the column `name`, if there is one.
fn value(header: &[String], row: &[String], name: &str) -> Option<f64> {
    let at = header.iter().position(|other| other == name)?;
    row.get(at)?.parse().ok()
}

/// Checks the version and returns the rate of a sensor that triggers by time, hertz.
pub(super) fn read_info(lines: &mut Lines) -> Result<Option<f64>> {
    let (header, rows) = table(lines, "Info")?;
    let field = |name: &str| value(&header, rows.first()?, name);
    match field("CSV Version") {
        Some(VERSION) => {}
        version => {
            let found = version.map_or("no CSV version".to_owned(), |v| format!("CSV version {v}"));
            return Err(lines.error(found, format!("version {VERSION}")));
        }
    }
    let is_timed = field("Trigger Mode") == Some(0.0);
    Ok(field("Trigger Rate").filter(|rate_hz| is_timed && *rate_hz > 0.0))
}

/// An error for the profiles if their alignment tilts them out of the plane of x and z.
pub(super) fn tilt(lines: &mut Lines) -> Result<Option<Error>> {
    let (header, rows) = table(lines, "DeviceInfo")?;
    for name in ["Transform X Angle", "Transform Z Angle"] {
        let mut angles = rows.iter().filter_map(|row| value(&header, row, name));
        if let Some(angle) = angles.find(|angle| angle.abs() > MOST_TILT_DEG) {
            return Ok(Some(lines.error(
                format!("{name} = {angle} degrees"),
                "0, because the file does not have y of the points: clear the alignment of the sensor \
                 before the export",
            )));
        }
    }
    Ok(None)
}

impl Layout {
    /// Reads the headers of a block of profiles, up to its rows.
    pub(super) fn read(lines: &mut Lines, block: &str) -> Result<Self> {
        next_line(lines, &format!("the header of {block}"))?;
        let attributes = cells(lines.text());
        next_line(lines, "the values of the header")?;
        let values = cells(lines.text());
        let field = |name: &str| value(&attributes, &values, name);
        let (Some(columns), Some(offset_mm)) = (field("Column Count"), field("X Offset")) else {
            let found: String = lines.text().chars().take(80).collect();
            return Err(lines.error(
                format!("`{found}`"),
                "Column Count and X Offset of the profiles",
            ));
        };
        next_line(lines, "the columns of the profiles")?;
        let names = cells(lines.text());
        let index = |name: &str| names.iter().position(|other| other == name);
        let indices = [
            index("Frame"),
            index("Source"),
            index("Time"),
            index("Axis"),
        ];
        let [Some(frame), Some(source), Some(time), Some(axis)] = indices else {
            let found: String = lines.text().chars().take(80).collect();
            return Err(lines.error(
                format!("`{found}`"),
                "the columns Frame, Source, Time, …, Axis",
            ));
        };
        let first = axis + 1;
        let width = names.len() - first;
        if width as f64 != columns {
            return Err(lines.error(
                format!("{width} columns after Axis"),
                format!("{columns}, the Column Count"),
            ));
        }
        let x_mm = match block {
            RAW => None,
            _ => Some(uniform_x(lines, &names[first..], offset_mm)?),
        };
        Ok(Self {
            indices: [frame, source, time, axis],
            names,
            first,
            x_mm,
            width,
        })
    }

    /// Parses a row.
    pub(super) fn row(&self, lines: &Lines) -> Result<Row> {
        let cells: Vec<&str> = lines.text().split(',').map(str::trim_ascii).collect();
        let width = self.first + self.width;
        if cells.len() < width || cells[width..].iter().any(|cell| !cell.is_empty()) {
            return Err(lines.error(
                format!("{} values", cells.len()),
                format!("{width} as in the header"),
            ));
        }
        let cell_error = |at: usize, expected: &str| {
            let found: String = cells[at].chars().take(40).collect();
            lines.error(format!("`{found}` in column {}", self.names[at]), expected)
        };
        let number = |at: usize| match cells[at].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(cell_error(at, "a finite number")),
        };
        let [frame, source, time, axis] = self.indices;
        let key = [number(frame)?, number(source)?, number(time)?];
        let axis = match (cells[axis], &self.x_mm) {
            ("X", None) => Axis::X,
            ("Z", _) => Axis::Z,
            ("I", _) => Axis::Intensity,
            (_, None) => return Err(cell_error(axis, "X, Z or I")),
            (_, Some(_)) => return Err(cell_error(axis, "Z or I")),
        };
        let measured = |at: usize| match cells[at] {
            "" | "-" => Ok(f64::NAN),
            _ => number(at).and_then(|value| {
                if value.abs() < FARTHEST_MM {
                    Ok(value)
                } else {
                    Err(cell_error(at, "a coordinate below 1000000 mm"))
                }
            }),
        };
        Ok(Row {
            key,
            axis,
            values: (self.first..width).map(measured).collect::<Result<_>>()?,
        })
    }
}

/// x of each column of uniform profiles, millimetres; the first must be the offset of the block.
fn uniform_x(lines: &Lines, names: &[String], offset_mm: f64) -> Result<Vec<f64>> {
    let parse = |name: &String| match name.parse::<f64>() {
        Ok(x) if x.abs() < FARTHEST_MM => Ok(x),
        _ => Err(lines.error(
            format!("`{name}` in the header"),
            "x of the column in millimetres",
        )),
    };
    let x_mm = names.iter().map(parse).collect::<Result<Vec<f64>>>()?;
    let step = match x_mm.as_slice() {
        [first, second, ..] => (second - first).abs(),
        _ => 0.0,
    };
    match x_mm.first() {
        Some(first) if (first - offset_mm).abs() > step.max(1e-3) => Err(lines.error(
            format!("columns from {first} mm"),
            format!("from {offset_mm} mm, the X Offset of the block"),
        )),
        _ => Ok(x_mm),
    }
}
