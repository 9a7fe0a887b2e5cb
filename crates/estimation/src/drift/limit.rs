//! The test whether a difference is more than chance: Hotelling's T² and its limit.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use crate::statistics::fisher_exceeded;

/// Degrees of freedom that represent a known covariance.
pub const KNOWN: f64 = 1e6;

/// An offset with a covariance that was estimated with `degrees` degrees of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    pub offset: Vector6<f64>,
    pub covariance: Matrix6<f64>,
    pub determined: [bool; 6],
    pub degrees: f64,
}

/// The difference of two estimates.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// First minus second estimate; zero in components that either does not determine.
    pub offset: Vector6<f64>,
    /// Covariance of the offset; zero in the same components.
    pub covariance: Matrix6<f64>,
    /// Whether both estimates determine each component.
    pub determined: [bool; 6],
    /// dᵀ S⁻¹ d.
    pub t2: f64,
    /// Degrees of freedom of S.
    pub degrees: f64,
}

impl Difference {
    /// The difference `one` − `other`; `None` if no component is determined by both.
    pub fn new(one: &Estimate, other: &Estimate) -> Option<Self> {
        let determined = std::array::from_fn(|i| one.determined[i] && other.determined[i]);
        let rows: Vec<usize> = (0..6).filter(|&i| determined[i]).collect();
        let size = rows.len();
        let part = |c: &Matrix6<f64>| DMatrix::from_fn(size, size, |i, j| c[(rows[i], rows[j])]);
        let parts = [part(&one.covariance), part(&other.covariance)];
        let factor = (&parts[0] + &parts[1]).cholesky()?;
        let d = DVector::from_fn(size, |i, _| one.offset[rows[i]] - other.offset[rows[i]]);
        if size == 0 {
            return None;
        }
        let t2 = d.dot(&factor.solve(&d));
        // Krishnamoorthy and Yu (2004): S is treated as a single Wishart matrix.
        let p = size as f64;
        let spread = |(c, degrees): (&DMatrix<f64>, f64)| {
            let share = factor.solve(c);
            ((&share * &share).trace() + share.trace().powi(2)) / degrees
        };
        let spreads = parts.iter().zip([one.degrees, other.degrees]).map(spread);
        let degrees = (p + p * p) / spreads.sum::<f64>();
        let (mut offset, mut covariance) = (Vector6::zeros(), Matrix6::zeros());
        for (i, &row) in rows.iter().enumerate() {
            offset[row] = d[i];
            for (j, &column) in rows.iter().enumerate() {
                covariance[(row, column)] = parts[0][(i, j)] + parts[1][(i, j)];
            }
        }
        Some(Self {
            offset,
            covariance,
            determined,
            t2,
            degrees: degrees.min(KNOWN),
        })
    }

    /// The limit that T² exceeds by chance with this probability.
    pub fn limit(&self, probability: f64) -> f64 {
        let p = self.determined.iter().filter(|known| **known).count() as f64;
        let below = (self.degrees - p + 1.0).max(1.0);
        p * self.degrees.max(p) / below * fisher_exceeded(p, below, probability)
    }

    /// Standard deviations of the offset; `None` for components that are not determined.
    pub fn sigma(&self) -> [Option<f64>; 6] {
        std::array::from_fn(|i| self.determined[i].then(|| self.covariance[(i, i)].sqrt()))
    }
}

/// The mean of estimates of the same quantity, weighted by their covariances; `None` without estimates.
///
/// The weights W of estimated covariances are estimates as well. With M = Σ W, the covariance of the mean is
///
/// ```text
/// M⁻¹ + M⁻¹ (Σ 2 (p + 1) / ν · (W − W M⁻¹ W)) M⁻¹
/// ```
///
/// to first order in 1 / ν, which for p = 1 is that of Meier (1953).
pub fn mean(all: &[Estimate]) -> Option<Estimate> {
    let [first, others @ ..] = all else {
        return None;
    };
    if others.is_empty() {
        return Some(*first);
    }
    let weights: Option<Vec<Matrix6<f64>>> = all
        .iter()
        .map(|one| Some(one.covariance.cholesky()?.inverse()))
        .collect();
    let weights = weights?;
    let pairs = || all.iter().zip(&weights);
    let least = weights.iter().sum::<Matrix6<f64>>().cholesky()?.inverse();
    let chance = pairs().map(|(one, weight)| {
        let known = one.determined.iter().filter(|known| **known).count() as f64;
        (weight - weight * least * weight) * (2.0 * (known + 1.0) / one.degrees)
    });
    let covariance = least + least * chance.sum::<Matrix6<f64>>() * least;
    Some(Estimate {
        offset: least * pairs().map(|(one, w)| w * one.offset).sum::<Vector6<f64>>(),
        covariance: 0.5 * (covariance + covariance.transpose()),
        determined: std::array::from_fn(|i| all.iter().any(|one| one.determined[i])),
        degrees: all.iter().map(|one| one.degrees).sum(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(offset: [f64; 6], sigma: f64, degrees: f64) -> Estimate {
        Estimate {
            offset: offset.into(),
            covariance: Matrix6::identity() * sigma * sigma,
            determined: [true; 6],
            degrees,
        }
    }

    #[test]
    fn t_square_of_known_covariances() {
        let one = estimate([3e-3, 0.0, 0.0, 0.0, 4e-3, 0.0], 6e-4, KNOWN);
        let other = estimate([0.0; 6], 8e-4, KNOWN);
        let found = Difference::new(&one, &other).unwrap();
        // σ² = 0.36 + 0.64, d² = 9 + 16.
        assert!((found.t2 - 25.0).abs() < 1e-9);
        assert!((found.sigma()[0].unwrap() - 1e-3).abs() < 1e-15);
        // χ² with six degrees of freedom exceeds 16.812 by 1 %.
        assert!((found.limit(0.01) - 16.812).abs() < 2e-3);
    }

    #[test]
    fn components_that_are_not_determined_are_left_out() {
        let mut one = estimate([3e-3, 1.0, 0.0, 0.0, 4e-3, 2.0], 1e-3, KNOWN);
        one.determined[1] = false;
        let mut other = estimate([0.0; 6], 1e-9, KNOWN);
        other.determined[5] = false;
        let found = Difference::new(&one, &other).unwrap();
        assert!((found.t2 - 25.0).abs() < 1e-6, "{}", found.t2);
        assert_eq!((found.offset[1], found.sigma()[5]), (0.0, None));
        // Four degrees: 13.277.
        assert!((found.limit(0.01) - 13.277).abs() < 2e-3);
        one.determined = [false; 6];
        assert!(Difference::new(&one, &other).is_none());
    }

    #[test]
    fn degrees_are_those_of_the_larger_covariance() {
        let one = estimate([0.0; 6], 1e-3, 30.0);
        let with = |sigma, degrees| {
            Difference::new(&one, &estimate([0.0; 6], sigma, degrees))
                .unwrap()
                .degrees
        };
        assert!((with(1e-9, 5.0) - 30.0).abs() < 1e-3);
        // Two equal covariances: twice as many.
        assert!((with(1e-3, 30.0) - 60.0).abs() < 1e-9);
        assert!((with(1e-3, KNOWN) - 120.0).abs() < 0.1);
    }

    /// An estimate of zero from `draws` random draws, with their covariance.
    fn drawn(draws: usize, rng: &mut rand_chacha::ChaCha8Rng) -> Estimate {
        use rand_distr::{Distribution, StandardNormal};
        let all: Vec<Vector6<f64>> = (0..draws)
            .map(|_| Vector6::from_fn(|_, _| StandardNormal.sample(rng)))
            .collect();
        let offset = all.iter().sum::<Vector6<f64>>() / draws as f64;
        let scatter = all.iter().map(|x| (x - offset) * (x - offset).transpose());
        let degrees = (draws - 1) as f64;
        Estimate {
            offset,
            covariance: scatter.sum::<Matrix6<f64>>() / degrees / draws as f64,
            determined: [true; 6],
            degrees,
        }
    }

    fn seeded() -> rand_chacha::ChaCha8Rng {
        rand::SeedableRng::seed_from_u64(5)
    }

    #[test]
    fn limits_hold_at_their_rate_for_estimated_covariances() {
        // 1 % of 4000 differences of nothing exceed the limit: 40, with a standard deviation of 6.
        let mut rng = seeded();
        let exceeded = (0..4000).filter(|_| {
            let found = Difference::new(&drawn(20, &mut rng), &drawn(20, &mut rng)).unwrap();
            found.t2 > found.limit(0.01)
        });
        let count = exceeded.count();
        assert!((22..=60).contains(&count), "{count}");
    }

    #[test]
    fn the_covariance_of_a_mean_is_that_of_its_errors() {
        // Means of six estimates of 40 draws: M⁻¹ alone is 0.73 of their variance. The mean of 12,000 squares is
        // known to 1.3 %; the neglected terms are of second order, 0.18².
        let mut rng = seeded();
        let (mut squares, mut variances) = (0.0, 0.0);
        for _ in 0..2000 {
            let all: Vec<Estimate> = (0..6).map(|_| drawn(40, &mut rng)).collect();
            let found = mean(&all).unwrap();
            squares += found.offset.norm_squared();
            variances += found.covariance.trace();
        }
        let ratio = variances / squares;
        assert!((ratio - 1.0).abs() < 0.06, "{ratio}");
    }

    #[test]
    fn a_mean_weighs_by_covariance() {
        let one = estimate([1.0; 6], 1e-3, 10.0);
        let other = estimate([4.0; 6], 2e-3, 20.0);
        let found = mean(&[one, other]).unwrap();
        // Weights 4/5 and 1/5; the variance is larger by the share 2 (6 + 1) (0.8 · 0.2 / 10 + 0.2 · 0.8 / 20).
        assert!((found.offset - Vector6::repeat(1.6)).norm() < 1e-9);
        assert!((found.covariance[(2, 2)] - 0.8e-6 * 1.336).abs() < 1e-15);
        assert_eq!(found.degrees, 30.0);
        assert_eq!(mean(&[one]), Some(one));
        assert_eq!(mean(&[]), None);
    }
}
