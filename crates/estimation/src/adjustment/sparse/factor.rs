//! The factor L, solutions and covariances.

use super::inverse::SelectedInverse;
use super::structure::{NotPositiveBlock, Structure};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::SparseColMatRef;
use faer::sparse::linalg::cholesky::supernodal::{
    SupernodalLltRef, factorize_supernodal_numeric_llt,
};
use faer::{Conj, MatMut, Par, Spec};
use std::sync::Arc;

/// The Cholesky factor of normal equations.
#[derive(Debug, Clone)]
pub struct SparseFactor {
    structure: Arc<Structure>,
    values: Vec<f64>,
}

impl SparseFactor {
    pub(super) fn new(structure: Arc<Structure>) -> Self {
        let values = vec![0.0; structure.l.len_val()];
        Self { structure, values }
    }

    pub(super) fn has_structure(&self, structure: &Arc<Structure>) -> bool {
        Arc::ptr_eq(&self.structure, structure)
    }

    pub(super) fn factorise(&mut self, h: &[f64]) -> Result<(), NotPositiveBlock> {
        let structure = &*self.structure;
        let factorised = factorize_supernodal_numeric_llt(
            &mut self.values,
            SparseColMatRef::new(structure.h.as_ref(), h),
            Default::default(),
            &structure.l,
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(structure.scratch)),
            Spec::default(),
        );
        let failed = match factorised {
            Ok(_) => self.first_bad_pivot(),
            Err(LltError::NonPositivePivot { index }) => Some(index),
        };
        match failed {
            None => Ok(()),
            Some(scalar) => Err(NotPositiveBlock(structure.block_of(scalar))),
        }
    }

    /// The first pivot, in the order of elimination, that is not positive and finite.
    fn first_bad_pivot(&self) -> Option<usize> {
        let structure = &*self.structure;
        (0..structure.l.n_supernodes())
            .flat_map(|supernode| {
                let pivots = structure.pivots(supernode);
                let values = &self.values[structure.values(supernode)];
                let height = values.len() / pivots.len();
                pivots.zip(values.iter().step_by(height + 1))
            })
            .find(|(_, pivot)| !(pivot.is_finite() && **pivot > 0.0))
            .map(|(scalar, _)| scalar)
    }

    /// Number of scalars.
    pub fn unknowns(&self) -> usize {
        self.structure.unknowns()
    }

    /// H⁻¹ times `count` right-hand sides, one after the other.
    pub fn solve(&self, sides: &mut [f64], count: usize) {
        let mut ordered = self.ordered(sides, count);
        let l = &self.structure.l;
        let mut memory = MemBuffer::new(l.solve_in_place_scratch::<f64>(count, Par::Seq));
        SupernodalLltRef::new(l, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut ordered, self.unknowns(), count),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        for (side, ordered) in self.columns_mut(sides).zip(self.columns(&ordered)) {
            for (value, &place) in side.iter_mut().zip(&self.structure.place) {
                *value = ordered[place];
            }
        }
    }

    /// The squared length of a step d of the last unknowns in the order of elimination, such as those that couple with
    /// nearly everything, in their standard deviations: |Mᵀ d|², where M is the last rows and columns of L, because M Mᵀ
    /// is the inverse of their covariance.
    pub fn last_squared_length(&self, step: &[f64]) -> f64 {
        let structure = &*self.structure;
        let first = self.unknowns() - step.len();
        let supernodes = (0..structure.l.n_supernodes()).rev();
        let mut sum = 0.0;
        for supernode in supernodes.take_while(|&s| structure.pivots(s).end > first) {
            let pivots = structure.pivots(supernode);
            let values = &self.values[structure.values(supernode)];
            let height = values.len() / pivots.len();
            let (front, front_row) = structure.front(supernode);
            for column in first.max(pivots.start)..pivots.end {
                let values = &values[(column - pivots.start) * height..][..height];
                let mut product = 0.0;
                for (&position, &row) in front.iter().zip(front_row) {
                    let start = structure.start[position as usize];
                    for i in 0..structure.size(position as usize) {
                        if start + i >= column {
                            product += values[row as usize + i] * step[start + i - first];
                        }
                    }
                }
                sum += product * product;
            }
        }
        sum
    }

    /// H⁻¹ where L has entries, in the columns of the requested blocks. Much of the work falls on the blocks that
    /// are eliminated first, which are seldom requested.
    pub fn selected_inverse(&self, is_requested: impl Fn(usize) -> bool) -> SelectedInverse {
        SelectedInverse::new(&self.structure, &self.values, &is_requested)
    }

    fn columns<'a>(&self, sides: &'a [f64]) -> std::slice::ChunksExact<'a, f64> {
        sides.chunks_exact(self.unknowns().max(1))
    }

    fn columns_mut<'a>(&self, sides: &'a mut [f64]) -> std::slice::ChunksExactMut<'a, f64> {
        sides.chunks_exact_mut(self.unknowns().max(1))
    }

    /// Right-hand sides in the order of elimination.
    fn ordered(&self, sides: &[f64], count: usize) -> Vec<f64> {
        assert_eq!(
            sides.len(),
            self.unknowns() * count,
            "one value for each unknown and right-hand side"
        );
        let mut ordered = vec![0.0; sides.len()];
        for (ordered, side) in self.columns_mut(&mut ordered).zip(self.columns(sides)) {
            for (&place, value) in self.structure.place.iter().zip(side) {
                ordered[place] = *value;
            }
        }
        ordered
    }
}
