//! The k nearest of the points offered so far.

use super::bounds::squared_distance;
use crate::geometry::Vec3;

/// Candidates are collected and reduced to the k best when twice as many have come, which costs
/// constant time per candidate; a heap would cost log k.
pub(super) struct Nearest {
    query: Vec3,
    k: usize,
    /// Squared distance and index of the k-th nearest so far.
    limit: f64,
    limit_index: u32,
    /// Squared distance, index, place: the bits of non-negative f64 sort like the numbers, and one
    /// integer compares without branches. Entries from `filled` on are unused.
    candidates: Vec<u128>,
    filled: usize,
}

impl Nearest {
    /// For the `k` points nearest to `query`.
    pub(super) fn new(query: &Vec3, k: usize) -> Self {
        Self {
            query: *query,
            k,
            limit: f64::INFINITY,
            limit_index: u32::MAX,
            candidates: Vec::with_capacity(2 * k),
            filled: 0,
        }
    }

    pub(super) fn query(&self) -> &Vec3 {
        &self.query
    }

    /// Whether one of the k nearest may lie in a box at this squared distance, with indices from
    /// `least` on: at the distance of the k-th, only a smaller index counts, otherwise thousands of
    /// coincident points would all be visited.
    pub(super) fn may_take(&self, distance: f64, least: u32) -> bool {
        distance < self.limit || (distance == self.limit && least <= self.limit_index)
    }

    /// Offers points with their indices; `first` is the position of the first of them.
    pub(super) fn offer(&mut self, points: &[Vec3], indices: &[u32], first: u32) {
        if self.candidates.len() < self.filled + points.len() {
            self.candidates.resize(self.filled + points.len(), 0);
        }
        for ((point, &index), place) in points.iter().zip(indices).zip(first..) {
            let distance = squared_distance(point, &self.query);
            // Always written and kept by advancing the counter: whether it is kept is nearly
            // random, and every other branch would be mispredicted.
            self.candidates[self.filled] =
                u128::from(distance.to_bits()) << 64 | u128::from(index) << 32 | u128::from(place);
            self.filled += usize::from(distance <= self.limit);
        }
        let full = if self.limit.is_finite() {
            2 * self.k
        } else {
            self.k
        };
        if self.filled >= full {
            self.keep_k();
        }
    }

    fn keep_k(&mut self) {
        if self.k > 0 && self.filled >= self.k {
            let candidates = &mut self.candidates[..self.filled];
            let (_, farthest, _) = candidates.select_nth_unstable(self.k - 1);
            self.limit = f64::from_bits((*farthest >> 64) as u64);
            self.limit_index = (*farthest >> 32) as u32;
            self.filled = self.k;
        }
    }

    /// The k nearest in ascending order: squared distance, index, place.
    pub(super) fn finish(mut self) -> impl DoubleEndedIterator<Item = (f64, u32, u32)> {
        self.keep_k();
        self.candidates.truncate(self.filled);
        self.candidates.sort_unstable();
        self.candidates.into_iter().map(|candidate| {
            let distance = f64::from_bits((candidate >> 64) as u64);
            (distance, (candidate >> 32) as u32, candidate as u32)
        })
    }
}
