//! The blocks of a Gocator CSV export: what is read of each, and the rows of profiles.

use crate::error::{Error, Result};
use crate::format::text::lines::{Lines, Separator};

/// The version of the file that the manual describes.
const VERSION: f64 = 2.0;
/// Of a tilt: 17 µm in y at 1 m.
const MOST_TILT_DEG: f64 = 0.001;
/// More sensors than any system has.
const MOST_DEVICES: usize = 1000;
/// Beyond the range of any profile scanner, millimetres.
const FARTHEST_MM: f64 = 1e6;

/// The block of point cloud profiles.
pub(super) const RAW: &str = "RawProfile";

/// What the rows of a profile hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Axis {
    X,
    Z,
    Intensity,
}

/// A row of a profile; NaN marks what was not measured.
pub(super) struct Row {
    /// Frame, source and time stamp: the same for all rows of a profile.
    pub(super) key: [f64; 3],
    pub(super) axis: Axis,
    pub(super) values: Vec<f64>,
}

/// Where the rows have what is read.
pub(super) struct Layout {
    /// Columns of frame, source, time and axis.
    places: [usize; 4],
    names: Vec<String>,
    /// First column of the profile.
    first: usize,
    /// x of each column, millimetres; `None` of point cloud profiles, whose rows have it.
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

/// The next header and, line by line, the values below it up to `End`.
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

/// Refuses another block of profiles behind the one that was read.
pub(super) fn check_rest(lines: &mut Lines) -> Result<()> {
    while lines.advance()? {
        match lines.text().to_owned().as_str() {
            "" => {}
            block @ ("Profile" | RAW) => {
                let found = format!("a second block of profiles, {block}");
                return Err(lines.error(found, "one in a file"));
            }
            block => skip(lines, &block.chars().take(40).collect::<String>())?,
        }
    }
    Ok(())
}

/// A number below a header, if it is there.
fn value(header: &[String], row: &[String], name: &str) -> Option<f64> {
    let at = header.iter().position(|other| other == name)?;
    row.get(at)?.parse().ok()
}

/// Checks the version and returns the rate of a sensor that triggers by time, hertz.
pub(super) fn read_info(lines: &mut Lines) -> Result<Option<f64>> {
    let (header, rows) = table(lines, "Info")?;
    let of = |name: &str| value(&header, rows.first()?, name);
    match of("CSV Version") {
        Some(VERSION) => {}
        version => {
            let found = version.map_or("no CSV version".to_owned(), |v| format!("CSV version {v}"));
            return Err(lines.error(found, format!("version {VERSION}, whose layout is known")));
        }
    }
    let is_timed = of("Trigger Mode") == Some(0.0);
    Ok(of("Trigger Rate").filter(|rate_hz| is_timed && *rate_hz > 0.0))
}

/// The error of profiles that do not lie in the plane of x and z, if the block says that they do not.
pub(super) fn tilt(lines: &mut Lines) -> Result<Option<Error>> {
    let (header, rows) = table(lines, "DeviceInfo")?;
    for name in ["Transform X Angle", "Transform Z Angle"] {
        let mut angles = rows.iter().filter_map(|row| value(&header, row, name));
        if let Some(angle) = angles.find(|angle| angle.abs() > MOST_TILT_DEG) {
            return Ok(Some(lines.error(
                format!("{name} = {angle} degrees"),
                "0, or y of the points would be missing: clear the alignment of the sensor before \
                 the export",
            )));
        }
    }
    Ok(None)
}

impl Layout {
    /// Reads what stands before the rows of a block of profiles.
    pub(super) fn read(lines: &mut Lines, block: &str) -> Result<Self> {
        next_line(lines, &format!("the header of {block}"))?;
        let attributes = cells(lines.text());
        next_line(lines, "the values of the header")?;
        let values = cells(lines.text());
        let of = |name: &str| value(&attributes, &values, name);
        let (Some(columns), Some(offset_mm)) = (of("Column Count"), of("X Offset")) else {
            let found: String = lines.text().chars().take(80).collect();
            return Err(lines.error(
                format!("`{found}`"),
                "Column Count and X Offset of the profiles",
            ));
        };
        next_line(lines, "the columns of the profiles")?;
        let names = cells(lines.text());
        let place = |name: &str| names.iter().position(|other| other == name);
        let places = [
            place("Frame"),
            place("Source"),
            place("Time"),
            place("Axis"),
        ];
        let [Some(frame), Some(source), Some(time), Some(axis)] = places else {
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
                format!("{width} columns behind Axis"),
                format!("{columns}, the Column Count"),
            ));
        }
        let x_mm = match block {
            RAW => None,
            _ => Some(uniform_x(lines, &names[first..], offset_mm)?),
        };
        Ok(Self {
            places: [frame, source, time, axis],
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
        let wrong = |at: usize, expected: &str| {
            let found: String = cells[at].chars().take(40).collect();
            lines.error(format!("`{found}` in column {}", self.names[at]), expected)
        };
        let number = |at: usize| match cells[at].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(wrong(at, "a finite number")),
        };
        let [frame, source, time, axis] = self.places;
        let key = [number(frame)?, number(source)?, number(time)?];
        let axis = match (cells[axis], &self.x_mm) {
            ("X", None) => Axis::X,
            ("Z", _) => Axis::Z,
            ("I", _) => Axis::Intensity,
            (_, None) => return Err(wrong(axis, "X, Z or I")),
            (_, Some(_)) => return Err(wrong(axis, "Z or I")),
        };
        let measured = |at: usize| match cells[at] {
            "" | "-" => Ok(f64::NAN),
            _ => number(at).and_then(|value| match value.abs() < FARTHEST_MM {
                true => Ok(value),
                false => Err(wrong(at, "a coordinate below 1000000 mm")),
            }),
        };
        Ok(Row {
            key,
            axis,
            values: (self.first..width).map(measured).collect::<Result<_>>()?,
        })
    }
}

/// x of the columns of uniform profiles, which must begin at the offset of the block, millimetres.
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
