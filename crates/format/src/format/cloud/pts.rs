//! PTS and PTX of Leica: text with x y z intensity and optional colours; PTX has grids with a transform.

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::lines::Lines;
use crate::geometry::{Vec3, is_finite};

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
    lines.next_numbers(cells, |found| found >= n, || format!("{n} numbers or more"))
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

fn push(cloud: &mut PointCloud, p: Vec3, cells: &[f64]) {
    cloud.points.push(p);
    if let Some(intensity) = cells.get(3) {
        cloud.intensity.push(*intensity as f32);
    }
}

/// Drops the intensities unless all points have one.
fn drop_partial_intensities(mut cloud: PointCloud) -> PointCloud {
    if cloud.intensity.len() != cloud.points.len() {
        cloud.intensity.clear();
    }
    cloud
}

/// Reads PTS: a count, then that many points; several such blocks may follow.
pub(crate) fn read_pts(input: &Input) -> Result<PointCloud> {
    let mut lines = Lines::open(input)?;
    let mut cloud = PointCloud::default();
    let mut cells = Vec::new();
    while row(&mut lines, 1, &mut cells)? {
        let n = count(&lines, &cells, "the number of points")?;
        for i in 0..n {
            if !row(&mut lines, 3, &mut cells)? {
                return Err(ended(&lines, &format!("{n} points (found {i})")));
            }
            push(&mut cloud, Vec3::new(cells[0], cells[1], cells[2]), &cells);
        }
    }
    Ok(drop_partial_intensities(cloud))
}

/// Reads PTX: for each scan columns and rows, position and axes of the scanner (repeated by the
/// transform), the transform for row vectors, and the points; points at (0, 0, 0) were not
/// measured.
pub(crate) fn read_ptx(input: &Input) -> Result<PointCloud> {
    let mut lines = Lines::open(input)?;
    let mut cloud = PointCloud::default();
    let mut cells = Vec::new();
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
        for _ in 0..columns.saturating_mul(rows) {
            next(3, "the points of the grid", &mut cells, &mut lines)?;
            let p = [cells[0], cells[1], cells[2]];
            if p == [0.0; 3] {
                continue;
            }
            let world = |k: usize| p[0] * m[0][k] + p[1] * m[1][k] + p[2] * m[2][k] + m[3][k];
            let point = Vec3::new(world(0), world(1), world(2));
            if !is_finite(&point) {
                return Err(lines.error(
                    "a point that the transform makes infinite",
                    "finite coordinates",
                ));
            }
            push(&mut cloud, point, &cells);
        }
    }
    Ok(drop_partial_intensities(cloud))
}
