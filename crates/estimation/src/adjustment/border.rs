//! Unknowns that touch many steps: the dense border of the chain.
//!
//! H = [[Hc, E], [Eᵀ, C]] with the chain Hc = Uᵀ U. The columns of E go through the forward
//! elimination as further right-hand sides, Y = U⁻ᵀ E. The remaining system of the border is
//! S = C − Yᵀ Y with the right-hand side gk − Yᵀ y, and S = U_kᵀ U_k.

use super::front::{change_place, forward, step_place};
use super::layout::{CHANGE, NODE, SEGMENT, STEP, TAIL};
use super::prior::BorderPrior;
use super::system::BorderSystem;

/// The border while the chain is eliminated.
pub struct BorderCarry {
    /// Columns over (node, segment), TAIL × n.
    columns: Vec<f64>,
    /// Columns of the current front, up to STEP × n.
    front: Vec<f64>,
    /// The upper triangle of C − Yᵀ Y so far, n × n.
    s: Vec<f64>,
    /// gk − Yᵀ y so far.
    g: Vec<f64>,
}

impl BorderCarry {
    /// The border before the first step; `damping` is added to the diagonal.
    pub fn new(prior: &BorderPrior, damping: &[f64]) -> Self {
        let n = prior.weight.len();
        let mut s = vec![0.0; n * n];
        for c in 0..n {
            s[c * n + c] = prior.weight[c] + damping[c];
        }
        let terms = prior.weight.iter().zip(&prior.miss);
        Self {
            columns: vec![0.0; TAIL * n],
            front: vec![0.0; STEP * n],
            s,
            g: terms.map(|(w, d)| -w * d).collect(),
        }
    }

    /// Adds the border of step i, and writes the rows of Y of node i to `y_rows`.
    pub fn step(
        &mut self,
        border: &BorderSystem,
        rows: &[[f64; STEP]; NODE],
        y: &[f64; NODE],
        y_rows: &mut [f64],
    ) {
        let n = border.count;
        for (row, target) in self.front.chunks_exact_mut(n).enumerate() {
            for (x, coupling) in target.iter_mut().zip(&border.h) {
                *x = coupling[row];
            }
        }
        for (a, carried) in self.columns.chunks_exact(n).enumerate() {
            let place = step_place(a) * n;
            for (x, column) in self.front[place..].iter_mut().zip(carried) {
                *x += column;
            }
        }
        self.s.iter_mut().zip(&border.c).for_each(|(s, c)| *s += c);
        self.g.iter_mut().zip(&border.g).for_each(|(g, b)| *g += b);
        forward(rows, &mut self.front, n);
        self.columns.copy_from_slice(&self.front[NODE * n..]);
        self.finish_rows(NODE * n, y, y_rows);
    }

    /// A change of segment: writes the rows of Y of the old segment to `y_rows`.
    pub fn change(
        &mut self,
        rows: &[[f64; CHANGE]; SEGMENT],
        y: &[f64; SEGMENT],
        y_rows: &mut [f64],
    ) {
        let n = self.g.len();
        let front = &mut self.front[..CHANGE * n];
        front.fill(0.0);
        for (a, carried) in self.columns.chunks_exact(n).enumerate() {
            let place = change_place(a) * n;
            front[place..place + n].copy_from_slice(carried);
        }
        forward(rows, front, n);
        self.columns.copy_from_slice(&front[SEGMENT * n..]);
        self.finish_rows(SEGMENT * n, y, y_rows);
    }

    /// The tail: writes its rows of Y to `y_rows`.
    pub fn tail(&mut self, rows: &[[f64; TAIL]; TAIL], y: &[f64; TAIL], y_rows: &mut [f64]) {
        let n = self.g.len();
        self.front[..TAIL * n].copy_from_slice(&self.columns);
        forward(rows, &mut self.front[..TAIL * n], n);
        self.finish_rows(TAIL * n, y, y_rows);
    }

    /// Writes the finished rows of Y and subtracts Yᵀ Y and Yᵀ y from the remaining system.
    fn finish_rows(&mut self, size: usize, y: &[f64], y_rows: &mut [f64]) {
        y_rows.copy_from_slice(&self.front[..size]);
        let n = self.g.len();
        for (row, y) in y_rows.chunks_exact(n).zip(y) {
            for (b, factor) in row.iter().enumerate() {
                for (s, r) in self.s[b * n + b..(b + 1) * n].iter_mut().zip(&row[b..]) {
                    *s -= factor * r;
                }
                self.g[b] -= factor * y;
            }
        }
    }

    /// The factor of the border, or its first column that is not determined.
    pub fn factorise(self) -> Result<BorderFactor, usize> {
        let n = self.g.len();
        let (mut u, mut y) = (self.s, self.g);
        for k in 0..n {
            let pivot = u[k * n + k];
            if pivot.is_nan() || pivot <= 0.0 {
                return Err(k);
            }
            let inverse = 1.0 / pivot.sqrt();
            let (done, rest) = u.split_at_mut((k + 1) * n);
            let row = &mut done[k * n..];
            row[k..].iter_mut().for_each(|x| *x *= inverse);
            y[k] *= inverse;
            for i in k + 1..n {
                let target = &mut rest[(i - k - 1) * n..(i - k) * n];
                for (x, r) in target[i..].iter_mut().zip(&row[i..]) {
                    *x -= row[i] * r;
                }
                y[i] -= row[i] * y[k];
            }
        }
        Ok(BorderFactor { u, y })
    }
}

/// S = U_kᵀ U_k and y_k = U_k⁻ᵀ (gk − Yᵀ y).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BorderFactor {
    /// n × n row by row; only the upper triangle is used.
    u: Vec<f64>,
    pub y: Vec<f64>,
}

impl BorderFactor {
    /// All zero, for n columns.
    pub fn new(n: usize) -> Self {
        Self {
            u: vec![0.0; n * n],
            y: vec![0.0; n],
        }
    }

    /// Replaces the right-hand sides F, n rows of m columns, by U_k⁻ᵀ F.
    pub fn forward(&self, f: &mut [f64], m: usize) {
        let n = self.y.len();
        for k in 0..n {
            let row = &self.u[k * n..(k + 1) * n];
            let (done, rest) = f.split_at_mut((k + 1) * m);
            let y = &mut done[k * m..];
            y.iter_mut().for_each(|x| *x /= row[k]);
            for (factor, target) in row[k + 1..].iter().zip(rest.chunks_exact_mut(m)) {
                for (x, y) in target.iter_mut().zip(y.iter()) {
                    *x -= factor * y;
                }
            }
        }
    }

    /// Solves U_k x = y in place.
    pub fn back_substitute(&self, x: &mut [f64]) {
        let n = self.y.len();
        for k in (0..n).rev() {
            let row = &self.u[k * n..(k + 1) * n];
            let sum: f64 = (k + 1..n).map(|b| row[b] * x[b]).sum();
            x[k] = (x[k] - sum) / row[k];
        }
    }

    /// Step and standard deviation of each column from `first` on, as if the other columns from `first`
    /// on did not exist. The system of these columns is Uᵀ U without the rows before `first`.
    pub fn each_alone(&self, first: usize) -> Vec<(f64, f64)> {
        let n = self.y.len();
        (first..n)
            .map(|c| {
                let rows = || (first..=c).map(|k| (self.u[k * n + c], self.y[k]));
                let information: f64 = rows().map(|(u, _)| u * u).sum();
                let right: f64 = rows().map(|(u, y)| u * y).sum();
                (right / information, information.sqrt().recip())
            })
            .collect()
    }

    /// S⁻¹, n × n: the covariance of the border.
    pub fn covariance(&self) -> Vec<f64> {
        let n = self.y.len();
        // The rows of U_k⁻¹, from (U_k⁻ᵀ)ᵀ: S⁻¹ = (U_k⁻ᵀ)ᵀ U_k⁻ᵀ.
        let mut inverse = vec![0.0; n * n];
        (0..n).for_each(|k| inverse[k * n + k] = 1.0);
        self.forward(&mut inverse, n);
        let mut covariance = vec![0.0; n * n];
        for a in 0..n {
            for b in a..n {
                let sum: f64 = (b..n)
                    .map(|k| inverse[k * n + a] * inverse[k * n + b])
                    .sum();
                covariance[a * n + b] = sum;
                covariance[b * n + a] = sum;
            }
        }
        covariance
    }
}
