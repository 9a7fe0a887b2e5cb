//! Normal equations of a step and of the border, assembled from rows.

use super::layout::STEP;
use super::rows::Rows;

/// The normal equations H δ = g of one step, in the order node i, node i + 1, segment; only the upper
/// triangle of H is used. Rows are aligned to cache lines.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct StepSystem {
    pub h: [[f64; STEP]; STEP],
    pub g: [f64; STEP],
}

impl StepSystem {
    pub const ZERO: Self = Self {
        h: [[0.0; STEP]; STEP],
        g: [0.0; STEP],
    };
}

/// The contribution of one step to the normal equations of the n columns of the border.
#[derive(Debug, Clone, PartialEq)]
pub struct BorderSystem {
    /// Number of columns n.
    pub count: usize,
    /// Coupling of each column with the step's unknowns: node i, node i + 1, segment.
    pub h: Vec<[f64; STEP]>,
    /// Normal matrix of the columns themselves, n × n row by row; only the upper triangle is used.
    pub c: Vec<f64>,
    /// Their right-hand side.
    pub g: Vec<f64>,
}

impl BorderSystem {
    /// All zero.
    pub fn new(count: usize) -> Self {
        Self {
            count,
            h: vec![[0.0; STEP]; count],
            c: vec![0.0; count * count],
            g: vec![0.0; count],
        }
    }

    /// Back to zero.
    pub fn clear(&mut self) {
        self.h.fill([0.0; STEP]);
        self.c.fill(0.0);
        self.g.fill(0.0);
    }
}

/// Adds the rows of a factor: H += w Jᵀ J, g −= w Jᵀ r.
pub fn assemble(rows: &Rows<'_>, system: &mut StepSystem, border: &mut BorderSystem) {
    let weight = rows.weight;
    if weight == 0.0 {
        return;
    }
    for (row, r) in rows.by_step.iter().zip(rows.residual) {
        for a in 0..STEP {
            if row[a] == 0.0 {
                continue;
            }
            let factor = weight * row[a];
            // Upper triangle, from the multiple of 4 at or below the diagonal: whole vectors.
            let start = a & !3;
            for (x, j) in system.h[a][start..].iter_mut().zip(&row[start..]) {
                *x += factor * j;
            }
            system.g[a] -= factor * r;
        }
    }
    let mut columns = rows.by_column();
    while let Some((column, by)) = columns.next() {
        for (row, (by_row, r)) in rows.by_step.iter().zip(by.iter().zip(rows.residual)) {
            let factor = weight * by_row;
            for (x, j) in border.h[column].iter_mut().zip(row) {
                *x += factor * j;
            }
            border.g[column] -= factor * r;
        }
        for (second, by_second) in std::iter::once((column, by)).chain(columns.clone()) {
            let sum: f64 = by.iter().zip(by_second).map(|(a, b)| a * b).sum();
            let (a, b) = (column.min(second), column.max(second));
            border.c[a * border.count + b] += weight * sum;
        }
    }
}
