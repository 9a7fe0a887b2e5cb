//! Losses: the weight of a record as a function of its residual.
//!
//! The truncated loss is reached by graduated non-convexity (Yang, Antonante, Tzoumas, Carlone
//! 2020): the surrogate of the truncated quadratic starts convex and is sharpened by µ from round to
//! round,
//!   w = 1 where u ≤ µ/(µ+1) c², 0 where u ≥ (µ+1)/µ c², c √(µ(µ+1)/u) − µ between,
//! with u the squared normalised residual and c² the limit.

use crate::statistics::{chi_square, median};

/// The limit of the test as a quantile of the standard normal distribution: 1 good record in 10,000 exceeds it.
const LIMIT_NORMAL: f64 = 3.72;
/// The share of good records that exceed the limit.
const PASSING: f64 = 1e-4;
/// An excess over the expected number of more than this many standard deviations is not chance.
const CHANCE_SIGMAS: f64 = 3.0;
/// No good record exceeds this limit: 1 in 10⁹.
const FAR_NORMAL: f64 = 6.0;
/// Growth of µ from round to round.
const SHARPENING: f64 = 2.0;
/// Tuning constant of Huber's loss, standard deviations per component.
const HUBER_SIGMAS: f64 = 1.345;
/// Tuning constant of Cauchy's loss, standard deviations per component.
const CAUCHY_SIGMAS: f64 = 2.385;

/// How the cost of a record grows with its residual.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Loss {
    /// With the square of the residual.
    None,
    /// With the square of the residual up to 1.345 σ, linearly beyond (Huber 1964).
    Huber,
    /// With the logarithm of the square of the residual (Cauchy).
    Cauchy,
    /// With the square of the residual up to a limit, constant beyond, by graduated non-convexity (Yang,
    /// Antonante, Tzoumas, Carlone 2020): records beyond the limit are rejected and named.
    #[default]
    Truncated,
}

impl Loss {
    /// The weight ψ(u)/u of a record, given its number of components and its squared normalised residual;
    /// 1 for the truncated loss, because its limit depends on the other records.
    fn smooth_weight(self, components: f64, square: f64) -> f64 {
        match self {
            Self::Huber => (HUBER_SIGMAS * (components / square).sqrt()).min(1.0),
            Self::Cauchy => 1.0 / (1.0 + square / (CAUCHY_SIGMAS.powi(2) * components)),
            Self::None | Self::Truncated => 1.0,
        }
    }
}

/// The squared normalised residual beyond which a record with this number of components is an outlier, if
/// its standard deviation is right.
pub fn rejection_limit(components: f64) -> f64 {
    chi_square(components, LIMIT_NORMAL)
}

/// The square of the ratio between the residuals of a sensor and its standard deviations, from the
/// median of its squared normalised residuals; at least 1.
pub fn square_scale(components: f64, median: f64) -> f64 {
    (median / chi_square(components, 0.0)).max(1.0)
}

/// Records that share a loss and a test.
#[derive(Debug, Clone)]
pub struct LossGroup {
    pub loss: Loss,
    /// Number of components of each record.
    pub components: f64,
    /// Indices into the squares and weights of all records.
    pub records: Vec<usize>,
}

impl LossGroup {
    /// c²: the limit for records whose standard deviations are right, scaled up if the median of the
    /// residuals shows that the standard deviations of the group are too small.
    fn limit(&self, squares: &[f64]) -> f64 {
        self.scale(squares) * rejection_limit(self.components)
    }

    /// Whether more records exceed the limit than chance explains, or one exceeds it by far. Only then is
    /// a search for outliers worth its cost of ten adjustments.
    pub fn is_suspicious(&self, squares: &[f64]) -> bool {
        if self.loss == Loss::None {
            return false;
        }
        let scale = self.scale(squares);
        let beyond = |normal: f64| {
            let limit = scale * chi_square(self.components, normal);
            self.records.iter().filter(|&&i| squares[i] > limit).count()
        };
        let expected = PASSING * self.records.len() as f64;
        let chance = expected + CHANCE_SIGMAS * expected.sqrt() + 1.0;
        beyond(LIMIT_NORMAL) as f64 > chance || beyond(FAR_NORMAL) > 0
    }

    fn scale(&self, squares: &[f64]) -> f64 {
        let median = median(self.records.iter().map(|&i| squares[i]));
        median.map_or(f64::INFINITY, |m| square_scale(self.components, m))
    }

    /// Sets the weights of a smooth loss.
    fn weigh_smoothly(&self, squares: &[f64], weights: &mut [f64]) {
        for &i in &self.records {
            weights[i] = self.loss.smooth_weight(self.components, squares[i]);
        }
    }
}

/// Sets the weights of the groups' records by their losses; the scale of a group is that of all its
/// records.
pub fn weigh(groups: &[LossGroup], squares: &[f64], weights: &mut [f64]) {
    for group in groups {
        if group.loss != Loss::Truncated {
            group.weigh_smoothly(squares, weights);
            continue;
        }
        let limit = group.limit(squares);
        for &i in &group.records {
            weights[i] = f64::from(squares[i] <= limit);
        }
    }
}

/// Huber's weight, regardless of a record's loss: for tests in which rejected records count too.
pub fn cautious_weight(components: f64, square: f64) -> f64 {
    Loss::Huber.smooth_weight(components, square)
}

/// Rounds of graduated non-convexity.
#[derive(Debug, Clone, Default)]
pub struct Graduation {
    sharpness: Option<f64>,
}

impl Graduation {
    /// Sets the weights of the next round. Returns whether the truncated loss is reached: each of its
    /// records counts fully or not at all.
    pub fn round(&mut self, groups: &[LossGroup], squares: &[f64], weights: &mut [f64]) -> bool {
        let truncated = || groups.iter().filter(|g| g.loss == Loss::Truncated);
        let ratios = truncated().flat_map(|group| {
            let limit = group.limit(squares);
            group.records.iter().map(move |&i| (i, squares[i] / limit))
        });
        let ratios: Vec<(usize, f64)> = ratios.collect();
        let worst = ratios.iter().map(|(_, ratio)| *ratio).fold(0.0, f64::max);
        let mu = match self.sharpness {
            None => 1.0 / (2.0 * worst - 1.0).max(1e-3),
            Some(mu) => mu * SHARPENING,
        };
        self.sharpness = Some(mu);
        let mut undecided = false;
        for (i, ratio) in ratios {
            weights[i] = if ratio <= mu / (mu + 1.0) {
                1.0
            } else if ratio >= (mu + 1.0) / mu {
                0.0
            } else {
                undecided = true;
                (mu * (mu + 1.0) / ratio).sqrt() - mu
            };
        }
        for group in groups {
            if matches!(group.loss, Loss::Huber | Loss::Cauchy) {
                group.weigh_smoothly(squares, weights);
            }
        }
        !undecided && mu > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty good records with squares near 1 and one far out.
    fn records() -> Vec<f64> {
        let good = (0..20).map(|i| 0.5 + 0.05 * f64::from(i));
        good.chain([400.0]).collect()
    }

    fn group(loss: Loss) -> LossGroup {
        LossGroup {
            loss,
            components: 1.0,
            records: (0..21).collect(),
        }
    }

    #[test]
    fn every_loss_keeps_good_records_and_weighs_an_outlier_as_defined() {
        let squares = records();
        for (loss, expected) in [
            (Loss::None, 1.0),
            (Loss::Huber, 1.345 / 20.0),
            (Loss::Cauchy, 1.0 / (1.0 + 400.0 / 5.688_225)),
            (Loss::Truncated, 0.0),
        ] {
            let mut weights = vec![0.5; 21];
            weigh(&[group(loss)], &squares, &mut weights);
            assert!((weights[20] - expected).abs() < 1e-12, "{loss:?}");
            assert!(weights[..20].iter().all(|w| *w > 0.7), "{loss:?}");
            assert_eq!(group(loss).is_suspicious(&squares), loss != Loss::None);
        }
    }

    #[test]
    fn graduation_starts_convex_and_ends_decided() {
        let squares = records();
        let groups = [group(Loss::Truncated)];
        let mut weights = vec![1.0; 21];
        let mut graduation = Graduation::default();
        assert!(!graduation.round(&groups, &squares, &mut weights));
        assert!(weights[20] > 0.0 && weights[20] < 1.0, "{}", weights[20]);
        let rounds = (1..60).find(|_| graduation.round(&groups, &squares, &mut weights));
        assert!(rounds.is_some());
        let expected = [vec![1.0; 20], vec![0.0]].concat();
        assert_eq!(weights, expected);
    }
}
