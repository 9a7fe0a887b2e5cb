//! Marginal covariances of a factorised chain, by back-recursion.

use super::chain::ChainFactor;
use super::front::solve_rows;
use super::layout::{CHANGE, NODE, SEGMENT, STEP, TAIL};
use super::rows::Rows;
use nalgebra::DMatrix;

/// The joint covariance of the unknowns of step i and of the border, in parts.
pub struct StepMarginal<'a> {
    /// Node i.
    pub node: &'a [[f64; NODE]; NODE],
    /// Covariance of node i (rows) with node i + 1 and the segment.
    between: &'a [[f64; TAIL]; NODE],
    /// Node i + 1 and the segment.
    next: &'a [[f64; TAIL]; TAIL],
    /// Covariance of all of them (node i, node i + 1, segment) with the border, STEP × n row by row.
    cross: &'a [f64],
}

impl StepMarginal<'_> {
    /// The joint covariance in one matrix.
    pub fn joint(&self) -> StepCovariance {
        let mut unknowns = [[0.0; STEP]; STEP];
        for (a, (node, between)) in self.node.iter().zip(self.between).enumerate() {
            unknowns[a][..NODE].copy_from_slice(node);
            unknowns[a][NODE..].copy_from_slice(between);
            for (b, x) in between.iter().enumerate() {
                unknowns[NODE + b][a] = *x;
            }
        }
        for (row, next) in unknowns[NODE..].iter_mut().zip(self.next) {
            row[NODE..].copy_from_slice(next);
        }
        StepCovariance {
            unknowns,
            cross: self.cross.to_vec(),
        }
    }
}

/// The joint covariance of the unknowns of a step.
#[derive(Debug, Clone)]
pub struct StepCovariance {
    /// Node i, node i + 1, segment.
    pub unknowns: [[f64; STEP]; STEP],
    /// Their covariance with the border, STEP × n row by row.
    pub cross: Vec<f64>,
}

impl StepCovariance {
    /// The redundancy 1 − w jᵀ Σ j of each row, given the covariance of the border: the share of
    /// the observation that other observations check.
    pub fn redundancies(&self, rows: &Rows<'_>, border: &DMatrix<f64>) -> Vec<f64> {
        let predicted = |i: usize| self.predicted(rows, i, border);
        let rows = 0..rows.residual.len();
        rows.map(|i| 1.0 - predicted(i)).collect()
    }

    /// The weighted variance of the prediction of row i, w jᵀ Σ j.
    fn predicted(&self, rows: &Rows<'_>, i: usize, border: &DMatrix<f64>) -> f64 {
        let (row, n) = (&rows.by_step[i], border.nrows());
        let mut used = [0usize; STEP];
        let mut count = 0;
        for (a, x) in row.iter().enumerate() {
            used[count] = a;
            count += usize::from(*x != 0.0);
        }
        let used = &used[..count];
        let mut sum = 0.0;
        for (at, &a) in used.iter().enumerate() {
            let line = &self.unknowns[a];
            let others: f64 = used[at + 1..].iter().map(|&b| line[b] * row[b]).sum();
            sum += row[a] * (line[a] * row[a] + 2.0 * others);
        }
        for (c, by) in rows.by_column() {
            let inner: f64 = used.iter().map(|&a| self.cross[a * n + c] * row[a]).sum();
            let border: f64 = rows.by_column().map(|(d, w)| border[(c, d)] * w[i]).sum();
            sum += by[i] * (2.0 * inner + border);
        }
        rows.weight * sum
    }
}

impl ChainFactor {
    /// Visits every step from the last to the first with the joint covariance of its unknowns.
    /// From the covariance Σ of a separator (the border is part of every separator):
    /// K = U_PP⁻¹ U_PS, Σ_PS = −K Σ, Σ_PP = U_PP⁻¹ U_PP⁻ᵀ + K Σ Kᵀ.
    pub fn marginals(&self, mut visit: impl FnMut(usize, &StepMarginal<'_>)) {
        let mut border = BorderCovariance::new(self);
        let n = border.n;
        let (tail, rows) = self.tail();
        let mut sigma = tail_covariance(&tail.rows);
        if n > 0 {
            border.enter::<TAIL, TAIL>(&tail.rows, rows);
            border.subtract_from_pivots(&mut sigma);
            border.cross[NODE * n..].copy_from_slice(&border.pivots[..TAIL * n]);
        }
        for i in (0..self.layout.steps()).rev() {
            let (front, rows) = self.step(i);
            let (pivots, cross) =
                pivot_covariance::<NODE, STEP>(&front.rows, rows, &sigma, &mut border);
            border.cross[..NODE * n].copy_from_slice(&border.pivots[..NODE * n]);
            visit(
                i,
                &StepMarginal {
                    node: &pivots,
                    between: &cross,
                    next: &sigma,
                    cross: &border.cross,
                },
            );
            for a in 0..NODE {
                sigma[a][..NODE].copy_from_slice(&pivots[a]);
                for b in NODE..TAIL {
                    sigma[a][b] = cross[a][b];
                    sigma[b][a] = cross[a][b];
                }
            }
            border.cross.copy_within(..NODE * n, NODE * n);
            if self.layout.changes_before(i) {
                let (front, rows) = self.change(self.layout.segment_of_step[i] as usize - 1);
                let (pivots, cross) =
                    pivot_covariance::<SEGMENT, CHANGE>(&front.rows, rows, &sigma, &mut border);
                for a in 0..SEGMENT {
                    sigma[NODE + a][NODE..].copy_from_slice(&pivots[a]);
                    for b in 0..NODE {
                        sigma[NODE + a][b] = cross[a][b];
                        sigma[b][NODE + a] = cross[a][b];
                    }
                }
                border.cross[2 * NODE * n..].copy_from_slice(&border.pivots[..SEGMENT * n]);
            }
        }
    }
}

/// The border's part of the recursion.
struct BorderCovariance {
    n: usize,
    /// Σ_kk, n × n.
    border: Vec<f64>,
    /// Covariance of the step's unknowns with the border, STEP × n; rows from NODE on are those
    /// of the separator.
    cross: Vec<f64>,
    /// U_PP⁻¹ Y_P of the current front, P × n.
    gain: Vec<f64>,
    /// Σ_Pk of the current front, P × n.
    pivots: Vec<f64>,
    /// Σ_kS, one row per column of the border.
    of_separator: Vec<[f64; TAIL]>,
}

impl BorderCovariance {
    fn new(factor: &ChainFactor) -> Self {
        let n = factor.border();
        Self {
            n,
            border: factor.border_covariance().as_slice().to_vec(),
            cross: vec![0.0; STEP * n],
            gain: vec![0.0; TAIL * n],
            pivots: vec![0.0; TAIL * n],
            of_separator: vec![[0.0; TAIL]; n],
        }
    }

    /// Computes Kk = U_PP⁻¹ Y_P and −Kk Σ_kk, which is all of Σ_Pk if there is no other separator.
    fn enter<const P: usize, const N: usize>(&mut self, rows: &[[f64; N]; P], border: &[f64]) {
        let n = self.n;
        for a in (0..P).rev() {
            let (row, done) = self.gain[a * n..P * n].split_at_mut(n);
            row.copy_from_slice(&border[a * n..(a + 1) * n]);
            for (factor, below) in rows[a][a + 1..P].iter().zip(done.chunks_exact(n)) {
                for (x, g) in row.iter_mut().zip(below) {
                    *x -= factor * g;
                }
            }
            let scale = 1.0 / rows[a][a];
            row.iter_mut().for_each(|x| *x *= scale);
        }
        let pivots = self.pivots[..P * n].chunks_exact_mut(n);
        for (pivot, gain) in pivots.zip(self.gain.chunks_exact(n)) {
            pivot.fill(0.0);
            subtract(pivot, gain, self.border.chunks_exact(n));
        }
    }

    /// Subtracts K Σ_Sk from Σ_Pk, and Kk Σ_kS from Σ_PS.
    fn separate<const P: usize>(&mut self, k: &[[f64; TAIL]; P], cross: &mut [[f64; TAIL]; P]) {
        let n = self.n;
        let of_separator = &self.cross[NODE * n..];
        for (b, row) in of_separator.chunks_exact(n).enumerate() {
            for (target, x) in self.of_separator.iter_mut().zip(row) {
                target[b] = *x;
            }
        }
        for (a, (k, cross)) in k.iter().zip(cross).enumerate() {
            let range = a * n..(a + 1) * n;
            subtract(
                &mut self.pivots[range.clone()],
                k,
                of_separator.chunks_exact(n),
            );
            let of_separator = self.of_separator.iter().map(|row| &row[..]);
            subtract(cross, &self.gain[range], of_separator);
        }
    }

    /// Subtracts Σ_Pk Kkᵀ from Σ_PP.
    #[allow(clippy::needless_range_loop)] // covariance[a][b] and covariance[b][a]
    fn subtract_from_pivots<const P: usize>(&self, covariance: &mut [[f64; P]; P]) {
        let n = self.n;
        for a in 0..P {
            for b in a..P {
                let (of_a, of_b) = (&self.pivots[a * n..][..n], &self.gain[b * n..][..n]);
                let sum: f64 = of_a.iter().zip(of_b).map(|(x, y)| x * y).sum();
                covariance[a][b] -= sum;
                covariance[b][a] = covariance[a][b];
            }
        }
    }
}

/// Subtracts Σ factor · row from `target`.
fn subtract<'a>(target: &mut [f64], factors: &[f64], rows: impl Iterator<Item = &'a [f64]>) {
    for (factor, row) in factors.iter().zip(rows) {
        for (x, r) in target.iter_mut().zip(row) {
            *x -= factor * r;
        }
    }
}

/// Σ_PP and Σ_PS of a front's pivots, given the covariance of its separator; leaves Σ_Pk in
/// `border.pivots`.
fn pivot_covariance<const P: usize, const N: usize>(
    rows: &[[f64; N]; P],
    border_rows: &[f64],
    separator: &[[f64; TAIL]; TAIL],
    border: &mut BorderCovariance,
) -> ([[f64; P]; P], [[f64; TAIL]; P]) {
    // K and the inverse of U_PP, row by row from the last.
    let mut k = [[0.0; TAIL]; P];
    let mut inverse = [[0.0; P]; P];
    for a in (0..P).rev() {
        let scale = 1.0 / rows[a][a];
        let mut row = [0.0; TAIL];
        row.copy_from_slice(&rows[a][P..]);
        let mut inverse_row = [0.0; P];
        inverse_row[a] = 1.0;
        for b in a + 1..P {
            let factor = rows[a][b];
            for c in 0..TAIL {
                row[c] -= factor * k[b][c];
            }
            for c in 0..P {
                inverse_row[c] -= factor * inverse[b][c];
            }
        }
        k[a] = row.map(|x| x * scale);
        inverse[a] = inverse_row.map(|x| x * scale);
    }
    let mut cross = [[0.0; TAIL]; P];
    for a in 0..P {
        let mut row = [0.0; TAIL];
        for b in 0..TAIL {
            let factor = k[a][b];
            for c in 0..TAIL {
                row[c] -= factor * separator[b][c];
            }
        }
        cross[a] = row;
    }
    if border.n > 0 {
        border.enter::<P, N>(rows, border_rows);
        border.separate::<P>(&k, &mut cross);
    }
    let mut covariance = [[0.0; P]; P];
    for a in 0..P {
        for b in a..P {
            let inner: f64 = (b..P).map(|c| inverse[a][c] * inverse[b][c]).sum();
            let outer: f64 = (0..TAIL).map(|c| cross[a][c] * k[b][c]).sum();
            covariance[a][b] = inner - outer;
            covariance[b][a] = covariance[a][b];
        }
    }
    if border.n > 0 {
        border.subtract_from_pivots(&mut covariance);
    }
    (covariance, cross)
}

/// (Uᵀ U)⁻¹ of the tail.
pub fn tail_covariance(rows: &[[f64; TAIL]; TAIL]) -> [[f64; TAIL]; TAIL] {
    let mut sigma = [[0.0; TAIL]; TAIL];
    for column in 0..TAIL {
        // Uᵀ z = e, then U x = z.
        let mut z = [0.0; TAIL];
        z[column] = 1.0;
        for a in 0..TAIL {
            let sum: f64 = (0..a).map(|b| rows[b][a] * z[b]).sum();
            z[a] = (z[a] - sum) / rows[a][a];
        }
        let x = solve_rows::<TAIL, TAIL>(rows, &z, [0.0; TAIL]);
        for a in 0..TAIL {
            sigma[a][column] = x[a];
        }
    }
    sigma
}
