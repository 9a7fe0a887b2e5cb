//! The pattern of coupled blocks of unknowns, and a fill-reducing order of elimination.

use super::dissection::nested_dissection;
use super::structure::Structure;
use super::system::SparseSystem;

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
        // Blocks that couple with everything do not change the order of the others.
        let mut order = nested_dissection(&later, &self.sizes[..last.min(self.sizes.len())]);
        order.extend(last..self.sizes.len());
        SparseSystem::new(Structure::new(self.sizes, order, &later))
    }

    /// For each block the coupled blocks of higher index, ascending.
    fn later_blocks(&self) -> Vec<Vec<u32>> {
        let blocks = self.sizes.len();
        let mut sets_by_block = vec![Vec::new(); blocks];
        let mut start = 0;
        for &end in &self.ends {
            for (at, &block) in (start..end).zip(&self.members[start..end]) {
                sets_by_block[block as usize].push((at + 1, end));
            }
            start = end;
        }
        // The last block that each block was listed for, plus one.
        let mut listed = vec![0; blocks];
        sets_by_block
            .iter()
            .enumerate()
            .map(|(block, sets)| {
                let mut later = Vec::new();
                for &(start, end) in sets {
                    // The last blocks reach this soon, because they are in most of the sets.
                    if later.len() == blocks - 1 - block {
                        break;
                    }
                    for &member in &self.members[start..end] {
                        if listed[member as usize] != block + 1 {
                            listed[member as usize] = block + 1;
                            later.push(member);
                        }
                    }
                }
                later.sort_unstable();
                later
            })
            .collect()
    }
}
