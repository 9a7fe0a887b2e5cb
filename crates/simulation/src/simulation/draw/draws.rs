//! Random numbers of the distributions from which scenarios are drawn.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::super::random::normal;

/// Random numbers of one part of a scenario.
pub(super) struct Draws(ChaCha8Rng);

impl Draws {
    /// The numbers of a stream.
    pub fn new(stream: ChaCha8Rng) -> Self {
        Self(stream)
    }

    /// A number between the bounds.
    pub fn uniform(&mut self, (low, high): (f64, f64)) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// A number whose logarithm is uniform between those of the bounds.
    pub fn log_uniform(&mut self, (low, high): (f64, f64)) -> f64 {
        self.uniform((low.ln(), high.ln())).exp()
    }

    /// A whole number between the bounds, both included.
    pub fn count(&mut self, low: usize, high: usize) -> usize {
        self.0.random_range(low..=high)
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// One of the values.
    pub fn pick(&mut self, values: &[f64]) -> f64 {
        values[self.0.random_range(0..values.len())]
    }

    /// Three numbers of a normal distribution with mean 0.
    pub fn normals(&mut self, sigma: f64) -> [f64; 3] {
        std::array::from_fn(|_| sigma * normal(&mut self.0))
    }
}
