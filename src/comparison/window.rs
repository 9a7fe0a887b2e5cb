//! The points around a block of cells, gathered row by row.

use std::ops::Range;

use super::cells::{Cells, Lattice, SIDE};
use crate::cloud::voxel::VoxelKey;
use crate::geometry::Vec3;

/// Points are handed out in multiples of this: vector units then take them without rest. What is
/// too many belongs to the same row, or lies at infinity behind its end.
const EIGHT: usize = 8;

/// More than the rounding of a squared distance, relative.
const ROUNDING: f64 = 1e-14;

/// A row of cells along x in which there are points.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Lower ends of its intervals along y and z, metres.
    y_m: f64,
    z_m: f64,
    /// Where its columns stand in [`Window::begins`].
    columns: usize,
}

/// The points in a box of cells: layer by layer, row by row, cell by cell along x, and within a cell
/// in the order of the cloud.
#[derive(Debug, Default)]
pub(super) struct Window {
    lattice: Option<Lattice>,
    /// Lower end of the first column, metres.
    x_m: f64,
    columns: usize,
    rows: Vec<Row>,
    /// Where the points of each column of each row begin, and after those of a row where they end.
    begins: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// For each cell of the box the points' place in the cloud's lists and their number, and whether
    /// a row has any; all zero between two gatherings.
    found: Vec<(u32, u32)>,
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
        self.found.resize(columns * rows * layers, (0, 0));
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
                            self.found[row * columns + column] = (run.first, run.count);
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

    /// Copies the points of the row whose cells begin at `found[row]`.
    fn copy(&mut self, cells: &Cells, row: usize) {
        let mut begin = self.x.len() as u32;
        // Cells that follow each other in the cloud's lists are copied at once.
        let (mut first, mut end) = (0, 0);
        let mut copy = |first: u32, end: u32| {
            let range = first as usize..end as usize;
            self.x.extend_from_slice(&cells.x[range.clone()]);
            self.y.extend_from_slice(&cells.y[range.clone()]);
            self.z.extend_from_slice(&cells.z[range]);
        };
        for cell in &mut self.found[row..row + self.columns] {
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

    /// Hands the points of all cells that may meet the closed ball of `radius` (metres) around
    /// `centre` to `each`, row by row, and some around them.
    pub(super) fn in_ball(&self, centre: &Vec3, radius: f64, mut each: impl FnMut([&[f64]; 3])) {
        let Some(lattice) = self.lattice else {
            return;
        };
        let (cell_m, per_metre) = (lattice.cell_m, lattice.cell_m.recip());
        let room = lattice.rounding(centre);
        let squared = radius * radius * (1.0 + ROUNDING);
        let column = (centre.x - self.x_m) * per_metre;
        let last = self.columns as f64;
        for row in &self.rows {
            let y = distance_to_interval(row.y_m - centre.y, cell_m, room);
            let z = distance_to_interval(row.z_m - centre.z, cell_m, room);
            let left = squared - y * y - z * z;
            if left >= 0.0 {
                let half = (left.sqrt() + room) * per_metre;
                let (from, to) = (below(column - half, last), above(column + half, last));
                each(self.points(row, from..to));
            }
        }
    }

    /// Hands the points of each row that meet the box from `low` to `high` (metres) to `each`, and
    /// some around it.
    pub(super) fn in_box(&self, low: &Vec3, high: &Vec3, mut each: impl FnMut([&[f64]; 3])) {
        let Some(lattice) = self.lattice else {
            return;
        };
        let (cell_m, per_metre) = (lattice.cell_m, lattice.cell_m.recip());
        let room = lattice.rounding(low).max(lattice.rounding(high));
        let last = self.columns as f64;
        let from = below((low.x - room - self.x_m) * per_metre, last);
        let to = above((high.x + room - self.x_m) * per_metre, last);
        let meets =
            |begin: f64, low: f64, high: f64| begin <= high + room && begin + cell_m >= low - room;
        for row in &self.rows {
            if meets(row.y_m, low.y, high.y) && meets(row.z_m, low.z, high.z) {
                each(self.points(row, from..to));
            }
        }
    }

    /// The points in some columns of a row, and as many after them as make eights of them.
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

/// Distance from 0 to the interval from `low` on, as long as `length`; not too large, by `room`.
#[inline(always)]
fn distance_to_interval(low: f64, length: f64, room: f64) -> f64 {
    larger(larger(low, -(low + length)) - room, 0.0)
}

/// The larger of two numbers that are not NaN: one instruction, where `f64::max` takes six.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// A whole number between `x` − 1 and `x`, limited to 0 … `last`.
#[inline(always)]
fn below(x: f64, last: f64) -> usize {
    nearest(x - 0.5, last)
}

/// A whole number between `x` and `x` + 1, limited to 0 … `last`.
#[inline(always)]
fn above(x: f64, last: f64) -> usize {
    nearest(x + 0.5, last)
}

/// The whole number nearest to `x`, limited to 0 … `last`, which is small.
#[inline(always)]
fn nearest(x: f64, last: f64) -> usize {
    /// 2⁵²: numbers as large have no digits after the point, and the last bits are the number.
    const WHOLE: f64 = 4_503_599_627_370_496.0;
    let x = larger(x, 0.0);
    let x = if x < last { x } else { last };
    (x + WHOLE).to_bits() as u32 as usize
}
