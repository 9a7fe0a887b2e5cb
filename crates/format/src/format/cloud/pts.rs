//! PTS and PTX of Leica: text with x y z, mostly with intensity and colours; PTX has grids with a transform.

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::format::cloud::gathering::Gathering;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::lines::Lines;
use crate::geometry::Vec3;

pub(crate) const PTS: Kind = Kind {
    extensions: &["pts"],
    cloud: Some(read_pts),
    frame: Frame::Fixed("metres (assumed: PTS has no unit); axes of the file, taken for the world"),
    ..Kind::new("pts", "cloud (PTS)")
};

pub(crate) const PTX: Kind = Kind {
    extensions: &["ptx"],
    cloud: Some(read_ptx),
    frame: Frame::Fixed(
        "metres (assumed: PTX has no unit); axes of the transforms in the file, which are applied, taken for the world",
    ),
    ..Kind::new("ptx", "cloud (PTX)")
};

/// Reads a line of at least `n` numbers; false at the end of the file.
fn row(lines: &mut Lines, n: usize, cells: &mut Vec<f64>) -> Result<bool> {
    lines.next_row(
        cells,
        |found| found.len() >= n,
        || format!("{n} numbers or more"),
    )
}

fn ended(lines: &Lines, expected: &str) -> Error {
    lines.error("the end of the file", expected)
}

/// The integer of a line with a single number.
fn count(lines: &Lines, cells: &[f64], what: &str) -> Result<u64> {
    match cells {
        [n] if *n >= 0.0 && n.fract() == 0.0 && *n < 1e15 => Ok(*n as u64),
        _ => Err(lines.error(format!("`{}`", lines.text()), what)),
    }
}

/// The intensity of a line with this many values: x y z and intensity, also with colours, and with normals behind them.
/// In other lines the fourth value is a colour, a normal or unknown.
fn intensity(cells: &[f64]) -> f64 {
    match cells.len() {
        4 | 7 | 10 => cells[3],
        _ => f64::NAN,
    }
}

/// What the values behind x y z are that are not read from lines with this many values.
fn left_out(width: usize) -> Option<String> {
    let values = match width {
        0..=4 => return None,
        6 => "the last 3 of 6 values (colours or normals; the format names none)",
        7 => "colours",
        10 => "colours and normals",
        _ => "the values behind x y z (the format does not name them)",
    };
    Some(format!("{values} are left out"))
}

/// Reads PTS: a count, then that many points; several such blocks may follow. A count may be missing or wrong.
pub(crate) fn read_pts(input: &Input) -> Result<PointCloud> {
    let mut lines = Lines::open(input)?;
    let mut gathering = Gathering::new(input);
    let mut cells = Vec::new();
    let (mut announced, mut found, mut widest) = (None, 0u64, 0);
    while row(&mut lines, 1, &mut cells)? {
        if cells.len() == 1 {
            let n = count(&lines, &cells, "the number of points")?;
            announced = Some(announced.unwrap_or(0) + n);
            continue;
        }
        if cells.len() < 3 {
            return Err(lines.error(
                format!("`{}`", lines.text()),
                "x y z, or a number of points",
            ));
        }
        found += 1;
        widest = cells.len().max(widest);
        let position = Vec3::new(cells[0], cells[1], cells[2]);
        gathering.push(position, f64::NAN, intensity(&cells));
    }
    match announced {
        None => input.remark("the file does not begin with the number of its points".to_owned()),
        Some(n) if n > found => {
            return Err(ended(&lines, &format!("{n} points (found {found})")));
        }
        Some(n) if n < found => input.remark(format!(
            "the file announces {n} points and has {found}: all are read"
        )),
        Some(_) => {}
    }
    if let Some(remark) = left_out(widest) {
        input.remark(remark);
    }
    gathering.finish()
}

/// Reads PTX: for each scan columns and rows, position and axes of the scanner (repeated by the
/// transform), the transform for row vectors, and the points; points at (0, 0, 0) were not
/// measured.
pub(crate) fn read_ptx(input: &Input) -> Result<PointCloud> {
    let mut lines = Lines::open(input)?;
    let mut gathering = Gathering::new(input);
    let mut cells = Vec::new();
    let mut widest = 0;
    while row(&mut lines, 1, &mut cells)? {
        let columns = count(&lines, &cells, "the number of columns")?;
        let next = |n: usize, what: &str, cells: &mut Vec<f64>, lines: &mut Lines| {
            if row(lines, n, cells)? {
                Ok(())
            } else {
                Err(ended(lines, what))
            }
        };
        next(1, "the number of rows", &mut cells, &mut lines)?;
        let rows = count(&lines, &cells, "the number of rows")?;
        for _ in 0..4 {
            next(
                3,
                "position and axes of the scanner",
                &mut cells,
                &mut lines,
            )?;
        }
        let mut m = [[0.0; 3]; 4];
        for line in &mut m {
            next(4, "the transform", &mut cells, &mut lines)?;
            line.copy_from_slice(&cells[..3]);
        }
        let first = gathering.len();
        for _ in 0..columns.saturating_mul(rows) {
            next(3, "the points of the grid", &mut cells, &mut lines)?;
            let p = [cells[0], cells[1], cells[2]];
            if p == [0.0; 3] {
                gathering.skip_at_scanner();
                continue;
            }
            let world = |k: usize| p[0] * m[0][k] + p[1] * m[1][k] + p[2] * m[2][k] + m[3][k];
            let point = Vec3::new(world(0), world(1), world(2));
            gathering.push(point, f64::NAN, intensity(&cells));
            widest = cells.len().max(widest);
        }
        gathering.scanned_from(Vec3::from(m[3]), first);
    }
    if let Some(remark) = left_out(widest) {
        input.remark(remark);
    }
    gathering.finish()
}
