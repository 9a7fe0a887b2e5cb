//! A mounting that moves along a drive.

use super::{BodyFromScanner, Vec3};

/// Offsets of a mounting from its mean along a drive, known at even times and linear between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Bending {
    start_s: f64,
    step_s: f64,
    /// (δφ, δp) in body axes, radians and metres.
    offsets: Vec<[f64; 6]>,
}

impl Bending {
    /// The offsets that `at` gives over a span of times, every `step_s` seconds.
    pub fn sampled((from_s, to_s): (f64, f64), step_s: f64, at: impl Fn(f64) -> [f64; 6]) -> Self {
        let count = ((to_s - from_s) / step_s).ceil().max(1.0) as usize;
        Self {
            start_s: from_s,
            step_s,
            offsets: (0..=count)
                .map(|i| at(from_s + step_s * i as f64))
                .collect(),
        }
    }

    /// Times (seconds) with the offsets (δφ, δp).
    pub fn samples(&self) -> impl Iterator<Item = (f64, &[f64; 6])> {
        let offsets = self.offsets.iter().enumerate();
        offsets.map(|(i, offset)| (self.start_s + self.step_s * i as f64, offset))
    }

    /// The offset at a time, that of the nearer end outside the drive.
    pub fn at(&self, time_s: f64) -> [f64; 6] {
        let last = self.offsets.len() - 1;
        let place = ((time_s - self.start_s) / self.step_s).clamp(0.0, last as f64);
        let before = (place.floor() as usize).min(last.saturating_sub(1));
        let after = (before + 1).min(last);
        let u = place - before as f64;
        let (a, b) = (&self.offsets[before], &self.offsets[after]);
        std::array::from_fn(|i| a[i] * (1.0 - u) + b[i] * u)
    }

    /// The mounting at a time, of one with this mean.
    pub fn apply(&self, mean: &BodyFromScanner, time_s: f64) -> BodyFromScanner {
        bent(mean, &self.at(time_s))
    }
}

/// A mounting off its mean by (δφ, δp).
pub fn bent(mean: &BodyFromScanner, offset: &[f64; 6]) -> BodyFromScanner {
    let [turn, shift] = [&offset[..3], &offset[3..]].map(Vec3::from_column_slice);
    mean.perturbed(&turn, &shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_are_linear_between_their_times_and_end_with_the_drive() {
        let bending = Bending::sampled((10.0, 11.0), 0.5, |t| [t, 0.0, 0.0, 0.0, 0.0, 2.0 * t]);
        assert_eq!(bending.samples().count(), 3);
        assert_eq!(bending.at(10.25), [10.25, 0.0, 0.0, 0.0, 0.0, 20.5]);
        assert_eq!(bending.at(0.0)[0], 10.0);
        assert_eq!(bending.at(20.0)[0], 11.0);
    }
}
