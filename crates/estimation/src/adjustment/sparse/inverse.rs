//! The entries of H⁻¹ where L has entries.

use super::dense::{Part, Shape, Target, add_product, solve_from_right};
use super::structure::Structure;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::sync::Arc;

/// H⁻¹ where L has entries: the covariances of all blocks that are coupled, and of some more.
#[derive(Debug, Clone)]
pub struct SelectedInverse {
    structure: Arc<Structure>,
    /// Stored like L, supernode by supernode, but with full diagonal parts.
    values: Vec<Vec<f64>>,
    /// Whether a supernode was computed, because it or one that depends on it was requested; the others have no
    /// values.
    is_computed: Vec<bool>,
}

impl SelectedInverse {
    /// The recursion of Takahashi, Fagan & Chen (1973) on supernodes from the last to the first, restricted to the
    /// supernodes of requested blocks and those on which they depend.
    pub(super) fn new(
        structure: &Arc<Structure>,
        l: &[Vec<f64>],
        is_requested: &dyn Fn(usize) -> bool,
    ) -> Self {
        let mut inverse = Self {
            structure: Arc::clone(structure),
            values: vec![Vec::new(); l.len()],
            is_computed: needed(structure, is_requested),
        };
        for level in structure.l.levels().iter().rev() {
            let computed = level.par_iter().filter(|&&s| inverse.is_computed[s]);
            let panels = computed.map_init(Default::default, |workspace, &supernode| {
                (
                    supernode,
                    inverse.supernode(supernode, &l[supernode], workspace),
                )
            });
            let panels: Vec<(usize, Vec<f64>)> = panels.collect();
            for (supernode, values) in panels {
                inverse.values[supernode] = values;
            }
        }
        inverse
    }

    /// The columns Z of the inverse for a supernode with the values L. With J its own unknowns, I its other rows and
    /// Y = L_IJ L_JJ⁻¹, Z_IJ = −Z_II Y and Z_JJ = L_JJ⁻ᵀ L_JJ⁻¹ − Yᵀ Z_IJ.
    fn supernode(
        &self,
        supernode: usize,
        l: &[f64],
        [separator, workspace]: &mut [Vec<f64>; 2],
    ) -> Vec<f64> {
        let of_l = &self.structure.l;
        let (height, pivots) = (of_l.height(supernode), of_l.pivots(supernode).len());
        let others = height - pivots;
        separator.resize(separator.len().max(others * others), 0.0);
        let separator = &mut separator[..others * others];
        self.gather(supernode, separator);
        // The identity above L_IJ becomes L_JJ⁻¹ above Y.
        workspace.clear();
        workspace.extend_from_slice(l);
        for (j, column) in workspace.chunks_exact_mut(height).enumerate() {
            column[..pivots].fill(0.0);
            column[j] = 1.0;
        }
        solve_from_right(workspace, height, l, height, pivots);
        let (l_inverse, y) = (
            Part::of(workspace, height),
            Part::of(&workspace[pivots..], height),
        );
        let (mut z, mut own) = (vec![0.0; l.len()], vec![0.0; pivots * pivots]);
        add_product(
            0.0,
            lower(&mut own, pivots),
            1.0,
            l_inverse.transpose(),
            l_inverse,
            pivots,
        );
        if others > 0 {
            let of_others = Target {
                data: &mut z[pivots..],
                height,
                rows: others,
                columns: pivots,
                shape: Shape::Whole,
            };
            add_product(0.0, of_others, -1.0, Part::of(separator, others), y, others);
            let z_others = Part::of(&z[pivots..], height);
            add_product(
                1.0,
                lower(&mut own, pivots),
                -1.0,
                y.transpose(),
                z_others,
                others,
            );
        }
        mirror(&mut own, pivots);
        for (z, own) in z.chunks_exact_mut(height).zip(own.chunks_exact(pivots)) {
            z[..pivots].copy_from_slice(own);
        }
        z
    }

    /// Gathers Z_II of a supernode from the supernodes that eliminate I: each of them contains the rows of I
    /// from its own pivots on.
    fn gather(&self, supernode: usize, separator: &mut [f64]) {
        let structure = &*self.structure;
        let own_pivots = structure.l.pivots(supernode);
        let (front, front_row) = structure.l.front(supernode);
        let first_other = structure.count_before(front, own_pivots.end);
        let (front, front_row) = (&front[first_other..], &front_row[first_other..]);
        let height = structure.l.height(supernode) - own_pivots.len();
        let place = |i: usize| front_row[i] as usize - own_pivots.len();
        let mut runs = Vec::new();
        let mut first = 0;
        while first < front.len() {
            let ancestor = structure.l.of(front[first] as usize);
            let (pivots, stride) = (structure.l.pivots(ancestor), structure.l.height(ancestor));
            let values = &self.values[ancestor];
            runs.clear();
            structure
                .l
                .append_runs(ancestor, &front[first..], 0, &mut runs);
            let end = first + structure.count_before(&front[first..], pivots.end);
            for (i, &position) in front.iter().enumerate().take(end).skip(first) {
                let column = structure.start[position as usize] - pivots.start;
                for c in 0..structure.size(position as usize) {
                    let from = &values[(column + c) * stride..][..stride];
                    let to = &mut separator[(place(i) + c) * height + place(first)..];
                    for run in &runs {
                        to[run.begin..run.end].copy_from_slice(&from[run.rows()]);
                    }
                }
            }
            first = end;
        }
        mirror(separator, height);
    }

    /// The covariance of block a with block b; `None` if L has no entries for the pair, or if neither was
    /// requested.
    pub fn block(&self, a: usize, b: usize) -> Option<DMatrix<f64>> {
        let structure = &*self.structure;
        let (p, q) = (structure.position[a], structure.position[b]);
        let (column, row) = (p.min(q), p.max(q));
        let supernode = structure.l.of(column);
        if !self.is_computed[supernode] {
            return None;
        }
        let (front, front_row) = structure.l.front(supernode);
        let at = front.binary_search(&(row as u32)).ok()?;
        let (pivots, height) = (structure.l.pivots(supernode), structure.l.height(supernode));
        let values = &self.values[supernode];
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
    let mut needed = vec![false; structure.l.count()];
    for (position, &block) in structure.order.iter().enumerate() {
        needed[structure.l.of(position)] |= is_requested(block);
    }
    for supernode in 0..needed.len() {
        if needed[supernode] {
            let (front, _) = structure.l.front(supernode);
            for &position in front {
                needed[structure.l.of(position as usize)] = true;
            }
        }
    }
    needed
}

/// The lower part of a square matrix.
fn lower(data: &mut [f64], order: usize) -> Target<'_> {
    Target {
        data,
        height: order,
        rows: order,
        columns: order,
        shape: Shape::Lower,
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
