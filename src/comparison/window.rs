//! The points around a block of cells, gathered row by row.

use super::cells::{Cells, Lattice, SIDE};
use super::moments::Moments;
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
    /// Where its cells begin in [`Window::begins`]; those of a row have one more begin than cells.
    cells: usize,
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
    begins: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// Of the points in each cell about `origin`, at the place of its begin; where asked for.
    moments: Vec<Moments>,
    origin: Vec3,
    /// For each cell of the box the points' place in the cloud's lists and their number, and whether
    /// a row has any; all zero between two gatherings.
    found: Vec<(u32, u32)>,
    occupied: Vec<bool>,
}

impl Window {
    /// Gathers the points of all cells that meet the box from `low` to `high` (metres), which must
    /// not reach beyond the neighbours of `block`.
    pub(super) fn gather(
        &mut self,
        cells: &Cells,
        block: VoxelKey,
        (low, high): (&Vec3, &Vec3),
        with_moments: bool,
    ) {
        let lattice = cells.lattice;
        let room = lattice.rounding(low).max(lattice.rounding(high));
        let first: VoxelKey = std::array::from_fn(|axis| {
            lattice
                .index(low[axis] - room)
                .max((block[axis] - 1) * SIDE)
        });
        let last: VoxelKey = std::array::from_fn(|axis| {
            lattice
                .index(high[axis] + room)
                .min((block[axis] + 2) * SIDE - 1)
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
                            self.found[row * columns + column] =
                                (run.first as u32, run.count as u32);
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
                cells: self.begins.len(),
            });
            self.copy(cells, row * columns);
        }
        if with_moments {
            self.origin = Vec3::from_fn(|axis, _| lattice.low(block[axis] * SIDE + SIDE / 2));
            self.sum_up();
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
    }

    fn sum_up(&mut self) {
        self.moments.clear();
        for row in &self.rows {
            for cell in row.cells..row.cells + self.columns {
                let range = self.begins[cell] as usize..self.begins[cell + 1] as usize;
                let mut moments = Moments::default();
                for at in range {
                    moments.add(
                        self.x[at] - self.origin.x,
                        self.y[at] - self.origin.y,
                        self.z[at] - self.origin.z,
                    );
                }
                self.moments.push(moments);
            }
            // So that moments stand at the places of begins.
            self.moments.push(Moments::default());
        }
    }

    /// Moments about `centre` of the points in the closed ball of `radius` (metres) around it.
    pub(super) fn moments_in_ball(&self, centre: &Vec3, radius: f64) -> Moments {
        let mut surely = Moments::default();
        let mut tested = super::moments::Lanes::default();
        self.ball(centre, radius, |row, outer, inner| {
            for moments in &self.moments[row + inner.start..row + inner.end] {
                surely.merge(moments);
            }
            let left = self.points(row, outer.start..inner.start);
            let right = self.points(row, inner.end..outer.end);
            for range in [left, right] {
                tested.add_within(
                    [
                        &self.x[range.clone()],
                        &self.y[range.clone()],
                        &self.z[range],
                    ],
                    centre,
                    radius * radius,
                );
            }
        });
        let mut all = surely.moved(&(self.origin - centre));
        all.merge(&tested.sum());
        all
    }

    /// Replaces `into` by the points in the closed ball of `radius` (metres) around `centre`.
    pub(super) fn points_in_ball(&self, centre: &Vec3, radius: f64, into: &mut Vec<Vec3>) {
        into.clear();
        self.ball(centre, radius, |row, outer, _| {
            for at in self.points(row, outer) {
                let point = Vec3::new(self.x[at], self.y[at], self.z[at]);
                if (point - centre).norm_squared() <= radius * radius {
                    into.push(point);
                }
            }
        });
    }

    /// Hands each row that meets the ball to `each`: where its cells begin, those columns that may
    /// meet the ball, and those among them that surely lie inside.
    fn ball(
        &self,
        centre: &Vec3,
        radius: f64,
        mut each: impl FnMut(usize, std::ops::Range<usize>, std::ops::Range<usize>),
    ) {
        let Some(lattice) = self.lattice else {
            return;
        };
        let (cell_m, per_metre) = (lattice.cell_m, lattice.cell_m.recip());
        let room = lattice.rounding(centre);
        let squared = radius * radius;
        let column = centre.x - self.x_m;
        let last = self.columns as f64;
        let place = |x: f64| (x * per_metre).clamp(0.0, last) as i32 as usize;
        for row in &self.rows {
            let (near_y, far_y) = nearest_and_farthest(row.y_m - centre.y, cell_m, room);
            let (near_z, far_z) = nearest_and_farthest(row.z_m - centre.z, cell_m, room);
            let left = squared * (1.0 + ROUNDING) - near_y * near_y - near_z * near_z;
            if left < 0.0 {
                continue;
            }
            let half = left.sqrt() + room;
            let outer = place(column - half)..place(column + half + cell_m);
            let left = squared * (1.0 - ROUNDING) - far_y * far_y - far_z * far_z;
            let half = left.max(0.0).sqrt() - room;
            let (begin, end) = (place(column - half + cell_m), place(column + half));
            let inner = if left > 0.0 && begin < end {
                begin..end
            } else {
                outer.end..outer.end
            };
            each(row.cells, outer, inner);
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
        let place = |x: f64| (x * per_metre).clamp(0.0, last) as i32 as usize;
        let from = place(low.x - room - self.x_m);
        let to = place(high.x + room - self.x_m + cell_m);
        let meets =
            |begin: f64, low: f64, high: f64| begin <= high + room && begin + cell_m >= low - room;
        for row in &self.rows {
            if meets(row.y_m, low.y, high.y) && meets(row.z_m, low.z, high.z) {
                let range = self.points(row.cells, from..to);
                each([
                    &self.x[range.clone()],
                    &self.y[range.clone()],
                    &self.z[range],
                ]);
            }
        }
    }

    /// Where the points of some columns of a row stand.
    fn points(&self, row: usize, columns: std::ops::Range<usize>) -> std::ops::Range<usize> {
        self.begins[row + columns.start] as usize..self.begins[row + columns.end] as usize
    }
}

/// Distances from 0 to the nearest and the farthest point of the interval from `low` on, as long as
/// `length`, the first not too large and the second not too small by `room`.
#[inline]
fn nearest_and_farthest(low: f64, length: f64, room: f64) -> (f64, f64) {
    let high = low + length;
    ((low.max(-high) - room).max(0.0), (-low).max(high) + room)
}
