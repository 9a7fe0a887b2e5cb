//! An evenly spread sample of a stream.

/// An evenly spread sample of a stream of unknown length. A value is kept if a hash of its position
/// is below a bound that is halved whenever too many are kept. Every n-th point of a cloud would
/// instead pick the same few columns of every profile.
#[derive(Debug)]
pub struct EvenSample<T> {
    most: usize,
    bound: u64,
    seen: u64,
    values: Vec<(u64, T)>,
}

impl<T> EvenSample<T> {
    /// An empty sample that will keep at most `most` values.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            bound: u64::MAX,
            seen: 0,
            values: Vec::new(),
        }
    }

    /// Takes the next value of the stream.
    pub fn push(&mut self, value: T) {
        // Multiples of the golden ratio are spread evenly over [0, 2⁶⁴).
        let hash = self.seen.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.seen += 1;
        if hash <= self.bound {
            self.values.push((hash, value));
            if self.values.len() > self.most {
                self.bound /= 2;
                self.values.retain(|(hash, _)| *hash <= self.bound);
            }
        }
    }

    /// Number of values in the stream so far.
    pub fn seen(&self) -> u64 {
        self.seen
    }

    /// The values kept, in the order of the stream.
    pub fn into_values(self) -> Vec<T> {
        self.values.into_iter().map(|(_, value)| value).collect()
    }
}
