//! The symbolic analysis: the storage of the blocks of H, and the pattern of L.

use super::lists::{Lists, sums};
use super::supernodes::Supernodes;
use std::ops::Range;

/// A pivot that is not positive or not finite: data and priors do not determine an unknown of this block
/// (the caller's index), given the blocks that are eliminated before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotPositiveBlock(pub usize);

/// Order, storage of H and pattern of L. A position is a block's place in the order of
/// elimination.
#[derive(Debug)]
pub struct Structure {
    pub sizes: Vec<usize>,
    /// First scalar of each block in the caller's order, and the number of scalars.
    pub offset: Vec<usize>,
    /// The caller's block at each position.
    pub order: Vec<usize>,
    /// The position of each of the caller's blocks.
    pub position: Vec<usize>,
    /// First scalar of each position in the order of elimination, and the number of scalars.
    pub start: Vec<usize>,
    /// The place of each scalar, in the caller's order, in the order of elimination.
    pub place: Vec<usize>,
    /// Positions coupled with each position, from itself on, ascending.
    rows: Lists<u32>,
    /// For each of `rows`, its first row in the columns of H; then the number of rows.
    first_row: Lists<u32>,
    /// For each position, where its columns begin in H, full diagonal blocks and the blocks below them; then the number
    /// of entries.
    base: Vec<usize>,
    pub l: Supernodes,
}

impl Structure {
    /// The structure for an order of elimination; `later` lists for each block the coupled blocks of higher
    /// index.
    pub fn new(sizes: Vec<usize>, order: Vec<usize>, later: &[Vec<u32>]) -> Self {
        let blocks = sizes.len();
        let mut position = vec![0; blocks];
        for (at, &block) in order.iter().enumerate() {
            position[block] = at;
        }
        let offset = sums(sizes.iter().copied());
        let start = sums(order.iter().map(|&block| sizes[block]));
        let place = (0..blocks)
            .flat_map(|block| (0..sizes[block]).map(move |i| (block, i)))
            .map(|(block, i)| start[position[block]] + i)
            .collect();
        let rows = coupled_positions(&position, later);
        let (base, first_row) = columns(&rows, &start);
        let l = Supernodes::new(&rows, &start);
        Self {
            sizes,
            offset,
            order,
            position,
            start,
            place,
            rows,
            first_row,
            base,
            l,
        }
    }

    /// Number of scalars.
    pub fn unknowns(&self) -> usize {
        self.place.len()
    }

    /// The scalars of a position in the order of elimination.
    pub fn scalars(&self, position: usize) -> Range<usize> {
        self.start[position]..self.start[position + 1]
    }

    /// Number of scalars of a position.
    pub fn size(&self, position: usize) -> usize {
        self.scalars(position).len()
    }

    /// Where H stores the first entry of this pair of positions, and the distance between columns;
    /// `None` if they are not coupled.
    pub fn entry(&self, row: usize, column: usize) -> Option<(usize, usize)> {
        let at = self.rows.get(column).binary_search(&(row as u32)).ok()?;
        let first_row = self.first_row.get(column)[at] as usize;
        Some((self.base[column] + first_row, self.height(column)))
    }

    /// Number of rows stored in the columns of a position.
    pub fn height(&self, position: usize) -> usize {
        self.first_row.get(position)[self.rows.get(position).len()] as usize
    }

    /// Number of entries that H stores.
    pub fn entries(&self) -> usize {
        self.base[self.base.len() - 1]
    }

    /// Positions coupled with a position, from itself on, ascending: the rows of its columns in H.
    pub fn coupled(&self, position: usize) -> &[u32] {
        self.rows.get(position)
    }

    /// Where H stores the columns of a position.
    pub fn columns(&self, position: usize) -> Range<usize> {
        self.base[position]..self.base[position + 1]
    }

    /// Where H stores its diagonal, in the caller's order.
    pub fn diagonal(&self) -> impl Iterator<Item = usize> {
        self.position.iter().flat_map(|&position| {
            let (base, height) = (self.base[position], self.height(position));
            (0..self.size(position)).map(move |i| base + i * (height + 1))
        })
    }

    /// Number of these positions (ascending) that come before this scalar.
    pub fn count_before(&self, positions: &[u32], scalar: usize) -> usize {
        positions.partition_point(|&position| self.start[position as usize] < scalar)
    }

    /// The scalars of each position in the rows of a supernode below its own, and their first row below its own.
    pub fn rows_below(&self, supernode: usize) -> impl Iterator<Item = (Range<usize>, usize)> {
        let pivots = self.l.pivots(supernode);
        let (front, rows) = self.l.front(supernode);
        let all = front.iter().zip(rows);
        all.filter_map(move |(&position, &row)| {
            let scalars = self.scalars(position as usize);
            (scalars.start >= pivots.end).then(|| (scalars, row as usize - pivots.len()))
        })
    }

    /// The caller's block of a scalar in the order of elimination.
    pub fn block_of(&self, scalar: usize) -> usize {
        self.order[self.start.partition_point(|&start| start <= scalar) - 1]
    }
}

fn coupled_positions(position: &[usize], later: &[Vec<u32>]) -> Lists<u32> {
    let mut rows: Vec<_> = (0..position.len()).map(|at| vec![at as u32]).collect();
    for (block, later) in later.iter().enumerate() {
        for &coupled in later {
            let (a, b) = (position[block], position[coupled as usize]);
            rows[a.min(b)].push(a.max(b) as u32);
        }
    }
    for list in &mut rows {
        list.sort_unstable();
    }
    rows.into_iter().collect()
}

/// Where the columns of each position begin in H, then the number of entries; and the first row of each coupled position
/// in them, then the number of rows.
fn columns(rows: &Lists<u32>, start: &[usize]) -> (Vec<usize>, Lists<u32>) {
    let size = |position: usize| start[position + 1] - start[position];
    let first_row = (0..rows.count()).map(|position| {
        let sizes = rows.get(position).iter().map(|&row| size(row as usize));
        sums(sizes).into_iter().map(|row| row as u32).collect()
    });
    let first_row: Lists<u32> = first_row.collect();
    let height = |position: usize| {
        first_row
            .get(position)
            .last()
            .map_or(0, |&rows| rows as usize)
    };
    let base = sums((0..rows.count()).map(|position| size(position) * height(position)));
    assert!(
        u32::try_from(base[rows.count()]).is_ok(),
        "H of less than 2³² entries"
    );
    (base, first_row)
}
