//! Whitened rows over blocks of unknowns, as every factor of the adjustment yields them.

/// Rows of many factors, one after the other.
///
/// A row is a residual in standard deviations with its derivatives by the blocks of unknowns that
/// it touches; blocks count over the whole problem.
#[derive(Debug, Clone, Default)]
pub struct RowBatch {
    heads: Vec<Head>,
    blocks: Vec<u32>,
    by: Vec<f64>,
    is_without_derivatives: bool,
}

#[derive(Debug, Clone, Copy)]
struct Head {
    group: u32,
    weight: f64,
    residual: f64,
    cost: f64,
    first_block: usize,
    first_by: usize,
}

/// Standard deviation of held values, metres and radians.
pub const HELD_SIGMA: f64 = 1e-8;

/// Residuals beyond which a row is trusted less, and not at all, standard deviations: a leaf that moved is
/// not noise. Together with Huber's loss, this is Hampel's loss.
const ROW_SIGMAS: [f64; 2] = [5.0, 8.0];
/// The same for the root mean square of the residuals of all rows of a surfel: a leaf that moved may change
/// several of them by a little.
const SURFEL_SIGMAS: [f64; 2] = [2.0, 3.0];

/// Trust in a row with this residual, 0 to 1.
pub fn row_trust(residual: f64) -> f64 {
    falling(residual.abs(), ROW_SIGMAS)
}

/// Trust in a surfel whose residuals have this root mean square, 0 to 1.
pub fn surfel_trust(rms: f64) -> f64 {
    falling(rms, SURFEL_SIGMAS)
}

/// 1 up to `from`, falling linearly to 0 at `to`.
fn falling(length: f64, [from, to]: [f64; 2]) -> f64 {
    ((to - length) / (to - from)).clamp(0.0, 1.0)
}

/// Residual at which Huber's loss turns from quadratic to linear, standard deviations: 1 good row in 80 lies
/// beyond.
const HUBER_SIGMAS: f64 = 2.5;

/// The weight ψ(r)/r and the cost ρ(r) of a residual under Huber's loss.
fn huber(residual: f64) -> (f64, f64) {
    let length = residual.abs();
    if length <= HUBER_SIGMAS {
        (1.0, 0.5 * residual * residual)
    } else {
        (
            HUBER_SIGMAS / length,
            HUBER_SIGMAS * (length - 0.5 * HUBER_SIGMAS),
        )
    }
}

/// One row.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    /// The group of observations that it belongs to.
    pub group: usize,
    /// Weight of the loss, 0 to 1; the cost is ½ weight · residual².
    pub weight: f64,
    /// The residual in standard deviations.
    pub residual: f64,
    /// The blocks that it touches, each once.
    pub blocks: &'a [u32],
    /// Derivatives of the residual, block after block.
    pub by: &'a [f64],
}

impl RowBatch {
    /// A batch that drops derivatives.
    pub fn of_residuals() -> Self {
        Self {
            is_without_derivatives: true,
            ..Self::default()
        }
    }

    /// Whether it keeps derivatives; factors need not compute them otherwise.
    pub fn has_derivatives(&self) -> bool {
        !self.is_without_derivatives
    }

    /// Begins a row without derivatives.
    pub fn begin(&mut self, group: usize, weight: f64, residual: f64) {
        self.heads.push(Head {
            group: group as u32,
            weight,
            residual,
            cost: 0.5 * weight * residual * residual,
            first_block: self.blocks.len(),
            first_by: self.by.len(),
        });
    }

    /// Begins a row under Huber's loss with this trust, 0 to 1.
    pub fn begin_robust(&mut self, trust: f64, group: usize, residual: f64) {
        let (weight, cost) = huber(residual);
        self.begin(group, trust * weight, residual);
        if let Some(head) = self.heads.last_mut() {
            head.cost = trust * cost;
        }
    }

    /// Adds the derivatives of the last row by one block.
    pub fn touch(&mut self, block: usize, by: &[f64]) {
        if self.has_derivatives() {
            self.blocks.push(block as u32);
            self.by.extend_from_slice(by);
        }
    }

    /// The rows in their order.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.heads.iter().enumerate().map(|(i, head)| {
            let next = self.heads.get(i + 1);
            let blocks_end = next.map_or(self.blocks.len(), |next| next.first_block);
            let by_end = next.map_or(self.by.len(), |next| next.first_by);
            Row {
                group: head.group as usize,
                weight: head.weight,
                residual: head.residual,
                blocks: &self.blocks[head.first_block..blocks_end],
                by: &self.by[head.first_by..by_end],
            }
        })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.heads.len()
    }

    /// The cost of all rows.
    pub fn cost(&self) -> f64 {
        self.heads.iter().map(|head| head.cost).sum()
    }

    /// Removes all rows.
    pub fn clear(&mut self) {
        self.heads.clear();
        self.blocks.clear();
        self.by.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_of_hubers_loss_is_its_slope_over_the_residual() {
        let h = 1e-6;
        for residual in [-9.0, -2.6, -2.4, -0.3, 0.1, 2.0, 2.49, 2.51, 7.0, 100.0] {
            let slope = (huber(residual + h).1 - huber(residual - h).1) / (2.0 * h);
            assert!((huber(residual).0 * residual - slope).abs() < 1e-6);
        }
    }

    #[test]
    fn rows_are_trusted_less_from_5_and_surfels_from_2_sigmas() {
        let rows = [0.0, 4.9, -5.0, 6.5, -6.5, 8.0, 50.0].map(row_trust);
        assert_eq!(rows, [1.0, 1.0, 1.0, 0.5, 0.5, 0.0, 0.0]);
        assert_eq!([1.0, 2.0, 2.5, 3.0].map(surfel_trust), [1.0, 1.0, 0.5, 0.0]);
    }

    #[test]
    fn trust_scales_weight_and_cost() {
        let mut batch = RowBatch::default();
        batch.begin_robust(0.5, 0, 4.0);
        assert_eq!(batch.cost(), 0.5 * huber(4.0).1);
        let weights: Vec<f64> = batch.rows().map(|row| row.weight).collect();
        assert_eq!(weights, [0.5 * huber(4.0).0]);
    }
}
