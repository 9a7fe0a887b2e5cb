//! Marginal covariances of a factorised chain, by back-recursion.

use super::chain::{BIAS, CHANGE, ChainFactor, NODE, STEP, TAIL, solve_rows};

impl ChainFactor {
    /// Visits every node from the last to the first with the covariance of (node, its bias).
    /// From the covariance Σ of a separator: K = U_PP⁻¹ U_PS, Σ_PS = −K Σ,
    /// Σ_PP = U_PP⁻¹ U_PP⁻ᵀ + K Σ Kᵀ.
    pub fn marginals(&self, mut visit: impl FnMut(usize, &[[f64; TAIL]; TAIL])) {
        let steps = self.layout.steps();
        let mut sigma = tail_covariance(&self.tail_rows);
        visit(steps, &sigma);
        for i in (0..steps).rev() {
            let (own, cross) = pivot_covariance::<NODE, STEP>(&self.step_rows[i], &sigma);
            for a in 0..NODE {
                sigma[a][..NODE].copy_from_slice(&own[a]);
                for b in NODE..TAIL {
                    sigma[a][b] = cross[a][b];
                    sigma[b][a] = cross[a][b];
                }
            }
            visit(i, &sigma);
            if self.layout.changes_before(i) {
                let old = self.layout.bias_of_step[i] as usize - 1;
                let (own, cross) = pivot_covariance::<BIAS, CHANGE>(&self.change_rows[old], &sigma);
                for a in 0..BIAS {
                    sigma[NODE + a][NODE..].copy_from_slice(&own[a]);
                    for b in 0..NODE {
                        sigma[NODE + a][b] = cross[a][b];
                        sigma[b][NODE + a] = cross[a][b];
                    }
                }
            }
        }
    }
}

/// Σ_PP and Σ_PS of a front's pivots, given the covariance of its separator.
fn pivot_covariance<const P: usize, const N: usize>(
    rows: &[[f64; N]; P],
    separator: &[[f64; TAIL]; TAIL],
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
    let mut own = [[0.0; P]; P];
    for a in 0..P {
        for b in a..P {
            let inner: f64 = (b..P).map(|c| inverse[a][c] * inverse[b][c]).sum();
            let outer: f64 = (0..TAIL).map(|c| cross[a][c] * k[b][c]).sum();
            own[a][b] = inner - outer;
            own[b][a] = own[a][b];
        }
    }
    (own, cross)
}

/// (Uᵀ U)⁻¹ of the tail.
fn tail_covariance(rows: &[[f64; TAIL]; TAIL]) -> [[f64; TAIL]; TAIL] {
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
