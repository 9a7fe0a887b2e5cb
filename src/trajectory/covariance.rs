//! The posterior covariance of the whole trajectory, kept as its Cholesky factor.

use super::chain::{BIAS, ChainFactor, NODE, TAIL};
use nalgebra::DMatrix;

/// Unknowns of a pose: δφ (rotation vector in the body frame, R ← R Exp(δφ)), δp (world).
const POSE: usize = 6;
/// Mark of a node without gradient.
const NONE: u32 = u32::MAX;

/// Gradient of m linear functionals by the poses at the nodes, sparse over the nodes: m × 6 per
/// node over (δφ rad in the body frame with R ← R Exp(δφ), δp m in the world).
#[derive(Debug, Clone, PartialEq)]
pub struct PoseGradient {
    rows: usize,
    slot: Vec<u32>,
    values: Vec<f64>,
}

impl PoseGradient {
    /// No dependence yet, for `rows` functionals of a trajectory of `nodes` nodes.
    pub fn new(rows: usize, nodes: usize) -> Self {
        Self {
            rows,
            slot: vec![NONE; nodes],
            values: Vec::new(),
        }
    }

    /// Number of functionals m.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The m × 6 block of `node`, row by row, to add to.
    ///
    /// # Panics
    /// Where `node` is not below the number of nodes.
    pub fn block_mut(&mut self, node: usize) -> &mut [f64] {
        let size = self.rows * POSE;
        if self.slot[node] == NONE {
            self.slot[node] = (self.values.len() / size.max(1)) as u32;
            self.values.resize(self.values.len() + size, 0.0);
        }
        let start = self.slot[node] as usize * size;
        &mut self.values[start..start + size]
    }

    /// Adds an m × 6 block (row by row) to `node`.
    ///
    /// # Panics
    /// Where `node` is not below the number of nodes.
    pub fn add(&mut self, node: usize, block: &[f64]) {
        debug_assert_eq!(block.len(), self.rows * POSE);
        for (x, b) in self.block_mut(node).iter_mut().zip(block) {
            *x += b;
        }
    }

    fn block(&self, node: usize) -> Option<&[f64]> {
        let slot = self.slot[node];
        let size = self.rows * POSE;
        let start = slot as usize * size;
        (slot != NONE).then(|| &self.values[start..start + size])
    }
}

/// The joint covariance H⁻¹ of all poses, velocities and biases, as the factor of H = Uᵀ U at the
/// solution. Propagates any linear functional of the poses with the full correlation in time.
#[derive(Debug, Clone)]
pub struct PosteriorCovariance {
    factor: ChainFactor,
}

impl PosteriorCovariance {
    pub(super) fn new(factor: ChainFactor) -> Self {
        Self { factor }
    }

    /// Number of nodes of the trajectory.
    pub fn nodes(&self) -> usize {
        self.factor.layout.nodes()
    }

    /// The covariance G H⁻¹ Gᵀ (m × m) of the functionals with this gradient: (U⁻ᵀ Gᵀ)ᵀ (U⁻ᵀ Gᵀ)
    /// by one forward substitution. Units are those of the functionals, squared.
    ///
    /// # Panics
    /// Where the gradient was made for another number of nodes.
    pub fn of_functional(&self, gradient: &PoseGradient) -> DMatrix<f64> {
        let m = gradient.rows;
        assert_eq!(
            gradient.slot.len(),
            self.nodes(),
            "gradient of another trajectory"
        );
        if m == 0 {
            return DMatrix::zeros(0, 0);
        }
        let steps = self.factor.layout.steps();
        let mut sum = vec![0.0; m * m];
        // Right-hand sides of (node, bias), 15 rows of m; fronts below read and pass them on.
        let mut carry = vec![0.0; TAIL * m];
        let mut front = vec![0.0; (2 * NODE + BIAS) * m];
        let first = gradient.slot.iter().position(|&slot| slot != NONE);
        for i in first.unwrap_or(steps)..steps {
            if self.factor.layout.changes_before(i) {
                let old = self.factor.layout.bias_of_step[i - 1] as usize;
                let (bias, node, new) = (0, BIAS * m, TAIL * m);
                front[bias..node].copy_from_slice(&carry[NODE * m..]);
                front[node..new].copy_from_slice(&carry[..NODE * m]);
                front[new..new + BIAS * m].fill(0.0);
                let end = new + BIAS * m;
                forward(
                    &self.factor.change_rows[old],
                    &mut front[..end],
                    m,
                    &mut sum,
                );
                carry.copy_from_slice(&front[node..end]);
            }
            let (node, next, bias) = (0, NODE * m, 2 * NODE * m);
            front[node..next].copy_from_slice(&carry[..NODE * m]);
            front[next..bias].fill(0.0);
            front[bias..].copy_from_slice(&carry[NODE * m..]);
            add_gradient(gradient, i, &mut front);
            forward(&self.factor.step_rows[i], &mut front, m, &mut sum);
            carry.copy_from_slice(&front[next..]);
        }
        add_gradient(gradient, steps, &mut carry);
        forward(&self.factor.tail_rows, &mut carry, m, &mut sum);
        DMatrix::from_fn(m, m, |a, b| sum[a.min(b) * m + a.max(b)])
    }
}

/// Adds the gradient of `node` to the rows of its attitude and position in a front.
fn add_gradient(gradient: &PoseGradient, node: usize, front: &mut [f64]) {
    let m = gradient.rows;
    if let Some(block) = gradient.block(node) {
        for (row, values) in block.chunks_exact(POSE).enumerate() {
            for (unknown, value) in values.iter().enumerate() {
                front[unknown * m + row] += value;
            }
        }
    }
}

/// One front of U⁻ᵀ G: the first P of N rows of m become y, the others lose U_PSᵀ y, and
/// `sum` (upper triangle) gains yᵀ y.
fn forward<const P: usize, const N: usize>(
    rows: &[[f64; N]; P],
    front: &mut [f64],
    m: usize,
    sum: &mut [f64],
) {
    for (a, row) in rows.iter().enumerate() {
        let (done, rest) = front.split_at_mut((a + 1) * m);
        let y = &mut done[a * m..];
        let scale = 1.0 / row[a];
        y.iter_mut().for_each(|x| *x *= scale);
        for (factor, target) in row[a + 1..].iter().zip(rest.chunks_exact_mut(m)) {
            for (x, y) in target.iter_mut().zip(y.iter()) {
                *x -= factor * y;
            }
        }
        for (b, factor) in y.iter().enumerate() {
            for (x, y) in sum[b * m + b..(b + 1) * m].iter_mut().zip(&y[b..]) {
                *x += factor * y;
            }
        }
    }
}
