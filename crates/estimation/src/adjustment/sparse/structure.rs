//! The symbolic analysis: the storage of the blocks of H, and the pattern of L.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::sparse::linalg::SymbolicSupernodalParams;
use faer::sparse::linalg::cholesky::simplicial::{
    prefactorize_symbolic_cholesky, prefactorize_symbolic_cholesky_scratch,
};
use faer::sparse::linalg::cholesky::supernodal::{
    SymbolicSupernodalCholesky, factorize_supernodal_numeric_llt_scratch,
    factorize_supernodal_symbolic_cholesky, factorize_supernodal_symbolic_cholesky_scratch,
};
use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};
use faer::{Par, Spec};
use std::ops::Range;

/// Lists of different lengths, one after the other.
#[derive(Debug)]
struct Lists {
    ends: Vec<usize>,
    values: Vec<u32>,
}

impl Lists {
    fn range(&self, i: usize) -> Range<usize> {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        start..self.ends[i]
    }

    fn get(&self, i: usize) -> &[u32] {
        &self.values[self.range(i)]
    }
}

impl FromIterator<Vec<u32>> for Lists {
    fn from_iter<T: IntoIterator<Item = Vec<u32>>>(lists: T) -> Self {
        let (mut ends, mut values) = (Vec::new(), Vec::new());
        for list in lists {
            values.extend_from_slice(&list);
            ends.push(values.len());
        }
        Self { ends, values }
    }
}

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
    rows: Lists,
    /// For each of `rows`, its first row in the columns of H.
    first_row: Vec<u32>,
    /// For each position, where its columns begin in H.
    base: Vec<usize>,
    /// The pattern of H: full diagonal blocks and the blocks below them, column by column.
    pub h: SymbolicSparseColMat<u32>,
    pub l: SymbolicSupernodalCholesky<u32>,
    /// The supernode of each position.
    pub supernode: Vec<usize>,
    /// Positions in the rows of each supernode, its own first.
    front: Lists,
    /// For each of `front`, its first row in the supernode.
    front_row: Vec<u32>,
    /// Workspace of the numeric factorisation.
    pub scratch: StackReq,
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
        let (h, base, first_row) = columns(&rows, &start);
        let l = pattern_of_factor(&rows, &start);
        let (supernode, front, front_row) = fronts(&l, &start);
        let scratch =
            factorize_supernodal_numeric_llt_scratch::<u32, f64>(&l, Par::Seq, Spec::default());
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
            h,
            l,
            supernode,
            front,
            front_row,
            scratch,
        }
    }

    /// Number of scalars.
    pub fn unknowns(&self) -> usize {
        self.place.len()
    }

    /// Number of scalars of a position.
    pub fn size(&self, position: usize) -> usize {
        self.start[position + 1] - self.start[position]
    }

    /// Where H stores the first entry of this pair of positions, and the distance between columns;
    /// `None` if they are not coupled.
    pub fn entry(&self, row: usize, column: usize) -> Option<(usize, usize)> {
        let at = self.rows.get(column).binary_search(&(row as u32)).ok()?;
        let first_row = self.first_row[self.rows.range(column).start + at];
        Some((self.base[column] + first_row as usize, self.height(column)))
    }

    /// Number of rows stored in the columns of a position.
    pub fn height(&self, position: usize) -> usize {
        let column = self.start[position];
        let ends = self.h.col_ptr();
        (ends[column + 1] - ends[column]) as usize
    }

    /// Where H stores its diagonal, in the caller's order.
    pub fn diagonal(&self) -> impl Iterator<Item = usize> {
        self.position.iter().flat_map(|&position| {
            let (base, height) = (self.base[position], self.height(position));
            (0..self.size(position)).map(move |i| base + i * (height + 1))
        })
    }

    /// Positions in the rows of a supernode, ascending, and their first rows in it.
    pub fn front(&self, supernode: usize) -> (&[u32], &[u32]) {
        let range = self.front.range(supernode);
        (&self.front.values[range.clone()], &self.front_row[range])
    }

    /// Number of these positions (ascending) that come before this scalar.
    pub fn count_before(&self, positions: &[u32], scalar: usize) -> usize {
        positions.partition_point(|&position| self.start[position as usize] < scalar)
    }

    /// The scalars that a supernode eliminates.
    pub fn pivots(&self, supernode: usize) -> Range<usize> {
        pivots(&self.l, supernode)
    }

    /// Where L stores the values of a supernode.
    pub fn values(&self, supernode: usize) -> Range<usize> {
        let ends = self.l.col_ptr_for_val();
        ends[supernode] as usize..ends[supernode + 1] as usize
    }

    /// The caller's block of a scalar in the order of elimination.
    pub fn block_of(&self, scalar: usize) -> usize {
        self.order[self.start.partition_point(|&start| start <= scalar) - 1]
    }
}

/// The scalars that a supernode eliminates.
fn pivots(l: &SymbolicSupernodalCholesky<u32>, supernode: usize) -> Range<usize> {
    l.supernode_begin()[supernode] as usize..l.supernode_end()[supernode] as usize
}

/// Sums of the first 0, 1, … values.
fn sums(values: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sum = 0;
    let ends = values.map(|value| {
        sum += value;
        sum
    });
    [0].into_iter().chain(ends).collect()
}

fn coupled_positions(position: &[usize], later: &[Vec<u32>]) -> Lists {
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

/// The columns of H, where those of each position begin, and the first row of each coupled
/// position in them.
fn columns(rows: &Lists, start: &[usize]) -> (SymbolicSparseColMat<u32>, Vec<usize>, Vec<u32>) {
    let unknowns = start[start.len() - 1];
    let mut ends = vec![0];
    let mut index = Vec::new();
    let mut base = Vec::new();
    let mut first_row = Vec::new();
    for position in 0..rows.ends.len() {
        base.push(index.len());
        let mut height = 0;
        for &row in rows.get(position) {
            first_row.push(height as u32);
            height += start[row as usize + 1] - start[row as usize];
        }
        for _ in start[position]..start[position + 1] {
            for &row in rows.get(position) {
                index.extend(start[row as usize] as u32..start[row as usize + 1] as u32);
            }
            ends.push(index.len() as u32);
        }
    }
    assert!(
        u32::try_from(index.len()).is_ok(),
        "H of less than 2³² entries"
    );
    let h = SymbolicSparseColMat::new_checked(unknowns, unknowns, ends, None, index);
    (h, base, first_row)
}

/// The supernodes of L and their rows.
fn pattern_of_factor(rows: &Lists, start: &[usize]) -> SymbolicSupernodalCholesky<u32> {
    let unknowns = start[start.len() - 1];
    let mut earlier = vec![Vec::new(); rows.ends.len()];
    for (position, &scalar) in start[..rows.ends.len()].iter().enumerate() {
        for &row in rows.get(position) {
            earlier[row as usize].push(scalar as u32);
        }
    }
    // The upper triangle with the first scalar only of each coupled block, its own included:
    // eliminating that scalar couples the others of its block with everything it is coupled with.
    // L has the same pattern, and finding it takes a fraction of the time.
    let mut ends = vec![0];
    let mut index = Vec::new();
    for (position, earlier) in earlier.iter().enumerate() {
        for _ in start[position]..start[position + 1] {
            index.extend_from_slice(earlier);
            ends.push(index.len() as u32);
        }
    }
    let upper = SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &ends, None, &index);
    let mut parent = vec![0; unknowns];
    let mut count = vec![0; unknowns];
    let mut memory = MemBuffer::new(StackReq::any_of(&[
        prefactorize_symbolic_cholesky_scratch::<u32>(unknowns, index.len()),
        factorize_supernodal_symbolic_cholesky_scratch::<u32>(unknowns),
    ]));
    let stack = MemStack::new(&mut memory);
    let tree = prefactorize_symbolic_cholesky(&mut parent, &mut count, upper, stack);
    let params = SymbolicSupernodalParams::default();
    factorize_supernodal_symbolic_cholesky(upper, tree, &count, stack, params)
        .expect("L of less than 2³¹ entries")
}

/// The supernode of each position, and for each supernode the positions of its rows and their first
/// rows.
fn fronts(l: &SymbolicSupernodalCholesky<u32>, start: &[usize]) -> (Vec<usize>, Lists, Vec<u32>) {
    let unknowns = start[start.len() - 1];
    let mut position_of = vec![0; unknowns];
    for (position, range) in start.windows(2).enumerate() {
        position_of[range[0]..range[1]].fill(position);
    }
    let mut supernode_of = vec![0; start.len() - 1];
    let mut front = Vec::new();
    let mut front_row = Vec::new();
    for supernode in 0..l.n_supernodes() {
        let pivots = pivots(l, supernode);
        for &position in &position_of[pivots.clone()] {
            supernode_of[position] = supernode;
        }
        let mut positions: Vec<u32> = Vec::new();
        let rows = pivots.chain(
            l.supernode(supernode)
                .pattern()
                .iter()
                .map(|&row| row as usize),
        );
        for (row, scalar) in rows.enumerate() {
            let position = position_of[scalar];
            if scalar == start[position] {
                positions.push(position as u32);
                front_row.push(row as u32);
            }
        }
        front.push(positions);
    }
    (supernode_of, front.into_iter().collect(), front_row)
}
