//! Whitened rows of a factor: all that a solver needs to know about it.

use super::layout::STEP;
use super::unknown::{Block, Unknown};

/// R whitened rows: residuals in standard deviations, and their derivatives.
///
/// A factor touches the unknowns of one step of the chain (node i, node i + 1, segment) and any
/// others outside the chain, each by the columns of its [`Block`]. A solver of the chain takes those
/// that lie in its border; a sparse solver may have many more, such as the patches of a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct FactorRows<const R: usize> {
    pub residual: [f64; R],
    /// Derivatives by node i, node i + 1, segment.
    pub by_step: [[f64; STEP]; R],
    columns: Vec<usize>,
    by_columns: Vec<[f64; R]>,
}

impl<const R: usize> FactorRows<R> {
    /// Rows that touch the unknowns of a step only.
    pub fn new(residual: [f64; R], by_step: [[f64; STEP]; R]) -> Self {
        Self {
            residual,
            by_step,
            columns: Vec::new(),
            by_columns: Vec::new(),
        }
    }

    /// Adds the derivatives by an unknown outside the chain, column by column.
    pub fn touch<T: Unknown, const D: usize>(&mut self, block: Block<T>, by: [[f64; R]; D]) {
        const { assert!(D == T::DIMENSION, "a column for each parameter") }
        self.columns.extend(block.columns());
        self.by_columns.extend(by);
    }

    /// The same rows with the weight of the loss, 0 to 1.
    pub fn weighted(&self, weight: f64) -> Rows<'_> {
        Rows {
            weight,
            residual: &self.residual,
            by_step: &self.by_step,
            columns: &self.columns,
            by_columns: self.by_columns.as_flattened(),
        }
    }
}

/// The rows of any factor.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    /// Weight of the loss, 0 to 1; the cost is ½ weight · Σ residual².
    pub weight: f64,
    pub residual: &'a [f64],
    /// Derivatives by node i, node i + 1, segment, for each row.
    pub by_step: &'a [[f64; STEP]],
    /// Columns outside the chain.
    pub columns: &'a [usize],
    /// For each of these columns the derivatives of all rows.
    pub by_columns: &'a [f64],
}

impl<'a> Rows<'a> {
    /// The columns outside the chain that the rows touch, with the derivatives of all rows.
    pub fn by_column(&self) -> impl Iterator<Item = (usize, &'a [f64])> + Clone {
        let by = self.by_columns.chunks_exact(self.residual.len().max(1));
        self.columns.iter().copied().zip(by)
    }
}
