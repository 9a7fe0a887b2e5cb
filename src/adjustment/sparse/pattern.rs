//! Which blocks of unknowns are coupled, and the order that eliminates them with little fill.

use super::structure::Structure;
use super::system::SparseSystem;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

/// Collects which blocks of unknowns are coupled.
#[derive(Debug, Clone)]
pub struct BlockPattern {
    sizes: Vec<usize>,
    /// The coupled sets, one after the other, each ascending and without repetition.
    members: Vec<u32>,
    /// Where each set ends in `members`.
    ends: Vec<usize>,
    sorted: Vec<u32>,
}

impl BlockPattern {
    /// Blocks of these sizes, none coupled yet.
    ///
    /// # Panics
    /// If a block is empty or larger than 65535.
    pub fn new(sizes: Vec<usize>) -> Self {
        assert!(
            sizes.iter().all(|&size| (1..=0xffff).contains(&size)),
            "blocks of 1 to 65535 unknowns"
        );
        Self {
            sizes,
            members: Vec::new(),
            ends: Vec::new(),
            sorted: Vec::new(),
        }
    }

    /// Couples every pair of these blocks: a factor depends on all of them. In any order; a block
    /// may be named twice.
    pub fn couple(&mut self, blocks: &[usize]) {
        self.sorted.clear();
        self.sorted.extend(blocks.iter().map(|&b| b as u32));
        self.sorted.sort_unstable();
        self.sorted.dedup();
        let last = self.sorted.last().map_or(0, |&b| b as usize);
        assert!(
            blocks.is_empty() || last < self.sizes.len(),
            "no such block"
        );
        // Factors that follow each other often touch the same blocks.
        let start = self.ends.len().checked_sub(2).map_or(0, |i| self.ends[i]);
        if self.sorted.len() > 1 && self.members[start..] != self.sorted[..] {
            self.members.extend_from_slice(&self.sorted);
            self.ends.push(self.members.len());
        }
    }

    /// Finds the order of elimination and the pattern of L. Blocks from index `last` on are
    /// eliminated after all others, in the order given: unknowns that couple with nearly
    /// everything.
    ///
    /// # Panics
    /// If H would have 2³² entries or L 2³¹.
    pub fn analyse(self, last: usize) -> SparseSystem {
        let later = self.later_blocks();
        let mut order = fill_reducing_order(&later, &self.sizes[..last.min(self.sizes.len())]);
        order.extend(last..self.sizes.len());
        SparseSystem::new(Structure::new(self.sizes, order, &later))
    }

    /// For each block the coupled blocks of higher index, ascending.
    fn later_blocks(&self) -> Vec<Vec<u32>> {
        let blocks = self.sizes.len();
        let mut sets_of = vec![Vec::new(); blocks];
        let mut start = 0;
        for &end in &self.ends {
            for (at, &block) in (start..end).zip(&self.members[start..end]) {
                sets_of[block as usize].push((at + 1, end));
            }
            start = end;
        }
        // The last block that each block was listed for, plus one.
        let mut listed = vec![0; blocks];
        sets_of
            .iter()
            .enumerate()
            .map(|(block, sets)| {
                let mut later = Vec::new();
                for &(start, end) in sets {
                    // Soon so of the last blocks, which are in most of the sets.
                    if later.len() == blocks - 1 - block {
                        break;
                    }
                    for &other in &self.members[start..end] {
                        if listed[other as usize] != block + 1 {
                            listed[other as usize] = block + 1;
                            later.push(other);
                        }
                    }
                }
                later.sort_unstable();
                later
            })
            .collect()
    }
}

/// Unknowns that count as one in the order of elimination: a surfel has three, a pose fifteen.
const UNKNOWNS_PER_NODE: usize = 3;

/// Approximate minimum degree (Amestoy, Davis & Duff 1996) of the blocks of these sizes. What
/// couples with everything does not change the order of the others. A block stands for as many nodes as it is
/// large, coupled with each other and with the same others: a surfel that couples two poses fills far more than
/// one that couples two surfels.
fn fill_reducing_order(later: &[Vec<u32>], sizes: &[usize]) -> Vec<usize> {
    let last = sizes.len();
    let nodes = |block: usize| sizes[block].div_ceil(UNKNOWNS_PER_NODE);
    let mut first = vec![0u32; last + 1];
    for block in 0..last {
        first[block + 1] = first[block] + nodes(block) as u32;
    }
    let total = first[last] as usize;
    let (mut ends, mut rows) = (vec![0u32], Vec::new());
    let mut owner = Vec::with_capacity(total);
    for (block, later) in later[..last].iter().enumerate() {
        let before = later.partition_point(|&b| (b as usize) < last);
        for node in first[block]..first[block + 1] {
            rows.extend(node + 1..first[block + 1]);
            for &other in &later[..before] {
                rows.extend(first[other as usize]..first[other as usize + 1]);
            }
            ends.push(rows.len() as u32);
            owner.push(block);
        }
    }
    let graph = SymbolicSparseColMatRef::new_checked(total, total, &ends, None, &rows);
    let mut order = vec![0; total];
    let mut position = vec![0; total];
    let scratch = amd::order_scratch::<u32>(total, rows.len());
    amd::order(
        &mut order,
        &mut position,
        graph,
        amd::Control::default(),
        MemStack::new(&mut MemBuffer::new(scratch)),
    )
    .expect("fewer than 2³¹ pairs of blocks");
    let mut is_listed = vec![false; last];
    let blocks = order.into_iter().map(|node| owner[node as usize]);
    blocks
        .filter(|block| !std::mem::replace(&mut is_listed[*block], true))
        .collect()
}
