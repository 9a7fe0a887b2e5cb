//! Errors against the truth of a simulation.

use crate::calibration::Calibration;
use crate::geometry::BodyFromScanner;
use crate::number;
use crate::statistics::NORMAL_97_5_ROUNDED;
use crate::verdict::Verdict;

/// Errors do not exceed this many standard deviations by chance: only 1 in 16 000 does.
const NEVER_BY_CHANCE: f64 = 4.0;

/// Number of `all` errors that may exceed 1.96 σ by chance: 1 in 20, plus 1.96 binomial standard
/// deviations.
fn outside_by_chance(all: usize) -> f64 {
    let n = all as f64;
    0.05 * n + NORMAL_97_5_ROUNDED * (n * 0.05 * 0.95).sqrt()
}

/// The verdict on the errors against a known truth, and whether the standard deviations cover them.
pub fn errors(calibration: &Calibration, truth: &[BodyFromScanner]) -> Option<Verdict> {
    let covariance = calibration.covariance.as_ref()?;
    let mut worst = [0.0f64; 2];
    let (mut outside, mut all, mut largest) = (0usize, 0usize, 0.0f64);
    for (scanner, (mounting, truth)) in calibration.mountings.iter().zip(truth).enumerate() {
        // In body axes like the covariance.
        let (turn, shift) = mounting.body_from_scanner.perturbation_from(truth);
        for (parameter, error) in shift.iter().chain(turn.iter()).enumerate() {
            let row = 6 * scanner + parameter;
            let variance = covariance[(row, row)];
            if variance > 0.0 {
                all += 1;
                let normalised = error.abs() / variance.sqrt();
                outside += usize::from(normalised > NORMAL_97_5_ROUNDED);
                largest = largest.max(normalised);
                let worst = &mut worst[parameter / 3];
                *worst = worst.max(error.abs());
            }
        }
    }
    let text = format!(
        "The largest errors against the simulated truth are {} and {:.3}°; {} of {all} errors \
         lie within their 95 % bounds, and all within {largest:.1} standard deviations.",
        number::length(worst[0]),
        worst[1].to_degrees(),
        all - outside
    );
    let covered = outside as f64 <= outside_by_chance(all) && largest < NEVER_BY_CHANCE;
    const CODE: &str = "truth.errors";
    (all > 0).then(|| {
        if covered {
            Verdict::good(CODE, text)
        } else {
            Verdict::fault(CODE, text)
        }
    })
}
