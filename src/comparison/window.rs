//! The points around a block of cells, gathered row by row.

use std::ops::Range;

use super::cells::{Cells, Lattice, SIDE};
use super::moments::{Moments, Offsets};
use crate::cloud::voxel::VoxelKey;
use crate::geometry::Vec3;

/// More than the rounding of a squared distance, relative.
const ROUNDING: f64 = 1e-14;

/// A row of cells along x in which there are points.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Lower ends of its intervals along y and z, metres.
    y_m: f64,
    z_m: f64,
    /// Its first occupied cell.
    cell: usize,
    /// Where its columns stand in [`Window::ranks`].
    ranks: usize,
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
    /// For each column of each row how many cells before it are occupied, and for the end of the row.
    ranks: Vec<u8>,
    /// Where the points of each occupied cell begin, and after those of a row where they end.
    begins: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// Of the points of a row up to the place of each of `begins`, about `origin`; where asked for.
    moments: Vec<Moments>,
    origin: Vec3,
    /// For each cell of the box the points' place in the cloud's lists and their number, and whether
    /// a row has any; all zero between two gatherings.
    found: Vec<(u32, u32)>,
    occupied: Vec<bool>,
}

impl Window {
    /// Gathers the points of all cells that meet the box from `low` to `high` (metres) and belong to
    /// `block` or its neighbours.
    pub(super) fn gather_box(
        &mut self,
        cells: &Cells,
        block: VoxelKey,
        (low, high): (&Vec3, &Vec3),
    ) {
        let lattice = cells.lattice;
        let room = lattice.rounding(low).max(lattice.rounding(high));
        let first = std::array::from_fn(|axis| {
            let index = lattice.index(low[axis] - room);
            index.max((block[axis] - 1) * SIDE)
        });
        let last = std::array::from_fn(|axis| {
            let index = lattice.index(high[axis] + room);
            index.min((block[axis] + 2) * SIDE - 1)
        });
        self.gather(cells, block, first, last);
    }

    /// Gathers the points of `block` and its neighbours and sums up their moments.
    pub(super) fn gather_moments(&mut self, cells: &Cells, block: VoxelKey) {
        // Always all of them: sums along a row begin where it does.
        let first = block.map(|index| (index - 1) * SIDE);
        let last = block.map(|index| (index + 2) * SIDE - 1);
        self.gather(cells, block, first, last);
        self.origin = Vec3::from_fn(|axis, _| cells.lattice.low(block[axis] * SIDE + SIDE / 2));
        self.sum_up();
    }

    fn gather(&mut self, cells: &Cells, block: VoxelKey, first: VoxelKey, last: VoxelKey) {
        let lattice = cells.lattice;
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
        self.ranks.clear();
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
                cell: self.begins.len(),
                ranks: self.ranks.len(),
            });
            self.copy(cells, row * columns);
        }
    }

    /// Copies the points of the row whose cells begin at `found[row]`.
    fn copy(&mut self, cells: &Cells, row: usize) {
        let mut begin = self.x.len() as u32;
        let mut rank = 0;
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
            self.ranks.push(rank);
            if count > 0 {
                rank += 1;
                self.begins.push(begin);
                begin += count;
                if from != end {
                    copy(first, end);
                    first = from;
                }
                end = from + count;
            }
        }
        copy(first, end);
        self.ranks.push(rank);
        self.begins.push(begin);
    }

    fn sum_up(&mut self) {
        self.moments.clear();
        for (at, row) in self.rows.iter().enumerate() {
            let next = self
                .rows
                .get(at + 1)
                .map_or(self.begins.len(), |row| row.cell);
            let mut moments = Moments::default();
            self.moments.push(moments);
            for bounds in self.begins[row.cell..next].windows(2) {
                for at in bounds[0] as usize..bounds[1] as usize {
                    moments.add(
                        self.x[at] - self.origin.x,
                        self.y[at] - self.origin.y,
                        self.z[at] - self.origin.z,
                    );
                }
                self.moments.push(moments);
            }
        }
    }

    /// Moments about `centre` of the points in the closed ball of `radius` (metres) around it.
    pub(super) fn moments_in_ball(&self, centre: &Vec3, radius: f64, spans: &mut Spans) -> Moments {
        self.ball(centre, radius, spans);
        let mut surely = Moments::default();
        for span in &spans.inside {
            let (begin, end) = (span.start as usize, span.end as usize);
            surely.merge_between(&self.moments[begin], &self.moments[end]);
        }
        let lists = [&self.x[..], &self.y, &self.z];
        let mut all = spans
            .offsets
            .moments_within(lists, &spans.open, centre, radius * radius);
        all.merge(&surely.moved(&(self.origin - centre)));
        all
    }

    /// Replaces `into` by the points in the closed ball of `radius` (metres) around `centre`.
    pub(super) fn points_in_ball(
        &self,
        centre: &Vec3,
        radius: f64,
        spans: &mut Spans,
        into: &mut Vec<Vec3>,
    ) {
        self.ball(centre, radius, spans);
        into.clear();
        let points = |cells: &Range<u32>| self.points(cells.start as usize..cells.end as usize);
        let inside = spans.inside.iter().flat_map(points);
        let open = spans
            .open
            .iter()
            .flat_map(|span| span.start as usize..span.end as usize);
        for at in inside.chain(open) {
            let point = Vec3::new(self.x[at], self.y[at], self.z[at]);
            if (point - centre).norm_squared() <= radius * radius {
                into.push(point);
            }
        }
    }

    /// Replaces `spans` by what of each row may lie in the ball.
    fn ball(&self, centre: &Vec3, radius: f64, spans: &mut Spans) {
        spans.inside.clear();
        spans.open.clear();
        let Some(lattice) = self.lattice else {
            return;
        };
        let (cell_m, per_metre) = (lattice.cell_m, lattice.cell_m.recip());
        let room = lattice.rounding(centre);
        let squared = radius * radius;
        let (low, high) = (squared * (1.0 - ROUNDING), squared * (1.0 + ROUNDING));
        let column = (centre.x - self.x_m) * per_metre;
        let last = self.columns as f64;
        for row in &self.rows {
            let (near_y, far_y) = nearest_and_farthest(row.y_m - centre.y, cell_m, room);
            let (near_z, far_z) = nearest_and_farthest(row.z_m - centre.z, cell_m, room);
            let left = high - near_y * near_y - near_z * near_z;
            if left < 0.0 {
                continue;
            }
            let half = (left.sqrt() + room) * per_metre;
            let outer = self.cell(row, below(column - half, last))
                ..self.cell(row, above(column + half, last));
            let left = low - far_y * far_y - far_z * far_z;
            let half = (larger(left, 0.0).sqrt() - room) * per_metre;
            let inner = self.cell(row, above(column - half, last))
                ..self.cell(row, below(column + half, last));
            let begin = |cell: usize| self.begins[cell];
            if left > 0.0 && inner.start < inner.end {
                spans.inside.push(inner.start as u32..inner.end as u32);
                spans.open.push(begin(outer.start)..begin(inner.start));
                spans.open.push(begin(inner.end)..begin(outer.end));
            } else {
                spans.open.push(begin(outer.start)..begin(outer.end));
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
                let range = self.points(self.cell(row, from)..self.cell(row, to));
                each([
                    &self.x[range.clone()],
                    &self.y[range.clone()],
                    &self.z[range],
                ]);
            }
        }
    }

    /// The first occupied cell of a row from `column` on.
    #[inline]
    fn cell(&self, row: &Row, column: usize) -> usize {
        row.cell + usize::from(self.ranks[row.ranks + column])
    }

    /// Where the points of some occupied cells of a row stand.
    #[inline]
    fn points(&self, cells: Range<usize>) -> Range<usize> {
        self.begins[cells.start] as usize..self.begins[cells.end] as usize
    }
}

/// What of the rows may lie in a ball.
#[derive(Debug, Default)]
pub(super) struct Spans {
    /// Occupied cells that surely lie inside.
    inside: Vec<Range<u32>>,
    /// Points to be tested.
    open: Vec<Range<u32>>,
    offsets: Offsets,
}

/// Distances from 0 to the nearest and the farthest point of the interval from `low` on, as long as
/// `length`, the first not too large and the second not too small by `room`.
#[inline(always)]
fn nearest_and_farthest(low: f64, length: f64, room: f64) -> (f64, f64) {
    let high = low + length;
    (
        larger(larger(low, -high) - room, 0.0),
        larger(-low, high) + room,
    )
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
