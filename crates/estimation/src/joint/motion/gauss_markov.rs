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
    /// τ of each component, seconds.
    pub correlation_s: Vec<f64>,
    /// Values at the knots, one after the other.
    pub value: Vec<f64>,
    /// Knots after a jump: they are not tied to the knot before.
    pub restarts: Vec<usize>,
}

/// Standard deviation of a component after a jump.
const RESTART_SIGMA: f64 = 0.05;
/// A step is a jump if it exceeds this many robust standard deviations of all steps.
const JUMP_SIGMAS: f64 = 8.0;
/// Least size of a jump, radians and metres.
const LEAST_JUMP: f64 = 3e-4;

/// Knots per correlation time. Between knots the process is a straight line, which leaves out a variance
/// of at most σ²/(3·KNOTS) at mid-interval.
const KNOTS: f64 = 5.0;

/// Largest factor on a standard deviation and on a correlation time in one estimate of them.
pub const MAX_FACTOR: f64 = 4.0;
/// Fewest knots within a correlation time; fewer do not determine it.
const LEAST_KNOTS: f64 = 2.0;

impl GaussMarkov {
    /// A process at rest over a span, with knots no farther apart than a share of the correlation time.
    pub fn new((from_s, to_s): (f64, f64), sigma: Vec<f64>, correlation_s: f64) -> Self {
        let count = ((to_s - from_s) * KNOTS / correlation_s).ceil().max(1.0);
        let steps = count as usize;
        let knot = |k: usize| from_s + (to_s - from_s) * k as f64 / count;
        Self::at_knots((0..=steps).map(knot).collect(), sigma, correlation_s)
    }

    /// A process at rest with these knots, two or more.
    pub fn at_knots(knot_s: Vec<f64>, sigma: Vec<f64>, correlation_s: f64) -> Self {
        Self {
            value: vec![0.0; knot_s.len() * sigma.len()],
            knot_s,
            correlation_s: vec![correlation_s; sigma.len()],
            sigma,
            restarts: Vec::new(),
        }
    }

    /// Time from the first knot to the last, seconds.
    pub fn span_s(&self) -> f64 {
        self.knot_s[self.knot_s.len() - 1] - self.knot_s[0]
    }

    /// Variance that straight lines between the knots leave out, as a share of σ²: h/(3τ) on average over
    /// intervals of h.
    pub fn left_out_share(&self, component: usize) -> f64 {
        self.span_s() / (self.knot_s.len() - 1) as f64 / (3.0 * self.correlation_s[component])
    }

    /// The correlation time of a component by an estimate a of its correlation from knot to knot, knots being `interval_s`
    /// apart: −Δ/ln a, within [`MAX_FACTOR`] of the present one.
    pub fn correlation_time_s(&self, component: usize, a: f64, interval_s: f64) -> f64 {
        let a = a.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON);
        let old_s = self.correlation_s[component];
        let found_s = (-interval_s / a.ln()).clamp(old_s / MAX_FACTOR, old_s * MAX_FACTOR);
        found_s.max(LEAST_KNOTS * interval_s).min(self.span_s())
    }

    /// Number of components.
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

    /// The values of all components at a knot.
    pub fn at_knot(&self, knot: usize) -> &[f64] {
        let d = self.dimension();
        &self.value[knot * d..(knot + 1) * d]
    }

    /// The value of a component at a time.
    pub fn at(&self, time_s: f64, component: usize) -> f64 {
        let (knot, u) = self.locate(time_s);
        self.at_knot(knot)[component] * (1.0 - u) + self.at_knot(knot + 1)[component] * u
    }

    /// Changes of a component from knot to knot, indexed by the later knot.
    fn steps(&self, component: usize) -> Vec<f64> {
        let value = |k: usize| self.at_knot(k)[component];
        let steps = (1..self.knot_s.len()).map(|k| value(k) - value(k - 1));
        std::iter::once(0.0).chain(steps).collect()
    }

    /// The largest jump: its size in robust standard deviations of all steps, and the knot after it. Steps are taken by
    /// themselves, and relative to another process with the same knots that moves less there: motion that the poses
    /// follow is the same in all processes and cancels in their difference.
    pub fn jump(&self, others: &[&Self]) -> Option<(f64, usize)> {
        let knots = 1..self.knot_s.len();
        let is_candidate = |k: usize| {
            // A knot between two jumps would not be determined, and the remainder of a neighbouring jump is not another one.
            let is_near = |r: &usize| r.abs_diff(k) <= 2;
            let is_beside = |r: &usize| *r != k && is_near(r);
            !self.restarts.iter().any(is_near)
                && !others
                    .iter()
                    .any(|other| other.restarts.iter().any(is_beside))
        };
        let candidates: Vec<usize> = knots.filter(|&k| is_candidate(k)).collect();
        let mut worst = None;
        let mut consider = |steps: &[f64], reference: Option<&[f64]>| {
            let step =
                |k: usize| (steps[k] - reference.map_or(0.0, |reference| reference[k])).abs();
            let Some(typical) = median(candidates.iter().map(|&k| step(k))) else {
                return;
            };
            let is_larger =
                |k: usize| reference.is_none_or(|reference| steps[k].abs() > reference[k].abs());
            for &k in candidates
                .iter()
                .filter(|&&k| step(k) > LEAST_JUMP && is_larger(k))
            {
                let ratio = step(k) / (SIGMAS_PER_MAD * typical);
                if ratio > worst.map_or(JUMP_SIGMAS, |(most, _)| most) {
                    worst = Some((ratio, k));
                }
            }
        };
        for component in 0..self.dimension() {
            let steps = self.steps(component);
            consider(&steps, None);
            for other in others {
                consider(&steps, Some(&other.steps(component)));
            }
        }
        worst
    }

    /// Adds the rows that tie knot `knot` to the one before, the first to zero:
    /// (x_k − e^(−Δ/τ) x_(k−1)) / (σ √(1 − e^(−2Δ/τ))) of each component. `first_block` is the block
    /// of knot 0.
    pub fn rows(&self, knot: usize, first_block: usize, group: usize, batch: &mut RowBatch) {
        let alone = |_| 0.0;
        rows_together(&[(self, first_block)], &alone, knot, group, batch);
    }

    /// The innovation of a component at a knot, in standard deviations.
    fn innovation(&self, knot: usize, component: usize) -> Innovation {
        let here = self.at_knot(knot)[component];
        let sigma = self.sigma[component].max(f64::MIN_POSITIVE);
        let untied = |sigma: f64| Innovation {
            value: here / sigma,
            by_here: 1.0 / sigma,
            by_before: None,
        };
        if self.restarts.contains(&knot) {
            return untied(RESTART_SIGMA);
        }
        let Some(before) = knot.checked_sub(1) else {
            return untied(sigma);
        };
        let elapsed_s = self.knot_s[knot] - self.knot_s[before];
        let decay = (-elapsed_s / self.correlation_s[component]).exp();
        let scale = 1.0 / (sigma * (1.0 - decay * decay).sqrt());
        Innovation {
            value: (here - decay * self.at_knot(before)[component]) * scale,
            by_here: scale,
            by_before: Some(-decay * scale),
        }
    }
}

/// Change of a process at a knot beyond the prediction from the knot before, in standard deviations.
#[derive(Clone, Copy)]
struct Innovation {
    value: f64,
    by_here: f64,
    /// `None` at the first knot, and after a jump.
    by_before: Option<f64>,
}

/// Adds the rows of processes with the same knots whose innovations z have the correlation ρ with each other, 0 to
/// 1, given for each component. The row of process s is z_s minus its prediction c Σ z from the m processes before it,
/// over √v, where v is the variance of the difference, c = ρ/(1 + (m − 1) ρ) and v = 1 − m ρ c. Each process comes with
/// its block of knot 0. A process that jumps is independent of the others.
pub fn rows_together(
    processes: &[(&GaussMarkov, usize)],
    correlation: &dyn Fn(usize) -> f64,
    knot: usize,
    group: usize,
    batch: &mut RowBatch,
) {
    let dimension = processes[0].0.dimension();
    let mut by = vec![0.0; dimension];
    for component in 0..dimension {
        let rho = correlation(component);
        let mut before: Vec<(Innovation, usize)> = Vec::new();
        for &(process, first_block) in processes {
            let innovation_here = process.innovation(knot, component);
            let jumped = process.restarts.contains(&knot);
            let others = if jumped { &[] } else { before.as_slice() };
            let m = others.len() as f64;
            let c = rho / (1.0 + (m - 1.0) * rho);
            let scale = (1.0 - m * rho * c).sqrt().recip();
            let predicted: f64 = others.iter().map(|(other, _)| c * other.value).sum();
            batch.begin(group, 1.0, (innovation_here.value - predicted) * scale);
            let by_others = others.iter().map(|&(other, first)| (other, first, -c));
            for (innovation, first, share) in by_others.chain([(innovation_here, first_block, 1.0)])
            {
                if let Some(by_before) = innovation.by_before {
                    by[component] = share * by_before * scale;
                    batch.touch(first + knot - 1, &by);
                }
                by[component] = share * innovation.by_here * scale;
                batch.touch(first + knot, &by);
            }
            by[component] = 0.0;
            if !jumped {
                before.push((innovation_here, first_block));
            }
        }
    }
}
