//! The octree of a Cloud Optimized Point Cloud: which points belong to which cell.
//!
//! A cell with more points than a leaf may have keeps one point of each of 128 × 128 × 128
//! subcells, and its children get the others, so that each level halves the distance between the
//! points. Points and cells are placed by whole steps of the coordinates, without rounding.

use std::ops::Range;

use rayon::prelude::*;

/// Points up to which a cell is not divided.
const LEAF_POINTS: usize = 100_000;
/// Most points of a cell that is divided; a coarser grid is used for cells that would have more.
const MOST_CHOSEN: usize = 200_000;
/// A cell that is divided has 2⁷ subcells along each axis.
const GRID_BITS: u32 = 7;
/// Most bits per axis: three interleaved numbers of 21 bits fit into a key.
const MOST_BITS: u32 = 21;
/// A finest cell has at least 2⁵ steps along each axis, so that rounding the side of the cube up to
/// whole finest cells adds at most 3 %.
const FINEST_BITS: u32 = 5;

/// The cube around all points, divided into finest cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cube {
    /// Lowest corner, steps. The cube begins half a step below it: no point lies on a boundary.
    low: [i64; 3],
    /// Side of a finest cell, steps.
    finest: i64,
    /// The cube has 2 to this power finest cells along each axis.
    bits: u32,
}

/// A cell with points.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cell {
    /// 0 is the whole cube.
    pub(super) level: u32,
    /// Number of the cell along each axis.
    pub(super) at: [u32; 3],
    /// Range of its points in the list of all points.
    pub(super) points: Range<usize>,
}

/// A point: its finest cell as interleaved bits, and its number.
pub(super) type Keyed = (u64, u32);

impl Cube {
    /// Around points between `low` and `high`, steps.
    pub(super) fn around(low: [i32; 3], high: [i32; 3]) -> Self {
        let low = low.map(i64::from);
        let steps = (0..3).map(|axis| i64::from(high[axis]) - low[axis] + 1);
        let extent = steps.max().unwrap_or(1).max(1);
        let bits = extent.ilog2().saturating_sub(FINEST_BITS).min(MOST_BITS);
        let cells = 1i64 << bits;
        let finest = (extent + cells - 1) / cells;
        Self { low, finest, bits }
    }

    /// Length of a side, steps.
    pub(super) fn side(&self) -> i64 {
        self.finest << self.bits
    }

    /// Centre, steps.
    pub(super) fn centre(&self) -> [f64; 3] {
        self.low
            .map(|low| low as f64 - 0.5 + self.side() as f64 / 2.0)
    }

    /// The finest cell of a point, with interleaved bits: x in the lowest.
    pub(super) fn key(&self, steps: [i32; 3]) -> u64 {
        let cell = |axis: usize| ((i64::from(steps[axis]) - self.low[axis]) / self.finest) as u64;
        spread(cell(0)) | spread(cell(1)) << 1 | spread(cell(2)) << 2
    }
}

/// The lowest 21 bits of `v`, each followed by two zeros.
fn spread(v: u64) -> u64 {
    let v = v & 0x1f_ffff;
    let v = (v | v << 32) & 0x001f_0000_0000_ffff;
    let v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    let v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    let v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// Every third bit of `v`: the reverse of [`spread`].
fn gathered(v: u64) -> u64 {
    let v = v & 0x1249_2492_4924_9249;
    let v = (v | v >> 2) & 0x10c3_0c30_c30c_30c3;
    let v = (v | v >> 4) & 0x100f_00f0_0f00_f00f;
    let v = (v | v >> 8) & 0x001f_0000_ff00_00ff;
    let v = (v | v >> 16) & 0x001f_0000_0000_ffff;
    (v | v >> 32) & 0x1f_ffff
}

/// Distributes points over cells: sorts `points` by cell and, within a cell, by number, and returns
/// the cells, each before its children.
pub(super) fn divide(cube: &Cube, points: &mut [Keyed]) -> Vec<Cell> {
    points.par_sort_unstable();
    let mut cells = Vec::new();
    if !points.is_empty() {
        let root = 0..points.len();
        divide_cell(cube.bits, 0, root, points, &mut cells);
    }
    cells.iter().for_each(|cell| {
        points[cell.points.clone()].sort_unstable_by_key(|(_, number)| *number);
    });
    cells
}

/// `range` holds the points inside the cell that none of its ancestors keeps, sorted by key.
fn divide_cell(
    bits: u32,
    level: u32,
    range: Range<usize>,
    points: &mut [Keyed],
    cells: &mut Vec<Cell>,
) {
    let below = bits - level;
    let prefix = points[range.start].0 >> (3 * below);
    let at = [prefix, prefix >> 1, prefix >> 2].map(|v| gathered(v) as u32);
    if range.len() <= LEAF_POINTS || below == 0 {
        let points = range;
        cells.push(Cell { level, at, points });
        return;
    }
    let chosen = choose(below, &mut points[range.clone()]);
    let rest = range.start + chosen..range.end;
    cells.push(Cell {
        level,
        at,
        points: range.start..rest.start,
    });
    let mut start = rest.start;
    while start < rest.end {
        let shift = 3 * (below - 1);
        let child = points[start].0 >> shift;
        let length = points[start..rest.end].partition_point(|(key, _)| key >> shift == child);
        divide_cell(bits, level + 1, start..start + length, points, cells);
        start += length;
    }
}

/// Moves one point of each subcell to the beginning, the one nearest to its centre, and keeps the
/// order of the others; returns the number of those moved. A cell has 2 to the power of `below`
/// finest cells along each axis.
fn choose(below: u32, points: &mut [Keyed]) -> usize {
    let mut grid = GRID_BITS.min(below);
    // The subcells of a grid are runs of keys with the same beginning.
    let subcells = |grid: u32| {
        let shift = 3 * (below - grid);
        1 + points
            .windows(2)
            .filter(|pair| pair[0].0 >> shift != pair[1].0 >> shift)
            .count()
    };
    while grid > 1 && subcells(grid) > MOST_CHOSEN {
        grid -= 1;
    }
    let within = below - grid;
    let shift = 3 * within;
    let mut chosen = Vec::new();
    // The others are moved to the end, from the last to the first.
    let mut free = points.len();
    let mut end = points.len();
    while end > 0 {
        let subcell = points[end - 1].0 >> shift;
        let start = points[..end].partition_point(|(key, _)| key >> shift < subcell);
        let nearest = (start..end)
            .min_by_key(|at| (off_centre(points[*at].0, within), points[*at].1))
            .unwrap_or(start);
        chosen.push(points[nearest]);
        for at in (start..end).rev().filter(|at| *at != nearest) {
            free -= 1;
            points[free] = points[at];
        }
        end = start;
    }
    points[..free].copy_from_slice(&chosen);
    free
}

/// Square of twice the distance of a finest cell from the centre of its subcell, which has 2 to the
/// power of `within` finest cells along each axis.
fn off_centre(key: u64, within: u32) -> u64 {
    let side = 1i64 << within;
    let square = |v: u64| {
        let at = (gathered(v) as i64) & (side - 1);
        (2 * at + 1 - side).pow(2) as u64
    };
    square(key) + square(key >> 1) + square(key >> 2)
}
