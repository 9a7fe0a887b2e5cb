//! Time series with a constant step.

use serde::{Deserialize, Serialize};

/// Values known every `step` seconds, linear between them and constant outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "[f64; N]: Serialize",
    deserialize = "[f64; N]: Deserialize<'de>"
))]
pub struct Series<const N: usize> {
    start_s: f64,
    step_s: f64,
    values: Vec<[f64; N]>,
}

impl<const N: usize> Series<N> {
    /// A series of these values from `start_s` on; without values it is zero everywhere.
    pub fn new(start_s: f64, step_s: f64, mut values: Vec<[f64; N]>) -> Self {
        if values.is_empty() {
            values.push([0.0; N]);
        }
        Self {
            start_s,
            step_s,
            values,
        }
    }

    /// Samples the function `at` over a time span (seconds), both ends included.
    pub fn sampled(
        (from_s, to_s): (f64, f64),
        step_s: f64,
        at: impl FnMut(f64) -> [f64; N],
    ) -> Self {
        let count = ((to_s - from_s) / step_s).ceil().max(0.0) as usize;
        let times_s = (0..=count).map(|i| from_s + step_s * i as f64);
        Self::new(from_s, step_s, times_s.map(at).collect())
    }

    /// The value at `time_s`.
    pub fn at(&self, time_s: f64) -> [f64; N] {
        let last = self.values.len() - 1;
        let place = ((time_s - self.start_s) / self.step_s).clamp(0.0, last as f64);
        let before = place.floor() as usize;
        let after = (before + 1).min(last);
        let u = place - before as f64;
        let (a, b) = (&self.values[before], &self.values[after]);
        std::array::from_fn(|i| a[i] * (1.0 - u) + b[i] * u)
    }

    /// Times (seconds) with their values.
    pub fn samples(&self) -> impl Iterator<Item = (f64, &[f64; N])> {
        let values = self.values.iter().enumerate();
        values.map(|(i, value)| (self.start_s + self.step_s * i as f64, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_linear_between_their_times_and_constant_outside() {
        let series = Series::sampled((10.0, 11.0), 0.5, |t| [t, 2.0 * t]);
        assert_eq!(series.samples().count(), 3);
        assert_eq!(series.at(10.25), [10.25, 20.5]);
        assert_eq!(series.at(11.0), [11.0, 22.0]);
        assert_eq!([series.at(0.0)[0], series.at(20.0)[0]], [10.0, 11.0]);
        assert_eq!(Series::<1>::new(0.0, 1.0, Vec::new()).at(5.0), [0.0]);
    }
}
