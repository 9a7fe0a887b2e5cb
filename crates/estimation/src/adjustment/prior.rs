//! Priors with independent components.

/// Weights 1/σ² of N components, and deviations d (`miss`) of the values from the prior: cost ½ Σ w d².
#[derive(Debug, Clone, Copy)]
pub struct Prior<const N: usize> {
    pub weight: [f64; N],
    pub miss: [f64; N],
}

impl<const N: usize> Prior<N> {
    /// The right-hand side −w d.
    pub fn g(&self) -> [f64; N] {
        std::array::from_fn(|i| -self.weight[i] * self.miss[i])
    }

    pub fn cost(&self) -> f64 {
        cost(&self.weight, &self.miss)
    }

    /// The same weights with zero deviations.
    pub fn met(self) -> Self {
        Self {
            miss: [0.0; N],
            ..self
        }
    }
}

/// A prior of the n columns of the border.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BorderPrior {
    pub weight: Vec<f64>,
    pub miss: Vec<f64>,
}

impl BorderPrior {
    pub fn cost(&self) -> f64 {
        cost(&self.weight, &self.miss)
    }

    /// The same weights with zero deviations.
    pub fn met(mut self) -> Self {
        self.miss.fill(0.0);
        self
    }
}

fn cost(weight: &[f64], miss: &[f64]) -> f64 {
    let terms = weight.iter().zip(miss).map(|(w, d)| 0.5 * w * d * d);
    terms.sum()
}
