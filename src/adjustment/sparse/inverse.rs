//! The entries of H⁻¹ where L has entries.

use super::structure::Structure;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;
use std::sync::Arc;

/// H⁻¹ where L has entries: the covariances of all blocks that are coupled, and of some more.
#[derive(Debug, Clone)]
pub struct SelectedInverse {
    structure: Arc<Structure>,
    /// As L, supernode by supernode; diagonal parts whole.
    values: Vec<f64>,
}

impl SelectedInverse {
    /// The recursion of Takahashi, Fagan & Chen (1973) on supernodes from the last to the first.
    /// With J the unknowns of a supernode, I its other rows and Y = L_IJ L_JJ⁻¹,
    /// Z_IJ = −Z_II Y and Z_JJ = L_JJ⁻ᵀ L_JJ⁻¹ − Yᵀ Z_IJ.
    pub(super) fn new(structure: &Arc<Structure>, l: &[f64]) -> Self {
        let mut inverse = Self {
            structure: Arc::clone(structure),
            values: vec![0.0; l.len()],
        };
        let mut separator = Vec::new();
        let mut factors = Vec::new();
        for supernode in (0..structure.l.n_supernodes()).rev() {
            let range = structure.values(supernode);
            let pivots = structure.pivots(supernode).len();
            let height = range.len() / pivots;
            let others = height - pivots;
            let l = MatRef::from_column_major_slice(&l[range.clone()], height, pivots);
            let (l_top, l_bottom) = l.split_at_row(pivots);

            separator.resize(separator.len().max(others * others), 0.0);
            let separator = &mut separator[..others * others];
            inverse.gather(supernode, separator);
            let separator = MatRef::from_column_major_slice(separator, others, others);

            factors.resize(factors.len().max(height * pivots), 0.0);
            let y = &mut factors[..height * pivots];
            let y = MatMut::from_column_major_slice_mut(y, height, pivots);
            let (mut top, mut y) = y.split_at_row_mut(pivots);
            y.copy_from(l_bottom);
            solve_upper_triangular_in_place(
                l_top.transpose(),
                y.rb_mut().transpose_mut(),
                Par::Seq,
            );
            top.fill(0.0);
            top.rb_mut().diagonal_mut().fill(1.0);
            solve_lower_triangular_in_place(l_top, top.rb_mut(), Par::Seq);

            let z = &mut inverse.values[range];
            let z = MatMut::from_column_major_slice_mut(z, height, pivots);
            let (mut z_top, mut z_bottom) = z.split_at_row_mut(pivots);
            matmul(
                z_bottom.rb_mut(),
                Accum::Replace,
                separator,
                y.rb(),
                -1.0,
                Par::Seq,
            );
            matmul(
                z_top.rb_mut(),
                Accum::Replace,
                top.rb().transpose(),
                top.rb(),
                1.0,
                Par::Seq,
            );
            matmul(
                z_top.rb_mut(),
                Accum::Add,
                y.rb().transpose(),
                z_bottom.rb(),
                -1.0,
                Par::Seq,
            );
            for j in 0..pivots {
                for i in 0..j {
                    z_top[(i, j)] = z_top[(j, i)];
                }
            }
        }
        inverse
    }

    /// Z_II of a supernode, from the supernodes that eliminate I: the rows of I from one of them on
    /// are rows of it.
    fn gather(&self, supernode: usize, separator: &mut [f64]) {
        let structure = &*self.structure;
        let (front, front_row) = structure.front(supernode);
        let pivots = structure.pivots(supernode);
        let own = front.partition_point(|&p| structure.start[p as usize] < pivots.end);
        let (front, front_row) = (&front[own..], &front_row[own..]);
        let order = pivots.len();
        let height = front.last().zip(front_row.last());
        let height = height.map_or(0, |(&p, &row)| {
            row as usize + structure.size(p as usize) - order
        });
        let mut first = 0;
        while first < front.len() {
            let ancestor = structure.supernode[front[first] as usize];
            let (there, there_row) = structure.front(ancestor);
            let range = structure.values(ancestor);
            let pivots = structure.pivots(ancestor);
            let stride = range.len() / pivots.len();
            let values = &self.values[range];
            let count =
                front[first..].partition_point(|&p| structure.start[p as usize] < pivots.end);
            let mut at = 0;
            for (i, &row) in front.iter().enumerate().skip(first) {
                while there[at] != row {
                    at += 1;
                }
                let from_row = there_row[at] as usize;
                let to_row = front_row[i] as usize - order;
                let rows = structure.size(row as usize);
                for j in first..(first + count).min(i + 1) {
                    let column = front[j] as usize;
                    let from_column = structure.start[column] - pivots.start;
                    let to_column = front_row[j] as usize - order;
                    for c in 0..structure.size(column) {
                        let from = &values[(from_column + c) * stride + from_row..][..rows];
                        let to = (to_column + c) * height + to_row;
                        separator[to..to + rows].copy_from_slice(from);
                        for (r, value) in from.iter().enumerate() {
                            separator[(to_row + r) * height + to_column + c] = *value;
                        }
                    }
                }
            }
            first += count;
        }
    }

    /// The covariance of block a with block b; none where L has no entries for the pair.
    pub fn block(&self, a: usize, b: usize) -> Option<DMatrix<f64>> {
        let structure = &*self.structure;
        let (p, q) = (structure.position[a], structure.position[b]);
        let (column, row) = (p.min(q), p.max(q));
        let supernode = structure.supernode[column];
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
