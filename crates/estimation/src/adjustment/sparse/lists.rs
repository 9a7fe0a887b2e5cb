//! Lists of different lengths, one after the other.

use std::ops::Range;

/// Lists of different lengths, one after the other.
#[derive(Debug, Default)]
pub struct Lists<T> {
    ends: Vec<usize>,
    values: Vec<T>,
}

impl<T> Lists<T> {
    /// Number of lists.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    pub fn range(&self, i: usize) -> Range<usize> {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        start..self.ends[i]
    }

    pub fn get(&self, i: usize) -> &[T] {
        &self.values[self.range(i)]
    }

    /// Removes all lists and keeps their memory.
    pub fn clear(&mut self) {
        self.ends.clear();
        self.values.clear();
    }

    /// Adds a list of the values that are appended.
    pub fn push_with(&mut self, append: impl FnOnce(&mut Vec<T>)) {
        append(&mut self.values);
        self.ends.push(self.values.len());
    }
}

impl<T> FromIterator<Vec<T>> for Lists<T> {
    fn from_iter<I: IntoIterator<Item = Vec<T>>>(lists: I) -> Self {
        let (mut ends, mut values) = (Vec::new(), Vec::new());
        for list in lists {
            values.extend(list);
            ends.push(values.len());
        }
        Self { ends, values }
    }
}

/// Sums of the first 0, 1, … values.
pub fn sums(values: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sum = 0;
    let ends = values.map(|value| {
        sum += value;
        sum
    });
    [0].into_iter().chain(ends).collect()
}
