//! Points along a space-filling curve: the order in which the neighbour index stores them.
//!
//! Space is divided into cubes with an edge of the longest extent over 2²¹. The key of a cube
//! interleaves the bits of its column, row and layer (Morton 1966), so that cubes with equal
//! leading bits share an octant, and points sorted by key are close in memory if they are close in
//! space. Points in one cube are separated by keys of a grid inside it, 2²¹ times finer, and so on,
//! but only if they are too many for one leaf.
//!
//! The order depends on the extent and on each point, not on the other points: points of a part of
//! a cloud, sorted in the extent of the whole, have the same order as in the whole.

use rayon::prelude::*;

use crate::geometry::{Vec3, is_finite};

/// Points distributed to parcels at a time.
const CHUNK: usize = 1 << 16;

/// Leading bits by which points are distributed: 4096 parcels, of which a surface fills some
/// hundreds.
const PARCEL_BITS: u32 = 12;

/// Bits per axis of a key.
const BITS: u32 = 21;
/// Cells along an axis.
const CELLS: f64 = (1u32 << BITS) as f64;

/// A cube divided into 2²¹ cells per axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    low: Vec3,
    cells_per_m: f64,
    /// Number of cubes that enclose this one as a cell.
    depth: u32,
    /// Number of bits of the largest key.
    used_bits: u32,
}

impl Grid {
    /// Most bits that separate two points: those of a grid, of the grids inside it, and once more.
    pub(super) const MOST_BITS: usize = 6 * 3 * BITS as usize;

    /// The key of a point that is not finite.
    pub(super) const NOWHERE: u64 = u64::MAX;

    /// The grid over the box from `low` to `high` (metres).
    pub(super) fn over(low: &Vec3, high: &Vec3) -> Self {
        let mut grid = Self {
            low: *low,
            cells_per_m: CELLS / (high - low).max(),
            depth: 0,
            used_bits: 0,
        };
        grid.used_bits = u64::BITS - grid.key(high).leading_zeros();
        grid
    }

    /// Keys of `points` with their indices, in ascending order; those of points that are not finite
    /// come last. Points are distributed to parcels by the leading bits of their keys, on all
    /// threads, and the parcels are sorted, which keeps each thread in its cache.
    pub(super) fn sorted(&self, points: &[Vec3]) -> Vec<(u64, u32)> {
        let parcels = 1 << PARCEL_BITS;
        let parcel = |key: u64| {
            if key == Self::NOWHERE {
                parcels
            } else {
                (key >> self.used_bits.saturating_sub(PARCEL_BITS)) as usize
            }
        };
        let distributed: Vec<Distributed> = points
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(chunk, points)| {
                let first = (chunk * CHUNK) as u32;
                let keys: Vec<u64> = points
                    .iter()
                    .map(|point| self.key_or_nowhere(point))
                    .collect();
                let mut ends = vec![0u32; parcels + 1];
                for &key in &keys {
                    ends[parcel(key)] += 1;
                }
                let mut end = 0;
                for count in &mut ends {
                    let start = end;
                    end += *count;
                    *count = start;
                }
                let mut sorted = vec![(0, 0); keys.len()];
                for (&key, index) in keys.iter().zip(first..) {
                    let place = &mut ends[parcel(key)];
                    sorted[*place as usize] = (key, index);
                    *place += 1;
                }
                Distributed {
                    keyed: sorted,
                    ends,
                }
            })
            .collect();
        let sorted: Vec<Vec<(u64, u32)>> = (0..=parcels)
            .into_par_iter()
            .map(|parcel| {
                let mut keyed: Vec<(u64, u32)> = Vec::new();
                for Distributed {
                    keyed: sorted,
                    ends,
                } in &distributed
                {
                    let start = parcel.checked_sub(1).map_or(0, |before| ends[before]);
                    keyed.extend(&sorted[start as usize..ends[parcel] as usize]);
                }
                if keyed.len() > CHUNK {
                    keyed.par_sort_unstable();
                } else {
                    keyed.sort_unstable();
                }
                keyed
            })
            .collect();
        sorted.concat()
    }

    #[inline(always)]
    fn key_or_nowhere(&self, point: &Vec3) -> u64 {
        if is_finite(point) {
            self.key(point)
        } else {
            Self::NOWHERE
        }
    }

    /// Column, row and layer of the cell of `point`; for points outside the nearest cell, for a
    /// grid without extent the first.
    #[inline(always)]
    fn cell(&self, point: &Vec3) -> [u32; 3] {
        // `as` converts NaN (0 · ∞) to 0.
        let at = |axis: usize| ((point[axis] - self.low[axis]) * self.cells_per_m) as u32;
        [at(0), at(1), at(2)].map(|cell| cell.min((1 << BITS) - 1))
    }

    /// The key of `point`, below 2⁶³.
    #[inline(always)]
    pub(super) fn key(&self, point: &Vec3) -> u64 {
        let [x, y, z] = self.cell(point).map(spread);
        x | y << 1 | z << 2
    }

    /// The grid inside the cell of `point`, 2²¹ times finer; `None` if it would be finer than the
    /// 53 bits of a coordinate.
    pub(super) fn inside(&self, point: &Vec3) -> Option<Self> {
        let cell = self.cell(point);
        (self.depth != LAST && self.depth != 2 * LAST + 1).then(|| Self {
            low: Vec3::from_fn(|axis, _| self.low[axis] + f64::from(cell[axis]) / self.cells_per_m),
            cells_per_m: self.cells_per_m * CELLS,
            depth: self.depth + 1,
            used_bits: 3 * BITS,
        })
    }

    /// The grid over only those points that the last grid leaves in one cell, between `low` and
    /// `high`: a single point far away makes the cells too large for all others. `None` if the
    /// points coincide, and for the second call.
    pub(super) fn around(&self, low: &Vec3, high: &Vec3) -> Option<Self> {
        (self.depth == LAST && low != high).then(|| Self {
            depth: LAST + 1,
            ..Self::over(low, high)
        })
    }
}

/// Depth of the finest grid.
const LAST: u32 = 2;

/// The points of a chunk by parcel.
struct Distributed {
    /// Keys and indices.
    keyed: Vec<(u64, u32)>,
    /// The end of each parcel.
    ends: Vec<u32>,
}

/// Inserts two zeros before each of the 21 low bits.
#[inline(always)]
fn spread(cell: u32) -> u64 {
    let mut x = u64::from(cell);
    x = (x | x << 32) & 0x001F_0000_0000_FFFF;
    x = (x | x << 16) & 0x001F_0000_FF00_00FF;
    x = (x | x << 8) & 0x100F_00F0_0F00_F00F;
    x = (x | x << 4) & 0x10C3_0C30_C30C_30C3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_interleave_the_bits_of_column_row_and_layer() {
        let grid = Grid::over(&Vec3::zeros(), &Vec3::repeat(CELLS));
        let slow = |cell: [u32; 3]| {
            (0..BITS).fold(0u64, |key, bit| {
                (0..3).fold(key, |key, axis| {
                    key | u64::from(cell[axis] >> bit & 1) << (3 * bit + axis as u32)
                })
            })
        };
        for cell in [
            [0, 0, 0],
            [1, 2, 4],
            [0x1F_FFFF, 0, 0x15_5555],
            [1_234_567, 765_432, 2_000_000],
        ] {
            let centre = Vec3::from_fn(|axis, _| f64::from(cell[axis]) + 0.5);
            assert_eq!(grid.key(&centre), slow(cell), "{cell:?}");
        }
    }

    #[test]
    fn a_finer_grid_separates_points_of_one_cell() {
        let grid = Grid::over(&Vec3::zeros(), &Vec3::repeat(1e7));
        let (a, b) = (Vec3::new(3.0, 1.0, 2.0), Vec3::new(3.001, 1.0, 2.0));
        assert_eq!(grid.key(&a), grid.key(&b));
        let finer = grid.inside(&a).unwrap();
        assert!(finer.key(&a) < finer.key(&b));
    }
}
