//! An even share of a stream.

/// Keeps an even share of a stream of unknown length. A value is kept where a hash of its place is
/// below a bound that halves whenever too many are kept: every n-th point of a cloud would be the
/// same few columns of every profile.
#[derive(Debug)]
pub struct EvenSample<T> {
    most: usize,
    bound: u64,
    shown: u64,
    kept: Vec<(u64, T)>,
}

impl<T> EvenSample<T> {
    /// Of `most` values at most.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            bound: u64::MAX,
            shown: 0,
            kept: Vec::new(),
        }
    }

    /// Takes in the next value.
    pub fn show(&mut self, value: T) {
        // Multiples of the golden ratio are spread evenly over [0, 2⁶⁴).
        let hash = self.shown.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.shown += 1;
        if hash <= self.bound {
            self.kept.push((hash, value));
            if self.kept.len() > self.most {
                self.bound /= 2;
                self.kept.retain(|(hash, _)| *hash <= self.bound);
            }
        }
    }

    /// Number of values shown.
    pub fn shown(&self) -> u64 {
        self.shown
    }

    /// What is kept, in the order of the stream.
    pub fn into_kept(self) -> Vec<T> {
        self.kept.into_iter().map(|(_, value)| value).collect()
    }
}
