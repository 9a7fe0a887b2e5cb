//! Slow motions of mountings during a drive.
//!
//! The trajectory follows a slow motion of a mounting as far as its sensors allow, so that it shows neither in the
//! residuals of the IMU nor in those of the scans, and yet the mean mounting is off by more than its standard deviation.
//! It shows in what all of them say together: in estimates of the motion with all unknowns free.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::bend::{CREEP_SIGMA, Rung, is_fixed};
use super::held::{HeldMotion, MODES};
use super::layout::ScannerBlocks;
use super::learn::LEAST_SIGMA;
use super::problem::JointProblem;
use super::row::RowBatch;
use super::score::{HeldValues, Score};
use super::state::State;

/// Probability that a mounting that does not move is taken for one that does.
const LEVEL: f64 = 1e-3;
/// Sizes of motions that are compared, by decade: the evidence changes little from one to the next.
const SIZES_PER_DECADE: f64 = 4.0;

/// Slow motions of the mountings in all drives; by default none.
#[derive(Default)]
pub struct SlowMotions {
    pub drives: Vec<DriveMotions>,
}

/// Slow motions of the mountings in a drive, and how likely they are.
pub struct DriveMotions {
    /// Index of the drive.
    pub drive: usize,
    /// The motions, their coefficients one after the other.
    pub motions: Vec<HeldMotion>,
    /// The coefficients.
    pub held: HeldValues,
    /// Variance of each coefficient: radians² or metres².
    pub variance: DVector<f64>,
    /// Logarithm of how much likelier the observations are if mountings move than if they do not.
    pub evidence: f64,
}

impl SlowMotions {
    /// Of all mountings but their fixed components, with the factor that the problem holds, at this state or one nearby.
    /// Without a factor there are none.
    pub fn of(problem: &JointProblem<'_>, state: &State) -> Self {
        let state = problem.factored().unwrap_or(state);
        let drives = 0..problem.input.drives.len();
        let drives = drives.filter_map(|drive| DriveMotions::of(problem, state, drive));
        Self {
            drives: drives.collect(),
        }
    }

    /// The blocks of the scanners' constants, with those of the motions in a drive, which lie after all unknowns.
    pub fn blocks(&self, problem: &JointProblem<'_>, drive: usize) -> ScannerBlocks {
        let of_drive = self.drives.iter().filter(|slow| slow.drive == drive);
        ScannerBlocks {
            motions: of_drive.flat_map(|slow| slow.motions.clone()).collect(),
            ..problem.layout.of_scanners.clone()
        }
    }

    /// The contradiction between the observations and mountings that move as a rung allows, in words. If mountings do not
    /// move, the likelihood ratio exceeds 1/α with a probability below α, since its expectation is one (Markov).
    pub fn contradiction(&self, problem: &JointProblem<'_>, rung: Rung) -> Option<String> {
        let drives = self.drives.iter();
        let drive = drives.max_by(|a, b| a.evidence.total_cmp(&b.evidence))?;
        let limit = self.drives.len() as f64 / LEVEL;
        if drive.evidence <= limit.ln() {
            return None;
        }
        let (value, score) = drive.clearest()?;
        let component = value % 6;
        let name = &problem.input.mountings[drive.motions[value / (6 * MODES)].scanner].name;
        let axis = ["x", "y", "z"][component % 3];
        let size = score.value.abs();
        let moves = if component < 3 {
            format!("turns about {axis}, by {:.3}°", size.to_degrees())
        } else {
            format!("shifts along {axis}, by {:.2} mm", 1e3 * size)
        };
        Some(format!(
            "scans and sensors contradict a {} mounting: they are 10^{:.1} times as likely if mountings move slowly (at \
             most 10^{:.1}), most clearly if scanner `{name}` {moves} (root mean square, {:.1} standard deviations)",
            rung.name(),
            drive.evidence / std::f64::consts::LN_10,
            limit.log10(),
            score.sigmas(),
        ))
    }
}

impl DriveMotions {
    fn of(problem: &JointProblem<'_>, state: &State, drive: usize) -> Option<Self> {
        let samples = problem.input.drives[drive].scans.samples.iter();
        let mut first = problem.layout.sizes.len();
        let mut motions = Vec::new();
        for (scanner, sample) in samples.enumerate() {
            let is_free = |component| !is_fixed(&problem.input.mountings[scanner], component);
            let profiles = sample.profiles.first().zip(sample.profiles.last());
            let span_s = profiles.map(|(first, last)| (first.time_s, last.time_s));
            if let Some((from_s, to_s)) = span_s.filter(|(from_s, to_s)| to_s > from_s)
                && (0..6).any(is_free)
            {
                motions.push(HeldMotion {
                    drive,
                    scanner,
                    first,
                    from_s,
                    duration_s: to_s - from_s,
                });
                first += 6 * MODES;
            }
        }
        if motions.is_empty() {
            return None;
        }
        let blocks = ScannerBlocks {
            motions: motions.clone(),
            ..problem.layout.of_scanners.clone()
        };
        let visit = |visit: &mut dyn FnMut(&RowBatch)| problem.visit_with(state, &blocks, visit);
        let held = problem.held_values(6 * MODES * motions.len(), None, visit)?;
        let is_free: Vec<bool> = motions
            .iter()
            .flat_map(|motion| {
                let mounting = &problem.input.mountings[motion.scanner];
                (0..6 * MODES).map(|value| !is_fixed(mounting, value % 6))
            })
            .collect();
        let (evidence, variance) = weigh(&held, &is_free);
        Some(Self {
            drive,
            motions,
            held,
            variance,
            evidence,
        })
    }

    /// The coefficient whose estimate is largest in its standard deviations.
    fn clearest(&self) -> Option<(usize, Score)> {
        let values = 0..self.variance.len();
        let free = values.filter(|&value| self.variance[value] > 0.0);
        free.filter_map(|value| Some((value, self.held.score(value)?)))
            .max_by(|(_, a), (_, b)| a.sigmas().total_cmp(&b.sigmas()))
    }
}

/// The evidence for motions, and the variance of each coefficient.
///
/// A motion of the size s is a random walk, whose mode k has the variance s²/k² in units of Σ 1/k²: s is its root mean
/// square. With the information I and the gradient g of the coefficients, and their variances S,
///
///   ln p(g | S) − ln p(g | 0) = ½ gᵀ S^½ (1 + S^½ I S^½)⁻¹ S^½ g − ½ ln |1 + S^½ I S^½|.
///
/// Rotations and shifts have a size each, from what scans can show to what frames do, all sizes equally likely by their
/// logarithm. That mountings move or do not is equally likely as well, and the variance is the mean over all cases.
pub fn weigh(held: &HeldValues, is_free: &[bool]) -> (f64, DVector<f64>) {
    let sizes = CREEP_SIGMA.map(sizes);
    let both = sizes[0].iter();
    let both = both.flat_map(|&turn_rad| sizes[1].iter().map(move |&shift_m| [turn_rad, shift_m]));
    let both: Vec<[f64; 2]> = both.collect();
    let squares = |k: usize| ((k + 1) as f64).powi(-2);
    let all_squares: f64 = (0..MODES).map(squares).sum();
    let deviations = |size: &[f64; 2]| {
        DVector::from_fn(is_free.len(), |value, _| {
            let share = squares(value / 6 % MODES) / all_squares;
            f64::from(is_free[value]) * size[value % 6 / 3] * share.sqrt()
        })
    };
    let ratios = both.par_iter().map(|size| {
        let deviations = deviations(size);
        let matrix = DMatrix::from_fn(is_free.len(), is_free.len(), |i, j| {
            deviations[i] * held.information[(i, j)] * deviations[j] + f64::from(i == j)
        });
        let Some(factor) = matrix.cholesky() else {
            return f64::NEG_INFINITY;
        };
        let l = factor.l_dirty();
        let gradient = deviations.component_mul(&held.gradient);
        let half_log: f64 = l.diagonal().iter().map(|pivot| pivot.ln()).sum();
        0.5 * gradient.dot(&factor.solve(&gradient)) - half_log
    });
    let ratios: Vec<f64> = ratios.collect();
    let largest = ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let likelihoods: Vec<f64> = ratios.iter().map(|ratio| (ratio - largest).exp()).collect();
    let sum: f64 = likelihoods.iter().sum();
    let evidence = largest + (sum / likelihoods.len() as f64).ln();
    let moves = (1.0 + (-evidence).exp()).recip();
    let mut variance = DVector::zeros(is_free.len());
    for (size, likelihood) in both.iter().zip(&likelihoods) {
        let deviations = deviations(size);
        variance += deviations.component_mul(&deviations) * (moves * likelihood / sum);
    }
    (evidence, variance)
}

/// Sizes of a motion, radians or metres.
fn sizes(most: f64) -> Vec<f64> {
    let decades = (most / LEAST_SIGMA).log10();
    let count = (SIZES_PER_DECADE * decades).round();
    let size = |i| LEAST_SIGMA * 10_f64.powf(decades * f64::from(i) / count);
    (0..=count as u32).map(size).collect()
}
