//! Core points in the same region, which need the same points of the clouds.

use std::ops::Range;

use rayon::prelude::*;

use super::cells::{Lattice, block_of};
use crate::cloud::voxel::VoxelKey;
use crate::geometry::Vec3;

/// Most core points of a group: work is distributed by groups.
const MOST: usize = 1024;

/// The core points covered by a lattice, sorted by its blocks.
pub(super) struct Groups {
    /// Indices of core points.
    order: Vec<u32>,
    groups: Vec<(VoxelKey, Range<usize>)>,
}

impl Groups {
    pub(super) fn new(core: &[Vec3], lattice: &Lattice) -> Self {
        let mut keys: Vec<(VoxelKey, u32)> = core
            .par_iter()
            .enumerate()
            .filter(|(_, point)| lattice.covers(point))
            .map(|(at, point)| {
                let [x, y, z] = block_of(lattice.cell(point));
                ([z, y, x], at as u32)
            })
            .collect();
        keys.par_sort_unstable();
        let mut groups = Vec::new();
        let mut begin = 0;
        for same in keys.chunk_by(|a, b| a.0 == b.0) {
            let [z, y, x] = same[0].0;
            for part in same.chunks(MOST) {
                groups.push(([x, y, z], begin..begin + part.len()));
                begin += part.len();
            }
        }
        Self {
            order: keys.into_iter().map(|(_, at)| at).collect(),
            groups,
        }
    }

    /// Calls `each` with every group: its block, the indices of its core points, and reusable
    /// buffers. It returns one value for each of them; core points outside the lattice get
    /// `missing`. Returns all values in the order of the core points.
    pub(super) fn map<T, Scratch>(
        &self,
        core_points: usize,
        missing: T,
        each: impl Fn(&mut Scratch, VoxelKey, &[u32]) -> Vec<T> + Sync,
    ) -> Vec<T>
    where
        T: Clone + Send,
        Scratch: Default,
    {
        let values: Vec<Vec<T>> = self
            .groups
            .par_iter()
            .map_init(Scratch::default, |scratch, (block, range)| {
                each(scratch, *block, &self.order[range.clone()])
            })
            .collect();
        let mut in_order = vec![missing; core_points];
        for (&at, value) in self.order.iter().zip(values.into_iter().flatten()) {
            in_order[at as usize] = value;
        }
        in_order
    }
}

/// The bounding box of these core points, widened by `reach_m` on all sides.
pub(super) fn box_around(core: &[Vec3], indices: &[u32], reach_m: f64) -> (Vec3, Vec3) {
    let points = indices.iter().map(|&at| core[at as usize]);
    let nothing = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    let (low, high) = points.fold(nothing, |(low, high), p| (low.inf(&p), high.sup(&p)));
    (low.add_scalar(-reach_m), high.add_scalar(reach_m))
}
