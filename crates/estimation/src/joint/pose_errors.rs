//! Errors of poses that come from a file: their size and how long they last, estimated from the scans.
//!
//! The standard deviations in such a file are those of a filter, and nothing says how errors at different times are
//! correlated. Of each component, a first-order Gauss-Markov process x with σ and a = e^(−Δ/τ) from knot to knot, the
//! innovations e_k = (x_k − a x_(k−1)) / (σ √(1 − a²)) give σ² = (Ω σ² + ν σ₀²) / (r + ν), with Ω = Σ e² and r = Σ (1 − E), E the
//! variance of e by the covariance P of the adjustment (Förstner 1979), and the stated σ₀ as if it came from ν observations.
//! a is Σ (x_k x_(k−1) + P_(k,k−1)) / Σ (x²_(k−1) + P_(k−1,k−1)) (expectation maximisation, Shumway and Stoffer 1982).

use nalgebra::DMatrix;

use super::motion::{GaussMarkov, MAX_FACTOR};
use super::problem::JointProblem;
use super::result::PoseErrors;
use super::state::State;

/// ν: a stated σ counts like one from this many observations, known to half of itself (1/√(2ν)).
const STATED_OBSERVATIONS: f64 = 2.0;
/// A component is determined from this redundancy on: its σ is then known to 22 % (1/√(2r)).
const LEAST_REDUNDANCY: f64 = 10.0;
/// Least standard deviation, radians and metres: a scanner cannot see smaller errors.
const LEAST_SIGMA: f64 = 1e-6;
/// Number of components: δφ in the body, δp in the world.
const COMPONENTS: usize = 6;

/// The covariance of the errors at two knots; `None` if it is not known.
pub type KnotCovariance<'a> = dyn Fn(usize, usize) -> Option<DMatrix<f64>> + 'a;

/// The errors of a process after the adjustment and before it.
pub fn pose_errors(
    after: &GaussMarkov,
    before: &GaussMarkov,
    covariance: &KnotCovariance<'_>,
) -> Option<PoseErrors> {
    let sums = sums(after, covariance)?;
    Some(PoseErrors {
        sigma: std::array::from_fn(|i| after.sigma[i]),
        stated_sigma: std::array::from_fn(|i| before.sigma[i]),
        correlation_s: std::array::from_fn(|i| after.correlation_s[i]),
        is_determined: sums.map(|sums| sums.is_redundant()),
    })
}

/// Estimates σ and τ of the errors of all poses from files. The problem must hold the factor at a state with the present
/// values. Returns the largest change, as a logarithm.
pub fn learn_pose_errors(problem: &JointProblem<'_>, state: &mut State) -> f64 {
    let firsts = &problem.layout.first_motion;
    let ranges = state
        .motions
        .iter()
        .zip(firsts)
        .filter_map(|(motion, &first)| {
            let knots = motion.errors()?.knot_s.len();
            Some(first..first + knots)
        });
    let ranges: Vec<_> = ranges.collect();
    let Some(factor) = problem.factor().filter(|_| !ranges.is_empty()) else {
        return 0.0;
    };
    let inverse =
        factor.selected_inverse(|block| ranges.iter().any(|range| range.contains(&block)));
    let drives = &problem.input.drives;
    let motions = state.motions.iter_mut().zip(drives).zip(firsts);
    let changes = motions.filter_map(|((motion, drive), &first)| {
        let (process, stated) = (motion.errors_mut()?, drive.motion.errors()?);
        let covariance = |a: usize, b: usize| inverse.block(first + a, first + b);
        Some(learn_from(process, &stated.sigma, &covariance))
    });
    changes.fold(0.0, f64::max)
}

/// The same for one process, with its stated standard deviations and the covariance of its knots.
pub fn learn_from(
    process: &mut GaussMarkov,
    stated_sigma: &[f64],
    covariance: &KnotCovariance<'_>,
) -> f64 {
    let Some(sums) = sums(process, covariance) else {
        return 0.0;
    };
    let interval_s = process.span_s() / (process.knot_s.len() - 1) as f64;
    let mut change = 0.0_f64;
    for (component, sums) in sums.iter().enumerate() {
        let stated = (stated_sigma[component] / process.sigma[component]).powi(2);
        let factor = (sums.squares + STATED_OBSERVATIONS * stated)
            / (sums.redundancy.max(0.0) + STATED_OBSERVATIONS);
        let factor = factor.sqrt().clamp(1.0 / MAX_FACTOR, MAX_FACTOR);
        let sigma = (process.sigma[component] * factor).max(LEAST_SIGMA);
        change = change.max((sigma / process.sigma[component]).ln().abs());
        process.sigma[component] = sigma;
        let a = sums.products / sums.squares_before;
        process.correlation_s[component] = process.correlation_time_s(component, a, interval_s);
    }
    change
}

/// Sums over the knots of a component.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Σ e².
    squares: f64,
    /// Σ (1 − E).
    redundancy: f64,
    /// Σ (x_k x_(k−1) + P_(k,k−1)).
    products: f64,
    /// Σ (x²_(k−1) + P_(k−1,k−1)).
    squares_before: f64,
}

impl Sums {
    fn is_redundant(&self) -> bool {
        self.redundancy > LEAST_REDUNDANCY
    }
}

/// The sums of all components; `None` if a covariance is not known.
fn sums(process: &GaussMarkov, covariance: &KnotCovariance<'_>) -> Option<[Sums; COMPONENTS]> {
    let mut all = [Sums::default(); COMPONENTS];
    let mut before = covariance(0, 0)?;
    for knot in 1..process.knot_s.len() {
        let (here, between) = (covariance(knot, knot)?, covariance(knot - 1, knot)?);
        let elapsed_s = process.knot_s[knot] - process.knot_s[knot - 1];
        for (i, sums) in all.iter_mut().enumerate() {
            let [x, y] = [knot, knot - 1].map(|k| process.at_knot(k)[i]);
            let [p, q, pq] = [&here, &before, &between].map(|block| block[(i, i)]);
            let a = (-elapsed_s / process.correlation_s[i]).exp();
            let variance = process.sigma[i].powi(2) * (1.0 - a * a);
            sums.squares += (x - a * y).powi(2) / variance;
            sums.redundancy += 1.0 - (p - 2.0 * a * pq + a * a * q) / variance;
            sums.products += x * y + pq;
            sums.squares_before += y * y + q;
        }
        before = here;
    }
    Some(all)
}
