//! Points sorted into the cells of a cubic lattice that is fixed in space.
//!
//! Four cells along each axis form a block. Points are stored block by block, within a block cell
//! by cell, within a cell in the order of the cloud: the points in a region, and their order, do
//! not depend on points elsewhere. A search that reaches at most one block from its query needs the
//! query's block and the 26 around it.

use crate::cloud::voxel::{VoxelKey, VoxelMap};
use crate::geometry::Vec3;

/// Cells along a block's edge.
pub(super) const SIDE: i64 = 4;

/// Bits of a position in a block, per axis.
const BITS: u32 = SIDE.trailing_zeros();

/// Cells of a block.
const CELLS: usize = (SIDE * SIDE * SIDE) as usize;

/// Coordinates beyond this many blocks from the origin are too coarse to be sorted into cells: with
/// a block of a centimetre, twenty times the distance to the moon.
const FARTHEST: f64 = 1e12;

/// The cubic lattice of cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lattice {
    /// Edge of a cell, metres.
    pub(super) cell_m: f64,
    per_metre: f64,
    farthest_m: f64,
}

impl Lattice {
    /// A lattice for searches that reach up to `reach_m` from their queries.
    pub(super) fn reaching(reach_m: f64) -> Self {
        // The margin keeps points that rounding moves into the next cell within the next block.
        let block_m = 1.001 * reach_m;
        let cell_m = block_m / SIDE as f64;
        let per_metre = 1.0 / cell_m;
        Self {
            cell_m,
            per_metre,
            // Cells too small to be counted hold nothing.
            farthest_m: if per_metre.is_finite() {
                FARTHEST * block_m
            } else {
                0.0
            },
        }
    }

    /// Whether `point` is finite and near enough to have a cell.
    pub(super) fn covers(&self, point: &Vec3) -> bool {
        // False for NaN.
        point.iter().all(|x| x.abs() < self.farthest_m)
    }

    /// Column, row and layer of the cell of a point that the lattice covers.
    #[inline]
    pub(super) fn cell(&self, point: &Vec3) -> VoxelKey {
        [point.x, point.y, point.z].map(|x| self.index(x))
    }

    /// Index of the interval that contains `x`, along any axis.
    #[inline]
    pub(super) fn index(&self, x: f64) -> i64 {
        let scaled = x * self.per_metre;
        let truncated = scaled as i64;
        truncated - i64::from(scaled < truncated as f64)
    }

    /// Lower end of interval `index`, metres.
    #[inline]
    pub(super) fn low(&self, index: i64) -> f64 {
        index as f64 * self.cell_m
    }

    /// Upper bound on the rounding error of a cell's border at coordinates like those of `point`,
    /// metres.
    #[inline]
    pub(super) fn rounding(&self, point: &Vec3) -> f64 {
        1e-15 * point.amax() + 1e-12 * self.cell_m
    }
}

/// The block of a cell.
#[inline]
pub(super) fn block_of(cell: VoxelKey) -> VoxelKey {
    cell.map(|index| index >> BITS)
}

/// Index of a cell in its block: layer, row and column, the last varies fastest.
#[inline]
fn place_of(cell: VoxelKey) -> u16 {
    let [x, y, z] = cell.map(|index| (index & (SIDE - 1)) as u16);
    (z << (2 * BITS)) | (y << BITS) | x
}

/// A run of points in one cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    /// Column, row and layer of the cell in its block.
    pub(super) place: [usize; 3],
    pub(super) first: u32,
    pub(super) count: u32,
}

/// The points of a cloud, sorted by block and cell.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    pub(super) lattice: Lattice,
    /// The range of the occupied cells of each block: first, and one after the last.
    blocks: VoxelMap<VoxelKey, (u32, u32)>,
    /// The occupied cells: index in the block and first point; at the end one more.
    occupied: Vec<(u16, u32)>,
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) z: Vec<f64>,
}

impl Cells {
    /// Sorts `points`; those outside the lattice are left out.
    ///
    /// # Panics
    /// With more than 2³² points, which would occupy 100 GB.
    pub(super) fn new(points: &[Vec3], lattice: Lattice) -> Self {
        assert!(
            u32::try_from(points.len()).is_ok(),
            "more points than u32 can count"
        );
        // The block of each point, numbered in order of appearance, and the cell in it.
        let mut numbers: VoxelMap<VoxelKey, u32> = VoxelMap::default();
        let mut counts: Vec<u32> = Vec::new();
        let mut last = ([i64::MAX; 3], 0);
        let mut block_and_place: Vec<(u32, u16)> = Vec::with_capacity(points.len());
        for point in points {
            if !lattice.covers(point) {
                block_and_place.push((u32::MAX, 0));
                continue;
            }
            let cell = lattice.cell(point);
            let key = block_of(cell);
            if key != last.0 {
                let next = counts.len() as u32;
                let number = *numbers.entry(key).or_insert(next);
                if number == next {
                    counts.push(0);
                }
                last = (key, number);
            }
            counts[last.1 as usize] += 1;
            block_and_place.push((last.1, place_of(cell)));
        }
        // First the start, then the end of each block.
        let mut ends: Vec<u32> = counts
            .iter()
            .scan(0, |sum, count| {
                let begin = *sum;
                *sum += count;
                Some(begin)
            })
            .collect();
        let total = counts.iter().map(|&count| count as usize).sum();
        let mut in_blocks = vec![(0u32, 0u16); total];
        for (&(number, place), index) in block_and_place.iter().zip(0u32..) {
            if number != u32::MAX {
                let end = &mut ends[number as usize];
                in_blocks[*end as usize] = (index, place);
                *end += 1;
            }
        }
        drop(block_and_place);
        let mut cells = Self {
            lattice,
            blocks: VoxelMap::default(),
            occupied: Vec::new(),
            x: Vec::with_capacity(total),
            y: Vec::with_capacity(total),
            z: Vec::with_capacity(total),
        };
        let mut sorted = Vec::new();
        let mut cell_ranges = Vec::with_capacity(counts.len());
        for (&end, &count) in ends.iter().zip(&counts) {
            sort_by_place(
                &in_blocks[(end - count) as usize..end as usize],
                &mut sorted,
            );
            let first = cells.occupied.len() as u32;
            let mut before = u16::MAX;
            for &(index, place) in &sorted {
                if place != before {
                    cells.occupied.push((place, cells.x.len() as u32));
                    before = place;
                }
                let point = &points[index as usize];
                cells.x.push(point.x);
                cells.y.push(point.y);
                cells.z.push(point.z);
            }
            cell_ranges.push((first, cells.occupied.len() as u32));
        }
        cells.occupied.push((0, total as u32));
        cells.blocks = numbers
            .into_iter()
            .map(|(key, number)| (key, cell_ranges[number as usize]))
            .collect();
        cells
    }

    /// Calls `each` with the points of a block, cell by cell.
    pub(super) fn runs(&self, block: VoxelKey, mut each: impl FnMut(Run)) {
        let Some(&(begin, end)) = self.blocks.get(&block) else {
            return;
        };
        for pair in self.occupied[begin as usize..=end as usize].windows(2) {
            let (place, first) = pair[0];
            let digit = |axis: u32| usize::from(place >> (axis * BITS)) & (SIDE as usize - 1);
            each(Run {
                place: [digit(0), digit(1), digit(2)],
                first,
                count: pair[1].1 - first,
            });
        }
    }
}

/// Replaces `sorted` by `points` in ascending order of cells; points of one cell keep their order.
fn sort_by_place(points: &[(u32, u16)], sorted: &mut Vec<(u32, u16)>) {
    sorted.clear();
    if points.len() < 24 {
        sorted.extend_from_slice(points);
        sorted.sort_by_key(|(_, place)| *place);
        return;
    }
    let mut begins = [0u32; CELLS + 1];
    for (_, place) in points {
        begins[usize::from(*place) + 1] += 1;
    }
    for i in 0..CELLS {
        begins[i + 1] += begins[i];
    }
    sorted.resize(points.len(), (0, 0));
    for point in points {
        let begin = &mut begins[usize::from(point.1)];
        sorted[*begin as usize] = *point;
        *begin += 1;
    }
}
