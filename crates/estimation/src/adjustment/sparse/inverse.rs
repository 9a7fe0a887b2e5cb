//! The entries of H⁻¹ where L has entries.

use super::structure::Structure;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{
    self, BlockStructure::Rectangular, BlockStructure::TriangularLower,
    BlockStructure::TriangularUpper,
};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;
use std::ops::Range;
use std::sync::Arc;

/// H⁻¹ where L has entries: the covariances of all blocks that are coupled, and of some more.
#[derive(Debug, Clone)]
pub struct SelectedInverse {
    structure: Arc<Structure>,
    /// Stored like L, supernode by supernode, but with full diagonal parts.
    values: Vec<f64>,
    /// Whether a supernode was computed, because it or one that depends on it was requested; the others have no
    /// values.
    is_computed: Vec<bool>,
}

impl SelectedInverse {
    /// The recursion of Takahashi, Fagan & Chen (1973) on supernodes from the last to the first, restricted to the
    /// supernodes of requested blocks and those on which they depend.
    pub(super) fn new(
        structure: &Arc<Structure>,
        l: &[f64],
        is_requested: &dyn Fn(usize) -> bool,
    ) -> Self {
        let mut inverse = Self {
            structure: Arc::clone(structure),
            values: vec![0.0; l.len()],
            is_computed: needed(structure, is_requested),
        };
        let mut separator = Vec::new();
        let mut workspace = Vec::new();
        let supernodes = (0..structure.l.n_supernodes()).rev();
        let computed: Vec<usize> = supernodes.filter(|&s| inverse.is_computed[s]).collect();
        for supernode in computed {
            let range = structure.values(supernode);
            let pivots = structure.pivots(supernode).len();
            let height = range.len() / pivots;
            let others = height - pivots;
            separator.resize(separator.len().max(others * others), 0.0);
            let separator = &mut separator[..others * others];
            inverse.gather(supernode, separator);
            workspace.resize(workspace.len().max(range.len()), 0.0);
            invert_supernode(
                MatRef::from_column_major_slice(&l[range.clone()], height, pivots),
                MatRef::from_column_major_slice(separator, others, others),
                MatMut::from_column_major_slice_mut(&mut workspace[..range.len()], height, pivots),
                MatMut::from_column_major_slice_mut(&mut inverse.values[range], height, pivots),
            );
        }
        inverse
    }

    /// Gathers Z_II of a supernode from the supernodes that eliminate I: each of them contains the rows of I
    /// from its own pivots on.
    fn gather(&self, supernode: usize, separator: &mut [f64]) {
        let structure = &*self.structure;
        let own_pivots = structure.pivots(supernode);
        let (front, front_row) = structure.front(supernode);
        let first_other = structure.count_before(front, own_pivots.end);
        let (front, front_row) = (&front[first_other..], &front_row[first_other..]);
        let height = structure.values(supernode).len() / own_pivots.len() - own_pivots.len();
        let place = |i: usize| front_row[i] as usize - own_pivots.len();
        let mut runs = Vec::new();
        let mut first = 0;
        while first < front.len() {
            let ancestor = structure.supernode[front[first] as usize];
            let range = structure.values(ancestor);
            let pivots = structure.pivots(ancestor);
            let stride = range.len() / pivots.len();
            let values = &self.values[range];
            self.runs(ancestor, &front[first..], &mut runs);
            let end = first + structure.count_before(&front[first..], pivots.end);
            for (i, &position) in front.iter().enumerate().take(end).skip(first) {
                let column = structure.start[position as usize] - pivots.start;
                for c in 0..structure.size(position as usize) {
                    let from = &values[(column + c) * stride..][..stride];
                    let mut to = (place(i) + c) * height + place(first);
                    for run in &runs {
                        separator[to..to + run.len()].copy_from_slice(&from[run.clone()]);
                        to += run.len();
                    }
                }
            }
            first = end;
        }
        mirror(separator, height);
    }

    /// The rows of an ancestor's supernode that belong to these positions, which must all be among its rows.
    fn runs(&self, ancestor: usize, positions: &[u32], runs: &mut Vec<Range<usize>>) {
        let structure = &*self.structure;
        let (there, there_row) = structure.front(ancestor);
        runs.clear();
        let mut at = 0;
        for &position in positions {
            while there[at] != position {
                at += 1;
            }
            let row = there_row[at] as usize;
            let end = row + structure.size(position as usize);
            match runs.last_mut() {
                Some(run) if run.end == row => run.end = end,
                _ => runs.push(row..end),
            }
        }
    }

    /// The covariance of block a with block b; `None` if L has no entries for the pair, or if neither was
    /// requested.
    pub fn block(&self, a: usize, b: usize) -> Option<DMatrix<f64>> {
        let structure = &*self.structure;
        let (p, q) = (structure.position[a], structure.position[b]);
        let (column, row) = (p.min(q), p.max(q));
        let supernode = structure.supernode[column];
        if !self.is_computed[supernode] {
            return None;
        }
        let (front, front_row) = structure.front(supernode);
        let at = front.binary_search(&(row as u32)).ok()?;
        let range = structure.values(supernode);
        let pivots = structure.pivots(supernode);
        let height = range.len() / pivots.len();
        let values = &self.values[range];
        let first_row = front_row[at] as usize;
        let first_column = structure.start[column] - pivots.start;
        let entry = |i: usize, j: usize| values[(first_column + j) * height + first_row + i];
        let (rows, columns) = (structure.sizes[a], structure.sizes[b]);
        Some(DMatrix::from_fn(rows, columns, |i, j| {
            if p < q { entry(j, i) } else { entry(i, j) }
        }))
    }
}

/// Marks the supernodes of the requested blocks, and those on which they depend: the supernodes of their rows.
fn needed(structure: &Structure, is_requested: &dyn Fn(usize) -> bool) -> Vec<bool> {
    let mut needed = vec![false; structure.l.n_supernodes()];
    for (position, &block) in structure.order.iter().enumerate() {
        needed[structure.supernode[position]] |= is_requested(block);
    }
    for supernode in 0..needed.len() {
        if needed[supernode] {
            let (front, _) = structure.front(supernode);
            for &position in front {
                needed[structure.supernode[position as usize]] = true;
            }
        }
    }
    needed
}

/// The columns Z of the inverse for a supernode L. With J its own unknowns, I its other rows and
/// Y = L_IJ L_JJ⁻¹, Z_IJ = −Z_II Y and Z_JJ = L_JJ⁻ᵀ L_JJ⁻¹ − Yᵀ Z_IJ; Z_II is the `separator`.
fn invert_supernode(
    l: MatRef<'_, f64>,
    separator: MatRef<'_, f64>,
    workspace: MatMut<'_, f64>,
    z: MatMut<'_, f64>,
) {
    let (seq, pivots) = (Par::Seq, l.ncols());
    let (l_own, l_others) = l.split_at_row(pivots);
    let (mut l_inverse, mut y) = workspace.split_at_row_mut(pivots);
    let (mut z_own, mut z_others) = z.split_at_row_mut(pivots);
    y.copy_from(l_others);
    solve_upper_triangular_in_place(l_own.transpose(), y.rb_mut().transpose_mut(), seq);
    invert_lower_triangular(l_inverse.rb_mut(), l_own, seq);
    let (l_inverse, y) = (l_inverse.rb(), y.rb());
    matmul(&mut z_others, Accum::Replace, separator, y, -1.0, seq);
    let mut lower = |accum, (a, of_a), (b, of_b), factor| {
        let whole = TriangularLower;
        triangular::matmul(&mut z_own, whole, accum, a, of_a, b, of_b, factor, seq);
    };
    let inverse = (l_inverse.transpose(), TriangularUpper);
    lower(Accum::Replace, inverse, (l_inverse, TriangularLower), 1.0);
    let by_others = (y.transpose(), Rectangular);
    lower(Accum::Add, by_others, (z_others.rb(), Rectangular), -1.0);
    for j in 0..pivots {
        for i in 0..j {
            z_own[(i, j)] = z_own[(j, i)];
        }
    }
}

/// Copies the lower triangle of a square matrix to its upper one, in tiles that fit into the cache.
fn mirror(matrix: &mut [f64], order: usize) {
    const TILE: usize = 16;
    for left in (0..order).step_by(TILE) {
        for top in (left..order).step_by(TILE) {
            for j in left..(left + TILE).min(order) {
                for i in top.max(j + 1)..(top + TILE).min(order) {
                    matrix[i * order + j] = matrix[j * order + i];
                }
            }
        }
    }
}
