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
    /// The difference `first` − `second`; `None` if no component is determined by both.
    pub fn new(first: &Estimate, second: &Estimate) -> Option<Self> {
        let determined = std::array::from_fn(|i| first.determined[i] && second.determined[i]);
        let rows: Vec<usize> = (0..6).filter(|&i| determined[i]).collect();
        let size = rows.len();
        let part = |c: &Matrix6<f64>| DMatrix::from_fn(size, size, |i, j| c[(rows[i], rows[j])]);
        let parts = [part(&first.covariance), part(&second.covariance)];
        let factor = (&parts[0] + &parts[1]).cholesky()?;
        let d = DVector::from_fn(size, |i, _| first.offset[rows[i]] - second.offset[rows[i]]);
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
        let spreads = parts
            .iter()
            .zip([first.degrees, second.degrees])
            .map(spread);
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
        .map(|estimate| Some(estimate.covariance.cholesky()?.inverse()))
        .collect();
    let weights = weights?;
    let pairs = || all.iter().zip(&weights);
    let least = weights.iter().sum::<Matrix6<f64>>().cholesky()?.inverse();
    let chance = pairs().map(|(estimate, weight)| {
        let known = estimate.determined.iter().filter(|known| **known).count() as f64;
        (weight - weight * least * weight) * (2.0 * (known + 1.0) / estimate.degrees)
    });
    let covariance = least + least * chance.sum::<Matrix6<f64>>() * least;
    Some(Estimate {
        offset: least
            * pairs()
                .map(|(estimate, w)| w * estimate.offset)
                .sum::<Vector6<f64>>(),
        covariance: 0.5 * (covariance + covariance.transpose()),
        determined: std::array::from_fn(|i| all.iter().any(|estimate| estimate.determined[i])),
        degrees: all.iter().map(|estimate| estimate.degrees).sum(),
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
        let first = estimate([3e-3, 0.0, 0.0, 0.0, 4e-3, 0.0], 6e-4, KNOWN);
        let second = estimate([0.0; 6], 8e-4, KNOWN);
        let difference = Difference::new(&first, &second).unwrap();
        // σ² = 0.36 + 0.64, d² = 9 + 16.
        assert!((difference.t2 - 25.0).abs() < 1e-9);
        assert!((difference.sigma()[0].unwrap() - 1e-3).abs() < 1e-15);
        // χ² with six degrees of freedom exceeds 16.812 by 1 %.
        assert!((difference.limit(0.01) - 16.812).abs() < 2e-3);
    }

    #[test]
    fn components_that_are_not_determined_are_left_out() {
        let mut first = estimate([3e-3, 1.0, 0.0, 0.0, 4e-3, 2.0], 1e-3, KNOWN);
        first.determined[1] = false;
        let mut second = estimate([0.0; 6], 1e-9, KNOWN);
        second.determined[5] = false;
        let difference = Difference::new(&first, &second).unwrap();
        assert!((difference.t2 - 25.0).abs() < 1e-6, "{}", difference.t2);
        assert_eq!((difference.offset[1], difference.sigma()[5]), (0.0, None));
        // Four degrees: 13.277.
        assert!((difference.limit(0.01) - 13.277).abs() < 2e-3);
        first.determined = [false; 6];
        assert!(Difference::new(&first, &second).is_none());
    }

    #[test]
    fn degrees_are_those_of_the_larger_covariance() {
        let first = estimate([0.0; 6], 1e-3, 30.0);
        let with = |sigma, degrees| {
            Difference::new(&first, &estimate([0.0; 6], sigma, degrees))
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
            let difference = Difference::new(&drawn(20, &mut rng), &drawn(20, &mut rng)).unwrap();
            difference.t2 > difference.limit(0.01)
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
            let mean = mean(&all).unwrap();
            squares += mean.offset.norm_squared();
            variances += mean.covariance.trace();
        }
        let ratio = variances / squares;
        assert!((ratio - 1.0).abs() < 0.06, "{ratio}");
    }

    #[test]
    fn a_mean_weighs_by_covariance() {
        let first = estimate([1.0; 6], 1e-3, 10.0);
        let second = estimate([4.0; 6], 2e-3, 20.0);
        let combined = mean(&[first, second]).unwrap();
        // Weights 4/5 and 1/5; the variance is larger by the share 2 (6 + 1) (0.8 · 0.2 / 10 + 0.2 · 0.8 / 20).
        assert!((combined.offset - Vector6::repeat(1.6)).norm() < 1e-9);
        assert!((combined.covariance[(2, 2)] - 0.8e-6 * 1.336).abs() < 1e-15);
        assert_eq!(combined.degrees, 30.0);
        assert_eq!(mean(&[first]), Some(first));
        assert_eq!(mean(&[]), None);
    }
}
