//! The normal equations H and g of unknowns in blocks.

use super::factor::SparseFactor;
use super::structure::{NotPositiveBlock, Structure};
use std::sync::Arc;

/// Where H stores the entries of a pair of blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    base: u32,
    /// Distance between columns.
    stride: u32,
    /// Size of the first block of the pair.
    rows: u16,
    /// Size of the second block of the pair.
    columns: u16,
    /// Whether H stores the transposed block.
    transposed: bool,
}

/// H and g, and the symbolic analysis of H.
#[derive(Debug, Clone)]
pub struct SparseSystem {
    structure: Arc<Structure>,
    /// Values in the columns of the structure.
    h: Vec<f64>,
    gradient: Vec<f64>,
}

impl SparseSystem {
    pub(super) fn new(structure: Structure) -> Self {
        let entries = structure.entries();
        Self {
            h: vec![0.0; entries],
            gradient: vec![0.0; structure.unknowns()],
            structure: Arc::new(structure),
        }
    }

    /// Sets H and g to zero.
    pub fn zero(&mut self) {
        self.h.fill(0.0);
        self.gradient.fill(0.0);
    }

    /// The first scalar of a block in g, steps and right-hand sides.
    pub fn offset(&self, block: usize) -> usize {
        self.structure.offset[block]
    }

    /// Number of scalars.
    pub fn unknowns(&self) -> usize {
        self.structure.unknowns()
    }

    /// Number of entries that L stores, zeros of merged supernodes included.
    pub fn factor_entries(&self) -> usize {
        self.structure.l.entries()
    }

    /// Number of multiplications of a factorisation.
    pub fn factor_products(&self) -> f64 {
        self.structure.l.products()
    }

    /// Where the block H[a, b] is stored; a and b in any order.
    ///
    /// # Panics
    /// If the two are not coupled.
    pub fn slot(&self, a: usize, b: usize) -> Slot {
        let structure = &self.structure;
        let (row, column) = (structure.position[a], structure.position[b]);
        let (base, stride) = structure
            .entry(row.max(column), row.min(column))
            .expect("only coupled blocks have entries in H");
        Slot {
            base: base as u32,
            stride: stride as u32,
            rows: structure.sizes[a] as u16,
            columns: structure.sizes[b] as u16,
            transposed: row < column,
        }
    }

    /// Adds to the block of a slot. The values are row by row of H[a, b] as in the call of [`Self::slot`]; a
    /// diagonal block takes the full symmetric matrix.
    pub fn add(&mut self, slot: Slot, values: &[f64]) {
        let (rows, columns) = (slot.rows as usize, slot.columns as usize);
        assert_eq!(values.len(), rows * columns, "values of the whole block");
        let (base, stride) = (slot.base as usize, slot.stride as usize);
        if slot.transposed {
            for (i, row) in values.chunks_exact(columns).enumerate() {
                let target = &mut self.h[base + i * stride..][..columns];
                for (sum, value) in target.iter_mut().zip(row) {
                    *sum += value;
                }
            }
        } else {
            for j in 0..columns {
                let target = &mut self.h[base + j * stride..][..rows];
                for (sum, value) in target.iter_mut().zip(values[j..].iter().step_by(columns)) {
                    *sum += value;
                }
            }
        }
    }

    /// g.
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// g, to add to.
    pub fn gradient_mut(&mut self) -> &mut [f64] {
        &mut self.gradient
    }

    /// The diagonal of H.
    pub fn diagonal(&self) -> Vec<f64> {
        let structure = &self.structure;
        structure.diagonal().map(|at| self.h[at]).collect()
    }

    /// H x.
    #[cfg(test)]
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        let structure = &self.structure;
        assert_eq!(x.len(), self.unknowns(), "one value for each unknown");
        let mut ordered = vec![0.0; x.len()];
        for (&place, x) in structure.place.iter().zip(x) {
            ordered[place] = *x;
        }
        let mut product = vec![0.0; x.len()];
        for position in 0..structure.order.len() {
            let own = structure.scalars(position);
            let coupled = structure.coupled(position).iter();
            let rows = coupled.flat_map(|&row| structure.scalars(row as usize));
            let rows: Vec<usize> = rows.collect();
            let values = self.h[structure.columns(position)].chunks_exact(rows.len());
            for (column, values) in own.clone().zip(values) {
                for (&row, value) in rows.iter().zip(values) {
                    product[row] += value * ordered[column];
                    if !own.contains(&row) {
                        product[column] += value * ordered[row];
                    }
                }
            }
        }
        structure
            .place
            .iter()
            .map(|&place| product[place])
            .collect()
    }

    /// Factorises H + diag(damping), with one damping for each scalar or an empty list. H is unchanged
    /// afterwards.
    ///
    /// # Errors
    /// If a pivot is not positive or not finite.
    pub fn factorise(&mut self, damping: &[f64]) -> Result<SparseFactor, NotPositiveBlock> {
        let mut factor = SparseFactor::new(Arc::clone(&self.structure));
        self.factorise_into(damping, &mut factor)?;
        Ok(factor)
    }

    /// As [`Self::factorise`], in the memory of a factor of this structure.
    ///
    /// # Errors
    /// If a pivot is not positive or not finite. The factor is then of no use except to be overwritten.
    pub fn factorise_into(
        &mut self,
        damping: &[f64],
        factor: &mut SparseFactor,
    ) -> Result<(), NotPositiveBlock> {
        let structure = &self.structure;
        assert!(
            factor.has_structure(structure),
            "a factor of the same symbolic analysis"
        );
        if damping.is_empty() {
            return factor.factorise(&self.h);
        }
        assert_eq!(damping.len(), self.unknowns(), "damping of each unknown");
        // H is many times larger than its diagonal: save the diagonal, not a copy of H.
        let diagonal = self.diagonal();
        for (at, damping) in structure.diagonal().zip(damping) {
            self.h[at] += damping;
        }
        let factorised = factor.factorise(&self.h);
        for (at, value) in structure.diagonal().zip(diagonal) {
            self.h[at] = value;
        }
        factorised
    }
}
