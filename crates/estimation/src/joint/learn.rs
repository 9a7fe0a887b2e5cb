//! Estimates the prior of the mountings' motion in time from the adjustment itself: standard deviations, correlation
//! time, and correlation between scanners.

use super::bend::Bends;
use super::components::{PROBES, sign};
use super::motion::{GaussMarkov, MAX_FACTOR};
use super::problem::JointProblem;
use super::state::State;

/// Least standard deviation, radians and metres: a scanner cannot see smaller motions.
pub const LEAST_SIGMA: f64 = 1e-5;
/// Largest correlation between scanners: one thirtieth of the motion is then individual.
const MOST_TOGETHER: f64 = 0.999;
/// Largest exponent of a Newton step.
const MAX_EXPONENT: f64 = 2.0;
/// Least redundancy for an estimate, in numbers of knots.
const LEAST_REDUNDANCY: f64 = 10.0;

/// Estimates the standard deviations of rotations and shifts, the correlation time of both, and the correlation between
/// scanners. The problem must hold the factor at a state with the present values. Sums over the covariance P are
/// estimated with random signs z, because E z_i (P z)_j is P_ij (Hutchinson 1990).
///
/// Returns the largest change: of a standard deviation, as a logarithm, or of the individual part of a scanner's
/// motion, √(1 − ρ).
pub fn learn(problem: &JointProblem<'_>, state: &mut State) -> f64 {
    let bends = state.bends.as_mut().filter(|bends| !bends.knots.is_empty());
    let (Some(factor), Some(bends)) = (problem.factor(), bends) else {
        return 0.0;
    };
    let offsets = |of_drive: &Vec<usize>| of_drive.iter().map(|&b| problem.offset(b)).collect();
    let offsets: Vec<Vec<usize>> = problem.layout.knots.iter().map(offsets).collect();
    let unknowns = problem.unknowns();
    let mut sides = vec![0.0; unknowns * PROBES];
    for (probe, side) in sides.chunks_exact_mut(unknowns).enumerate() {
        let processes = bends.knots.iter().flatten();
        for (process, &first) in processes.zip(offsets.iter().flatten()) {
            (first..first + process.value.len()).for_each(|i| side[i] = sign(probe, i));
        }
    }
    factor.solve(&mut sides, PROBES);
    learn_from(bends, &offsets, &|i, j| {
        let probes = sides.chunks_exact(unknowns).enumerate();
        let terms =
            probes.map(|(probe, side)| 0.5 * (sign(probe, i) * side[j] + sign(probe, j) * side[i]));
        terms.sum::<f64>() / PROBES as f64
    })
}

/// As [`learn`], with the covariance P of all unknowns; `offsets` are the places of the first knot of each scanner of
/// each drive.
///
/// With the innovations e_k = (x_k − a x_(k−1)) / (σ √(1 − a²)), a = e^(−Δ/τ), the common motion of n scanners, Σ e over
/// √n, has the variance λ = 1 + (n − 1) ρ, and the individual motion of each 1 − ρ. The factors on both variances are
/// Σ e²/λ over Σ (1 − E/λ), with E the variance of e by P (Förstner 1979); they give σ² and ρ. The correlation from knot
/// to knot is a = Σ (x_k x_(k−1) + P_(k,k−1)) / Σ (x²_(k−1) + P_(k−1,k−1)) (expectation maximisation, Shumway and
/// Stoffer 1982).
pub fn learn_from(
    bends: &mut Bends,
    offsets: &[Vec<usize>],
    covariance: &dyn Fn(usize, usize) -> f64,
) -> f64 {
    let mut sums = Sums::default();
    for (of_drive, offsets) in bends.knots.iter().zip(offsets) {
        sums.add(of_drive, offsets, bends.together, covariance);
    }
    let mut change = 0.0_f64;
    for class in 0..2 {
        let n = free(&bends.knots[0], 3 * class).len() as f64;
        if n == 0.0 {
            continue;
        }
        let within = |factor: f64| factor.clamp(MAX_FACTOR.powi(-2), MAX_FACTOR.powi(2));
        let rho = bends.together[class];
        let common = (1.0 + (n - 1.0) * rho) * within(sums.common[class].factor());
        let individual =
            (1.0 - rho) * within(sums.individual[class].individual_factor(&sums.common[class]));
        let both = (common + (n - 1.0) * individual) / n;
        bends.together[class] = ((common - individual) / (n * both)).clamp(0.0, MOST_TOGETHER);
        for process in bends.knots.iter_mut().flatten() {
            for sigma in &mut process.sigma[3 * class..3 * class + 3] {
                if *sigma >= LEAST_SIGMA {
                    *sigma = (*sigma * both.sqrt()).max(LEAST_SIGMA);
                }
            }
        }
        let [share, share_before] = [bends.together[class], rho].map(|rho| (1.0 - rho).sqrt());
        change = change.max((0.5 * both.ln()).abs().max((share - share_before).abs()));
    }
    if let Some((a, elapsed_s)) = sums.correlation() {
        for process in bends.knots.iter_mut().flatten() {
            let found_s = process.correlation_time_s(0, a, elapsed_s);
            process.correlation_s.fill(found_s);
        }
    }
    change
}

/// The scanners whose motion in a component is not held.
fn free(of_drive: &[GaussMarkov], component: usize) -> Vec<usize> {
    let is_free = |s: &usize| of_drive[*s].sigma[component] >= LEAST_SIGMA;
    (0..of_drive.len()).filter(is_free).collect()
}

/// Sums over all knots after the first.
#[derive(Default)]
struct Sums {
    /// The common motion: rotations and shifts.
    common: [Mode; 2],
    /// The individual motion: rotations and shifts.
    individual: [Mode; 2],
    /// Σ x_k x_(k−1) / σ².
    products: f64,
    /// Σ x²_(k−1) / σ².
    squares_before: f64,
    elapsed_s: f64,
    intervals: f64,
}

impl Sums {
    fn add(
        &mut self,
        of_drive: &[GaussMarkov],
        offsets: &[usize],
        together: [f64; 2],
        covariance: &dyn Fn(usize, usize) -> f64,
    ) {
        let knot_s = &of_drive[0].knot_s;
        let jumped = |knot: usize| of_drive.iter().any(|p| p.restarts.contains(&knot));
        let free: Vec<Vec<usize>> = (0..6).map(|component| free(of_drive, component)).collect();
        for knot in (1..knot_s.len()).filter(|&knot| !jumped(knot)) {
            let elapsed_s = knot_s[knot] - knot_s[knot - 1];
            self.elapsed_s += elapsed_s;
            self.intervals += 1.0;
            for component in 0..6 {
                // The square of the sum over all scanners, and the sum of squares; each with its variance.
                let (mut sum, mut square) = ([0.0; 2], [0.0; 2]);
                for &s in &free[component] {
                    let process = &of_drive[s];
                    let variance = process.sigma[component].powi(2);
                    let a = (-elapsed_s / process.correlation_s[component]).exp();
                    let scale = (variance * (1.0 - a * a)).sqrt().recip();
                    let [x, y] = [knot, knot - 1].map(|k| process.at_knot(k)[component]);
                    let place = |s: usize, k: usize| offsets[s] + 6 * k + component;
                    let (p, q) = (place(s, knot), place(s, knot - 1));
                    let e = (x - a * y) * scale;
                    sum[0] += e;
                    square[0] += e * e;
                    for &t in &free[component] {
                        let (u, v) = (place(t, knot), place(t, knot - 1));
                        let covariance = covariance(p, u)
                            - a * (covariance(p, v) + covariance(q, u))
                            + a * a * covariance(q, v);
                        let of_other = process.sigma[component] / of_drive[t].sigma[component];
                        let covariance = covariance * scale * scale * of_other;
                        sum[1] += covariance;
                        if s == t {
                            square[1] += covariance;
                        }
                    }
                    self.products += (x * y + covariance(p, q)) / variance;
                    self.squares_before += (y * y + covariance(q, q)) / variance;
                }
                let n = free[component].len() as f64;
                if n > 0.0 {
                    let (class, rho) = (component / 3, together[component / 3]);
                    let mean = [sum[0] * sum[0] / n, sum[1] / n];
                    let lambda = 1.0 + (n - 1.0) * rho;
                    self.common[class].add(mean.map(|x| x / lambda), 1.0);
                    let remainder = [square[0] - mean[0], square[1] - mean[1]];
                    self.individual[class].add(remainder.map(|x| x / (1.0 - rho)), n - 1.0);
                }
            }
        }
    }

    /// The correlation a from knot to knot, and the mean interval between knots, seconds.
    fn correlation(&self) -> Option<(f64, f64)> {
        let a = self.products / self.squares_before;
        (self.squares_before > 0.0).then(|| (a, self.elapsed_s / self.intervals))
    }
}

/// Innovations of processes: the sum of their squares in standard deviations, their number, and their redundancy (the
/// number that the data determine beyond the prior).
#[derive(Clone, Copy, Default)]
struct Mode {
    squares: f64,
    count: f64,
    redundancy: f64,
}

impl Mode {
    fn add(&mut self, [square, variance]: [f64; 2], count: f64) {
        self.squares += square;
        self.count += count;
        self.redundancy += count - variance;
    }

    /// The factor on the variance.
    fn factor(&self) -> f64 {
        if self.redundancy > LEAST_REDUNDANCY {
            self.squares / self.redundancy
        } else {
            1.0
        }
    }

    /// The factor on the variance of the individual motion, which may be zero. Towards zero the variance falls slowly,
    /// because its redundancy vanishes; a Newton step is longer.
    fn individual_factor(&self, common: &Self) -> f64 {
        let ratio = self.factor() / common.factor();
        let exponent = if ratio < 1.0 && self.redundancy > LEAST_REDUNDANCY {
            (self.count / self.redundancy).min(MAX_EXPONENT)
        } else {
            1.0
        };
        common.factor() * ratio.powf(exponent)
    }
}
