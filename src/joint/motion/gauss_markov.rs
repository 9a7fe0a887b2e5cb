//! Errors that are correlated in time: first-order Gauss-Markov processes at knots.

use super::super::row::RowBatch;

/// A stationary process of `dimension` independent components with E x(t) x(t + Δ) = σ² e^(−Δ/τ),
/// known at knots and linear between them.
#[derive(Debug, Clone)]
pub struct GaussMarkov {
    /// Times of the knots, seconds.
    pub knot_s: Vec<f64>,
    /// σ of each component.
    pub sigma: Vec<f64>,
    /// τ, seconds.
    pub correlation_s: f64,
    /// Values at the knots, one after the other.
    pub value: Vec<f64>,
}

/// Knots per correlation time: between them the process is a straight line, which leaves out a
/// variance of σ²/(3·KNOTS) at mid-interval at most.
const KNOTS: f64 = 5.0;

impl GaussMarkov {
    /// At rest over a span, with knots no farther apart than a share of the correlation time.
    pub fn new((from_s, to_s): (f64, f64), sigma: Vec<f64>, correlation_s: f64) -> Self {
        let count = ((to_s - from_s) * KNOTS / correlation_s).ceil().max(1.0);
        let steps = count as usize;
        let knot = |k: usize| from_s + (to_s - from_s) * k as f64 / count;
        Self::at_knots((0..=steps).map(knot).collect(), sigma, correlation_s)
    }

    /// At rest at these knots, two or more.
    pub fn at_knots(knot_s: Vec<f64>, sigma: Vec<f64>, correlation_s: f64) -> Self {
        Self {
            value: vec![0.0; knot_s.len() * sigma.len()],
            knot_s,
            sigma,
            correlation_s,
        }
    }

    /// Components.
    pub fn dimension(&self) -> usize {
        self.sigma.len()
    }

    /// The knot before a time and the fraction of the interval passed, within 0 to 1.
    pub fn locate(&self, time_s: f64) -> (usize, f64) {
        let after = self.knot_s.partition_point(|&t| t <= time_s);
        let knot = after.saturating_sub(1).min(self.knot_s.len() - 2);
        let (a, b) = (self.knot_s[knot], self.knot_s[knot + 1]);
        (knot, ((time_s - a) / (b - a)).clamp(0.0, 1.0))
    }

    /// The value of a component at a knot.
    pub fn of_knot(&self, knot: usize) -> &[f64] {
        let d = self.dimension();
        &self.value[knot * d..(knot + 1) * d]
    }

    /// The value of a component at a time.
    pub fn at(&self, time_s: f64, component: usize) -> f64 {
        let (knot, u) = self.locate(time_s);
        self.of_knot(knot)[component] * (1.0 - u) + self.of_knot(knot + 1)[component] * u
    }

    /// Adds the rows that tie knot `knot` to the one before, the first to zero:
    /// (x_k − e^(−Δ/τ) x_(k−1)) / (σ √(1 − e^(−2Δ/τ))) of each component. `first_block` is the block
    /// of knot 0.
    pub fn rows(&self, knot: usize, first_block: usize, group: usize, batch: &mut RowBatch) {
        let d = self.dimension();
        let mut own = vec![0.0; d];
        for component in 0..d {
            let sigma = self.sigma[component].max(f64::MIN_POSITIVE);
            let here = self.of_knot(knot)[component];
            let Some(before) = knot.checked_sub(1) else {
                own.fill(0.0);
                own[component] = 1.0 / sigma;
                batch.begin(group, 1.0, here / sigma);
                batch.touch(first_block + knot, &own);
                continue;
            };
            let elapsed_s = self.knot_s[knot] - self.knot_s[before];
            let keep = (-elapsed_s / self.correlation_s).exp();
            let scale = 1.0 / (sigma * (1.0 - keep * keep).sqrt());
            let residual = (here - keep * self.of_knot(before)[component]) * scale;
            batch.begin(group, 1.0, residual);
            own.fill(0.0);
            own[component] = -keep * scale;
            batch.touch(first_block + before, &own);
            own[component] = scale;
            batch.touch(first_block + knot, &own);
        }
    }
}
