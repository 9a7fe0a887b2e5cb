//! Errors that are correlated in time: first-order Gauss-Markov processes at knots.

use super::super::row::RowBatch;
use crate::statistics::{SIGMAS_PER_MAD, median};

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
    /// Knots before which it jumped: they are not tied to the one before.
    pub restarts: Vec<usize>,
}

/// Standard deviation of a component after a jump.
const RESTART_SIGMA: f64 = 0.05;
/// A step is a jump where it is this many times as large as the robust standard deviation of all steps.
const JUMP_SIGMAS: f64 = 8.0;
/// And at least this large, radians and metres.
const LEAST_JUMP: f64 = 3e-4;

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
            restarts: Vec::new(),
        }
    }

    /// From the first knot to the last, seconds.
    pub fn span_s(&self) -> f64 {
        self.knot_s[self.knot_s.len() - 1] - self.knot_s[0]
    }

    /// Variance that straight lines between the knots leave out, as a share of σ²: h/(3τ) on average over
    /// intervals of h.
    pub fn left_out_share(&self) -> f64 {
        self.span_s() / (self.knot_s.len() - 1) as f64 / (3.0 * self.correlation_s)
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

    /// Restarts it where it jumped by most; returns whether there is such a knot.
    pub fn restart(&mut self) -> bool {
        let (d, knots) = (self.dimension(), self.knot_s.len());
        let mut worst = (JUMP_SIGMAS, 0);
        for component in 0..d {
            let step =
                |k: usize| (self.of_knot(k)[component] - self.of_knot(k - 1)[component]).abs();
            // A knot between two jumps would float.
            let is_near = |k: usize| self.restarts.iter().any(|r| r.abs_diff(k) <= 2);
            let tied = (1..knots).filter(|&k| !is_near(k));
            let Some(typical) = median(tied.clone().map(step)) else {
                continue;
            };
            for k in tied.filter(|&k| step(k) > LEAST_JUMP) {
                let ratio = step(k) / (SIGMAS_PER_MAD * typical);
                if ratio > worst.0 {
                    worst = (ratio, k);
                }
            }
        }
        let jumped = worst.1 > 0;
        if jumped {
            self.restarts.push(worst.1);
        }
        jumped
    }

    /// Adds the rows that tie knot `knot` to the one before, the first to zero:
    /// (x_k − e^(−Δ/τ) x_(k−1)) / (σ √(1 − e^(−2Δ/τ))) of each component. `first_block` is the block
    /// of knot 0.
    pub fn rows(&self, knot: usize, first_block: usize, group: usize, batch: &mut RowBatch) {
        let d = self.dimension();
        let mut own = vec![0.0; d];
        for component in 0..d {
            let here = self.of_knot(knot)[component];
            let restarts = self.restarts.contains(&knot);
            let sigma = match restarts {
                true => RESTART_SIGMA,
                false => self.sigma[component].max(f64::MIN_POSITIVE),
            };
            let Some(before) = knot.checked_sub(1).filter(|_| !restarts) else {
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
