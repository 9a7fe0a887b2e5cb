//! The points around a block of cells, gathered row by row.

use std::ops::Range;

use super::cells::{Cells, Lattice, SIDE};
use crate::cloud::voxel::VoxelKey;
use crate::geometry::Vec3;

/// Points are returned in multiples of this, which fills vector registers. The additional points
/// belong to the same row, or are at infinity behind its end.
const EIGHT: usize = 8;

/// Upper bound on the relative rounding error of a squared distance.
const ROUNDING: f64 = 1e-14;

/// A row of cells along x that contains points.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Lower ends of its intervals along y and z, metres.
    y_m: f64,
    z_m: f64,
    /// First of its columns in [`Window::begins`].
    columns: usize,
}

/// The points in a box of cells: layer by layer, row by row, cell by cell along x, and within a
/// cell in the order of the cloud.
#[derive(Debug, Default)]
pub(super) struct Window {
    lattice: Option<Lattice>,
    /// Lower end of the first column, metres.
    x_m: f64,
    columns: usize,
    rows: Vec<Row>,
    /// The first point of each column of each row, and at the end of each row the end of its last column.
    begins: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// The position of each cell's points in the cloud's lists and their number; all zero between two
    /// calls of `gather`.
    cell_points: Vec<(u32, u32)>,
    /// Whether a row contains points; all false between two calls of `gather`.
    occupied: Vec<bool>,
}

impl Window {
    /// Gathers the points of all cells that meet the box from `low` to `high` (metres) and belong to
    /// `block` or its neighbours.
    pub(super) fn gather(&mut self, cells: &Cells, block: VoxelKey, (low, high): (&Vec3, &Vec3)) {
        let lattice = cells.lattice;
        let room = lattice.rounding(low).max(lattice.rounding(high));
        let first: VoxelKey = std::array::from_fn(|axis| {
            let index = lattice.index(low[axis] - room);
            index.max((block[axis] - 1) * SIDE)
        });
        let last: VoxelKey = std::array::from_fn(|axis| {
            let index = lattice.index(high[axis] + room);
            index.min((block[axis] + 2) * SIDE - 1)
        });
        let [columns, rows, layers] =
            std::array::from_fn(|axis| (last[axis] - first[axis] + 1).max(0) as usize);
        self.cell_points.resize(columns * rows * layers, (0, 0));
        self.occupied.resize(rows * layers, false);
        for z in block[2] - 1..=block[2] + 1 {
            for y in block[1] - 1..=block[1] + 1 {
                for x in block[0] - 1..=block[0] + 1 {
                    cells.runs([x, y, z], |run| {
                        let corner = [x, y, z].map(|index| index * SIDE);
                        let [column, row, layer] = std::array::from_fn(|axis| {
                            // Below the first: wraps to a large number.
                            (corner[axis] + run.place[axis] as i64 - first[axis]) as usize
                        });
                        if column < columns && row < rows && layer < layers {
                            let row = layer * rows + row;
                            self.occupied[row] = true;
                            self.cell_points[row * columns + column] = (run.first, run.count);
                        }
                    });
                }
            }
        }
        self.lattice = Some(lattice);
        self.x_m = lattice.low(first[0]);
        self.columns = columns;
        self.rows.clear();
        self.begins.clear();
        self.x.clear();
        self.y.clear();
        self.z.clear();
        for row in 0..rows * layers {
            if !std::mem::take(&mut self.occupied[row]) {
                continue;
            }
            self.rows.push(Row {
                y_m: lattice.low(first[1] + (row % rows) as i64),
                z_m: lattice.low(first[2] + (row / rows) as i64),
                columns: self.begins.len(),
            });
            self.copy(cells, row * columns);
        }
    }

    /// Copies the points of the row whose cells begin at `cell_points[row]`.
    fn copy(&mut self, cells: &Cells, row: usize) {
        let mut begin = self.x.len() as u32;
        // Cells that are consecutive in the cloud's lists are copied at once.
        let (mut first, mut end) = (0, 0);
        let mut copy = |first: u32, end: u32| {
            let range = first as usize..end as usize;
            self.x.extend_from_slice(&cells.x[range.clone()]);
            self.y.extend_from_slice(&cells.y[range.clone()]);
            self.z.extend_from_slice(&cells.z[range]);
        };
        for cell in &mut self.cell_points[row..row + self.columns] {
            let (from, count) = std::mem::take(cell);
            self.begins.push(begin);
            if count > 0 {
                begin += count;
                if from != end {
                    copy(first, end);
                    first = from;
                }
                end = from + count;
            }
        }
        copy(first, end);
        self.begins.push(begin);
        for list in [&mut self.x, &mut self.y, &mut self.z] {
            list.extend_from_slice(&[f64::INFINITY; EIGHT - 1]);
        }
    }

    /// Number of rows that contain points.
    pub(super) fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Prepares [`Self::row_in_ball`] for the closed ball of `radius` (metres) around `centre`. A
    /// window that was never filled has no points.
    pub(super) fn ball(&self, centre: &Vec3, radius: f64) -> BallQuery {
        let (cell_m, room_m) = match self.lattice {
            Some(lattice) => (lattice.cell_m, lattice.rounding(centre)),
            None => (1.0, 0.0),
        };
        BallQuery {
            y_m: centre.y,
            z_m: centre.z,
            squared: radius * radius * (1.0 + ROUNDING),
            room_m,
            cell_m,
            per_metre: cell_m.recip(),
            column: (centre.x - self.x_m) / cell_m,
            columns: self.columns as f64,
        }
    }

    /// The points of a row in the cells that may meet the ball, and some around them; empty if
    /// there are none.
    #[inline(always)]
    pub(super) fn row_in_ball(&self, row: usize, ball: &BallQuery) -> [&[f64]; 3] {
        let row = &self.rows[row];
        let y = distance_to_interval(row.y_m - ball.y_m, ball.cell_m, ball.room_m);
        let z = distance_to_interval(row.z_m - ball.z_m, ball.cell_m, ball.room_m);
        let left = ball.squared - y * y - z * z;
        if left < 0.0 {
            return [&[]; 3];
        }
        let half = (left.sqrt() + ball.room_m) * ball.per_metre;
        let columns =
            below(ball.column - half, ball.columns)..above(ball.column + half, ball.columns);
        self.points(row, columns)
    }

    /// Prepares [`Self::row_in_box`] for the box from `low` to `high` (metres).
    pub(super) fn box_between(&self, low: &Vec3, high: &Vec3) -> BoxQuery {
        let (cell_m, room_m) = match self.lattice {
            Some(lattice) => (
                lattice.cell_m,
                lattice.rounding(low).max(lattice.rounding(high)),
            ),
            None => (1.0, 0.0),
        };
        let last = self.columns as f64;
        BoxQuery {
            low: low.add_scalar(-room_m - cell_m),
            high: high.add_scalar(room_m),
            columns: below((low.x - room_m - self.x_m) / cell_m, last)
                ..above((high.x + room_m - self.x_m) / cell_m, last),
        }
    }

    /// The points of a row in the cells that meet the box, and some around them; empty if there are
    /// none.
    #[inline(always)]
    pub(super) fn row_in_box(&self, row: usize, between: &BoxQuery) -> [&[f64]; 3] {
        let row = &self.rows[row];
        let (low, high) = (&between.low, &between.high);
        let meets =
            (row.y_m <= high.y) & (row.y_m >= low.y) & (row.z_m <= high.z) & (row.z_m >= low.z);
        if meets {
            self.points(row, between.columns.clone())
        } else {
            [&[]; 3]
        }
    }

    /// The points in some columns of a row, with as many after them as complete a multiple of
    /// eight.
    #[inline(always)]
    fn points(&self, row: &Row, columns: Range<usize>) -> [&[f64]; 3] {
        let begin = self.begins[row.columns + columns.start] as usize;
        let count = self.begins[row.columns + columns.end] as usize - begin;
        let range = begin..begin + count.next_multiple_of(EIGHT);
        [
            &self.x[range.clone()],
            &self.y[range.clone()],
            &self.z[range],
        ]
    }
}

/// A ball in terms of the rows and columns of a window, metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct BallQuery {
    y_m: f64,
    z_m: f64,
    squared: f64,
    room_m: f64,
    cell_m: f64,
    per_metre: f64,
    column: f64,
    columns: f64,
}

/// A box in terms of the rows and columns of a window: the rows whose lower ends lie between `low` and `high`
/// meet it.
#[derive(Debug, Clone)]
pub(super) struct BoxQuery {
    low: Vec3,
    high: Vec3,
    columns: Range<usize>,
}

/// Distance from 0 to the interval from `low` on with length `length`; reduced by `room` so that it
/// is never too large.
#[inline(always)]
fn distance_to_interval(low: f64, length: f64, room: f64) -> f64 {
    larger(larger(low, -(low + length)) - room, 0.0)
}

/// The larger of two numbers that are not NaN: one instruction; `f64::max` takes six.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// An integer between `x` − 1 and `x`, limited to 0 … `last`.
#[inline(always)]
fn below(x: f64, last: f64) -> usize {
    nearest(x - 0.5, last)
}

/// An integer between `x` and `x` + 1, limited to 0 … `last`.
#[inline(always)]
fn above(x: f64, last: f64) -> usize {
    nearest(x + 0.5, last)
}

/// The integer nearest to `x`, limited to 0 … `last`, which is small.
#[inline(always)]
fn nearest(x: f64, last: f64) -> usize {
    /// 2⁵²: numbers of this size have no fractional digits, and the last bits are the integer.
    const WHOLE: f64 = 4_503_599_627_370_496.0;
    let x = larger(x, 0.0);
    let x = if x < last { x } else { last };
    (x + WHOLE).to_bits() as u32 as usize
}
