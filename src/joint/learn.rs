//! How much mountings move in time, and over how long: what an adjustment says about its own prior.

use super::bend::Bends;
use super::components::{PROBES, sign};
use super::motion::GaussMarkov;
use super::problem::JointProblem;

/// Largest factor on a standard deviation and on the correlation time at a time.
const MAX_FACTOR: f64 = 4.0;
/// Least standard deviation, radians and metres: less moves no point by what a scanner sees.
const LEAST_SIGMA: f64 = 1e-5;
/// Knots within a correlation time at least; fewer say nothing of it.
const LEAST_KNOTS: f64 = 2.0;
/// Fewest knots' worth of what is known beyond the prior.
const LEAST_REDUNDANCY: f64 = 10.0;

/// Finds the standard deviations of rotations and shifts, and the correlation time of both, of all scanners
/// together, where the problem holds the factor at a state with these values.
///
/// With e_k = x_k − a x_(k−1), a = e^(−Δ/τ), and P the covariance of the knots x, the standard deviations
/// follow Σ e²/(1 − a²) = σ² Σ (1 − E/(σ² (1 − a²))), E the variance of e (Förstner 1979), and
/// a = Σ (x_k x_(k−1) + P_(k,k−1)) / Σ (x²_(k−1) + P_(k−1,k−1)) (expectation and maximisation, Shumway and
/// Stoffer 1982). Sums over P are found by probes of signs z: E z_i (P z)_j is P_ij (Hutchinson 1990).
///
/// Returns the largest relative change.
pub fn learn(problem: &JointProblem<'_>, bends: &mut Bends) -> f64 {
    let (Some(factor), Some(first)) = (problem.factor(), bends.knots.first()) else {
        return 0.0;
    };
    let correlation_s = first[0].correlation_s;
    let unknowns = problem.unknowns();
    let mut knots: Vec<(&GaussMarkov, usize, usize)> = Vec::new();
    let places = problem.layout.knots.iter().flatten();
    for (process, &place) in bends.knots.iter().flatten().zip(places) {
        let of_knot = |knot: usize| (process, knot, problem.offset(place + knot));
        knots.extend((0..process.knot_s.len()).map(of_knot));
    }
    let mut sides = vec![0.0; unknowns * PROBES];
    for (probe, side) in sides.chunks_exact_mut(unknowns).enumerate() {
        for (_, _, at) in &knots {
            (*at..at + 6).for_each(|i| side[i] = sign(probe, i));
        }
    }
    factor.solve(&mut sides, PROBES);
    let covariance = |i: usize, j: usize| {
        let probes = sides.chunks_exact(unknowns).enumerate();
        let terms =
            probes.map(|(probe, side)| 0.5 * (sign(probe, i) * side[j] + sign(probe, j) * side[i]));
        terms.sum::<f64>() / PROBES as f64
    };
    // Of rotations and of shifts: Σ e²/(1 − a²) and redundancy; of both: products and squares.
    let (mut squares, mut redundancy) = ([0.0; 2], [0.0; 2]);
    let (mut products, mut before_squares) = (0.0, 0.0);
    let (mut elapsed_sum_s, mut intervals) = (0.0, 0.0);
    let tied = |(process, knot, _): &&(&GaussMarkov, usize, usize)| {
        *knot > 0 && !process.restarts.contains(knot)
    };
    for &(process, knot, at) in knots.iter().filter(tied) {
        let elapsed_s = process.knot_s[knot] - process.knot_s[knot - 1];
        let a = (-elapsed_s / correlation_s).exp();
        elapsed_sum_s += elapsed_s;
        intervals += 1.0;
        let (x, y) = (process.of_knot(knot), process.of_knot(knot - 1));
        for i in (0..6).filter(|&i| process.sigma[i] >= LEAST_SIGMA) {
            let variance = process.sigma[i].powi(2);
            let (here, before) = (at + i, at + i - 6);
            let (of_here, of_before) = (covariance(here, here), covariance(before, before));
            let of_both = covariance(here, before);
            let e = x[i] - a * y[i];
            let of_e = of_here - 2.0 * a * of_both + a * a * of_before;
            squares[i / 3] += e * e / (1.0 - a * a);
            redundancy[i / 3] += 1.0 - of_e / (variance * (1.0 - a * a));
            products += (x[i] * y[i] + of_both) / variance;
            before_squares += (y[i] * y[i] + of_before) / variance;
        }
    }
    let limited = |value: f64, old: f64| value.clamp(old / MAX_FACTOR, old * MAX_FACTOR);
    let elapsed_s = elapsed_sum_s / f64::max(intervals, 1.0);
    let a = (products / before_squares).clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON);
    let found_s = limited(-elapsed_s / a.ln(), correlation_s);
    let mut change = 0.0_f64;
    for process in bends.knots.iter_mut().flatten() {
        for (i, sigma) in process.sigma.iter_mut().enumerate() {
            if *sigma >= LEAST_SIGMA && redundancy[i / 3] > LEAST_REDUNDANCY {
                let found = (squares[i / 3] / redundancy[i / 3]).sqrt();
                let found = limited(found, *sigma).max(LEAST_SIGMA);
                change = change.max((found / *sigma).ln().abs());
                *sigma = found;
            }
        }
        if before_squares > 0.0 {
            let most_s = process.span_s();
            process.correlation_s = found_s.max(LEAST_KNOTS * elapsed_s).min(most_s);
        }
    }
    change
}
