//! Summary of the points in a cylinder, and the level of detection.

use super::settings::{Aggregation, ComparisonSettings, Detection};
use super::sums;
use crate::statistics::{NORMAL_97_5, NORMAL_97_5_ROUNDED, quartile, student_97_5};

/// The points of one cloud in a cylinder, summarised by their heights along its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub(super) count: u32,
    /// Mean or median, metres; NaN without points.
    pub(super) middle: f64,
    /// Square of the standard deviation (divided by n − 1) or of the inter-quartile range, square
    /// metres; NaN for fewer than two points.
    pub(super) variance: f64,
}

impl Sample {
    /// The summary of no points.
    pub(super) const NONE: Self = Self {
        count: 0,
        middle: f64::NAN,
        variance: f64::NAN,
    };

    /// Summarises the `heights` whose weight is 1; `weights` has the same length, the others are 0.
    /// `sorted` is a buffer.
    pub(super) fn new(
        heights: &[f64],
        weights: &[f64],
        aggregation: Aggregation,
        sorted: &mut Vec<f64>,
    ) -> Self {
        let (count, middle, variance) = match aggregation {
            Aggregation::Mean => {
                // 0/0 gives NaN, the mean of no points.
                let [n, sum] = sums::both(weights, heights);
                let mean = sum / n;
                (
                    n,
                    mean,
                    sums::squares_about(mean, heights, weights) / (n - 1.0),
                )
            }
            Aggregation::Median => {
                let inside = heights
                    .iter()
                    .zip(weights)
                    .filter(|(_, weight)| **weight > 0.0);
                sorted.clear();
                sorted.extend(inside.map(|(height, _)| *height));
                sorted.sort_unstable_by(f64::total_cmp);
                let range = quartile(sorted, 3) - quartile(sorted, 1);
                (sorted.len() as f64, quartile(sorted, 2), range * range)
            }
        };
        Self {
            count: count as u32,
            middle,
            variance: if count < 2.0 { f64::NAN } else { variance },
        }
    }

    fn variance_of_middle(&self) -> f64 {
        self.variance / f64::from(self.count)
    }
}

/// The level of detection at 95 %, metres, as defined in [`super::m3c2`](mod@super::m3c2); NaN if a
/// sample has fewer than two points or fewer than the settings require.
pub(super) fn level_of_detection(
    reference: &Sample,
    compared: &Sample,
    settings: &ComparisonSettings,
) -> f64 {
    if reference.count.min(compared.count) < settings.min_points.max(2) {
        return f64::NAN;
    }
    let (a, b) = (
        reference.variance_of_middle(),
        compared.variance_of_middle(),
    );
    let sampling = (a + b).sqrt();
    let registration = settings.registration_error_m;
    match settings.detection {
        Detection::Normal => NORMAL_97_5_ROUNDED * (sampling + registration),
        Detection::Student => {
            let scaled_sampling = if sampling > 0.0 {
                let (share_a, share_b) = (a / (a + b), b / (a + b));
                let dof = 1.0
                    / (share_a * share_a / f64::from(reference.count - 1)
                        + share_b * share_b / f64::from(compared.count - 1));
                student_97_5(dof) * sampling
            } else {
                0.0
            };
            scaled_sampling + NORMAL_97_5 * registration
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(heights: &[f64]) -> Sample {
        Sample::new(
            heights,
            &vec![1.0; heights.len()],
            Aggregation::Mean,
            &mut vec![],
        )
    }

    #[test]
    fn student_widens_the_level_of_detection_of_few_points() {
        let settings = |detection| ComparisonSettings {
            registration_error_m: 0.5,
            detection,
            ..ComparisonSettings::default()
        };
        let (normal, student) = (settings(Detection::Normal), settings(Detection::Student));
        // Variances 2 and 8 of three points each: 10/3 of the difference of the means, with
        // ν = (2/3 + 8/3)² / ((2/3)²/2 + (8/3)²/2) = 50/17.
        let s = 2f64.sqrt();
        let (a, b) = (sample(&[-s, 0.0, s]), sample(&[-2.0 * s, 0.0, 2.0 * s]));
        let sampling = (10.0f64 / 3.0).sqrt();
        let found = level_of_detection(&a, &b, &normal);
        assert!((found - 1.96 * (sampling + 0.5)).abs() < 1e-14);
        // scipy.stats.t.ppf(0.975, 50 / 17)
        let expected = 3.218_758_614_532 * sampling + NORMAL_97_5 * 0.5;
        let found = level_of_detection(&a, &b, &student);
        assert!((found - expected).abs() < 1e-11, "{found} {expected}");
        // Without spread, only the registration error contributes.
        let flat = sample(&[1.0, 1.0]);
        let found = level_of_detection(&flat, &flat, &student);
        assert_eq!(found, NORMAL_97_5 * 0.5);
        let single = sample(&[1.0]);
        assert!(level_of_detection(&flat, &single, &student).is_nan());
        assert!(level_of_detection(&single, &flat, &normal).is_nan());
    }
}
