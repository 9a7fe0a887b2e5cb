//! Exact neighbours of many points that lie close together, from shared candidates.
//!
//! The neighbours of adjacent points are nearly the same. The points of a small box of the index, a
//! group, are therefore processed together:
//!
//! 1. All points in a box that exceeds the group's by a margin are gathered, in the order of the
//!    index, as f64 and as f32 relative to the centre of the box.
//! 2. For each query the squared distances to all candidates are computed in f32. Counting those
//!    that do not exceed a threshold costs one comparison per candidate. Starting from the
//!    threshold of the previous query, two thresholds are searched: the lower one includes all but
//!    a few of the k nearest, the upper one not many more than k.
//! 3. Rounding of the f32 distances is bounded: a candidate below the lower threshold by more than
//!    the bound is a neighbour, one above the upper threshold by more than it is not. The few in
//!    between are sorted by their f64 distance, then by index.
//! 4. The neighbours are exact if the k-th distance does not reach the border of the gathered box.
//!    Queries that fail this test are repeated with the margin that their k-th distance requires.
//!    If a margin gathers far more than k candidates, for example in a sparse part next to a dense
//!    one, the remaining queries are searched in the tree, one by one.
//!
//! ## The bound of step 3
//! Let d be the exact squared distance and d̃ the computed one, u = 2⁻²⁴ the unit roundoff of f32,
//! and E the largest coordinate relative to the centre of the box. Rounding two coordinates and
//! their difference x causes an error of at most 2uE + u|x|, so the distance is off by at most 2√3
//! uE + u√d, and squaring and summing add at most 4u relatively: up to terms of u², |d̃ − d| ≤ 2√d
//! · 2√3 uE + (2√3 uE)² + 6ud. [`Candidates::error_bound`] is about twice as large. If fewer than k
//! computed distances do not exceed t, a candidate with d̃ ≤ t − 2 |d̃ − d| is nearer than all
//! those beyond t, so it is one of the k nearest; and likewise above.

use std::cell::Cell;
use std::ops::Range;

use super::bounds::{Bounds, squared_distance};
use super::lanes::{Lanes, WORD};
use super::neighbours::NeighbourIndex;
use super::tensor::StructureTensor;
use crate::geometry::{Mat3, Vec3};

/// Most candidates left to f64 before the search for the threshold goes on.
const UNDECIDED: usize = 8;

/// Coordinates relative to the centre beyond which only f64 is used, so that no square overflows
/// f32, metres.
const FARTHEST: f32 = 1e15;

/// Squared distance of the mean, in variances, beyond which offsets are taken from the mean.
/// Rounding multiplies the variances' error by at most this factor.
const FAR: f64 = 16.0;

/// Points near a group of queries.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// x, y, z, 1.
    points: Vec<[f64; 4]>,
    indices: Vec<u32>,
    /// Relative to `middle`; padded to whole words by points at infinity.
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    middle: Vec3,
    /// Bound on the coordinates of candidates and query relative to `middle`.
    extent: f32,
    /// The gathered box; infinite where the cloud ends inside it.
    region: Option<Bounds>,
    /// Positions of the gathered leaves in the index.
    runs: Vec<Range<usize>>,
    squared: Vec<f32>,
    /// One bit per candidate.
    chosen: Vec<u64>,
    undecided: Vec<(f64, u32, u32)>,
    places: Vec<u32>,
    /// k-th squared distance of the previous query.
    guess: f32,
}

/// The outcome of the search for the neighbours of one query.
pub(super) enum Search {
    /// The chosen candidates are the neighbours; distance of the farthest, metres, infinite if
    /// there are fewer than k.
    Found(f64),
    /// The box must be larger: this margin (metres) around the query suffices.
    Margin(f64),
}

impl Candidates {
    /// Gathers the points of `index` in the box of `group` widened by `margin_m`. Returns false and gathers
    /// nothing if the leaves that meet the box hold more than `most` points.
    #[inline(always)]
    pub(super) fn gather(
        &mut self,
        index: &NeighbourIndex,
        group: &Bounds,
        margin_m: f64,
        most: usize,
    ) -> bool {
        let wide = Bounds {
            low: group.low.add_scalar(-margin_m),
            high: group.high.add_scalar(margin_m),
        };
        // Points are copied outside the closure, which is not compiled for wide vectors.
        let gathered = Cell::new(0);
        self.runs.clear();
        index.visit_leaves(
            |bounds| gathered.get() <= most && bounds.intersects(&wide),
            |leaf| {
                gathered.set(gathered.get() + leaf.len());
                self.runs.push(leaf);
            },
        );
        if gathered.get() > most {
            return false;
        }
        if self.points.len() < gathered.get() {
            self.points.resize(gathered.get(), [1.0; 4]);
            self.indices.resize(gathered.get(), 0);
        }
        let mut filled = 0;
        for run in &self.runs {
            let points = index.points[run.clone()].iter();
            for (point, &at) in points.zip(&index.indices[run.clone()]) {
                // Always written and kept by advancing the counter, without a branch.
                self.points[filled] = [point.x, point.y, point.z, 1.0];
                self.indices[filled] = at;
                filled += usize::from(wide.contains(point));
            }
        }
        self.points.truncate(filled);
        self.indices.truncate(filled);
        let all = index.nodes.first().map(|root| root.bounds);
        let clear = |end: f64, reached: bool| if reached { f64::INFINITY } else { end };
        self.region = all.map(|all| Bounds {
            low: Vec3::from_fn(|i, _| -clear(-wide.low[i], wide.low[i] <= all.low[i])),
            high: Vec3::from_fn(|i, _| clear(wide.high[i], wide.high[i] >= all.high[i])),
        });
        self.middle = (group.low + group.high) / 2.0;
        let padded = self.points.len().next_multiple_of(WORD);
        for (axis, list) in [&mut self.x, &mut self.y, &mut self.z]
            .into_iter()
            .enumerate()
        {
            list.clear();
            let middle = self.middle[axis];
            list.extend(
                self.points
                    .iter()
                    .map(|point| (point[axis] - middle) as f32),
            );
            list.resize(padded, f32::INFINITY);
        }
        let half = (group.high - group.low).max() / 2.0;
        self.extent = ((half + margin_m) * (1.0 + 1e-6)) as f32;
        self.squared.resize(padded, 0.0);
        self.chosen.resize(padded / WORD, 0);
        self.squared.truncate(padded);
        self.chosen.truncate(padded / WORD);
        true
    }

    /// Searches the `k` points of `index` nearest to `query` in the tree, and chooses them all. Returns the
    /// distance of the farthest, as in [`Search::Found`].
    pub(super) fn take_nearest(&mut self, index: &NeighbourIndex, query: &Vec3, k: usize) -> f64 {
        let mut farthest = f64::NAN;
        self.places.clear();
        for (squared, _, place) in index.nearest_with_distances(query, k) {
            farthest = squared;
            self.places.push(place);
        }
        self.places.sort_unstable();
        self.points.clear();
        self.indices.clear();
        for &place in &self.places {
            let point = &index.points[place as usize];
            self.points.push([point.x, point.y, point.z, 1.0]);
            self.indices.push(index.indices[place as usize]);
        }
        self.chosen.clear();
        self.chosen.resize(self.len().div_ceil(WORD), 0);
        self.choose_all();
        if self.len() < k {
            f64::INFINITY
        } else {
            farthest.sqrt()
        }
    }

    /// Number of candidates.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Upper bound on the f32 error of a squared distance near `squared`.
    #[inline(always)]
    fn error_bound(&self, squared: f32) -> f32 {
        const U: f32 = 1.0 / (1 << 24) as f32;
        let place = 8.0 * U * self.extent;
        2.0 * squared.sqrt() * place + place * place + 16.0 * U * squared
    }

    #[inline(always)]
    fn compute_distances(&mut self, query: &Vec3) {
        let from = (query - self.middle).map(|x| x as f32);
        let places = self.x.iter().zip(&self.y).zip(&self.z);
        for (squared, ((x, y), z)) in self.squared.iter_mut().zip(places) {
            let (x, y, z) = (x - from.x, y - from.y, z - from.z);
            *squared = x * x + y * y + z * z;
        }
    }

    /// Chooses the `k` ≥ 1 candidates nearest to `query`.
    #[inline(always)]
    pub(super) fn nearest<L: Lanes>(&mut self, query: &Vec3, k: usize) -> Search {
        let region = self
            .region
            .as_ref()
            .map_or(f64::INFINITY, |region| region.distance_to_border(query));
        if self.len() < k {
            return if region == f64::INFINITY {
                self.choose_all();
                Search::Found(f64::INFINITY)
            } else {
                Search::Margin(f64::INFINITY)
            };
        }
        let taken = if self.extent < FARTHEST {
            self.compute_distances(query);
            let (sure, open) = self.bracket::<L>(k);
            let least = sure - self.error_bound(sure) * 2.0;
            // Padding is at infinity.
            let most = (open + self.error_bound(open) * 2.0).min(f32::MAX);
            self.split::<L>(least, most)
        } else {
            self.leave_all_undecided()
        };
        for candidate in &mut self.undecided {
            let [x, y, z, _] = self.points[candidate.1 as usize];
            candidate.0 = squared_distance(&Vec3::new(x, y, z), query);
            candidate.2 = self.indices[candidate.1 as usize];
        }
        insertion_sort(&mut self.undecided);
        self.undecided.truncate(k - taken);
        for &(_, at, _) in &self.undecided {
            self.chosen[at as usize / WORD] |= 1 << (at as usize % WORD);
        }
        let farthest = self.undecided.last().map_or(f64::NAN, |last| last.0);
        self.guess = farthest as f32;
        // The margin is accurate to a few roundings of the coordinates.
        let reach = farthest.sqrt();
        let enough = reach * (1.0 + 1e-12);
        // A point at the query's own position is in every box.
        if enough < region || region == f64::INFINITY || farthest == 0.0 {
            Search::Found(reach)
        } else {
            Search::Margin(enough)
        }
    }

    /// Two thresholds: fewer than `k` candidates do not exceed the first, at least `k` the second.
    #[inline(always)]
    fn bracket<L: Lanes>(&self, k: usize) -> (f32, f32) {
        let (mut low, mut high) = ((0.0f32, 0usize), (f32::INFINITY, usize::MAX));
        // No squared distance is below zero.
        low.0 = -1.0;
        let mut threshold = if self.guess > 0.0 {
            self.guess
        } else {
            self.extent * self.extent / 16.0
        };
        for _ in 0..16 {
            let count = L::count(&self.squared, threshold);
            if count < k {
                low = (threshold, count);
            } else {
                high = (threshold, count);
            }
            if high.1.saturating_sub(low.1) <= UNDECIDED {
                break;
            }
            // On a surface the number grows with the square of the distance. The aim is slightly
            // off to the other side, so that the bracket closes.
            let aim = if count < k { k + 1 } else { k - 1 } as f32;
            let next = threshold * (aim + 0.5) / (count as f32 + 0.5);
            let inside = next > low.0 && next < high.0;
            threshold = if inside {
                next
            } else if high.0.is_finite() {
                0.5 * (low.0.max(0.0) + high.0)
            } else {
                4.0 * threshold
            };
        }
        (low.0, high.0)
    }

    /// Chooses the candidates up to `least`, lists those up to `most` as undecided, and returns how
    /// many were chosen.
    #[inline(always)]
    fn split<L: Lanes>(&mut self, least: f32, most: f32) -> usize {
        self.undecided.clear();
        let mut taken = 0;
        let words = self.squared.as_chunks::<WORD>().0;
        for (at, (word, chosen)) in words.iter().zip(&mut self.chosen).enumerate() {
            let sure = L::up_to(word, least);
            let mut open = L::up_to(word, most) & !sure;
            *chosen = sure;
            taken += sure.count_ones() as usize;
            while open != 0 {
                let bit = open.trailing_zeros();
                open &= open - 1;
                self.undecided.push((0.0, (at * WORD) as u32 + bit, 0));
            }
        }
        taken
    }

    /// Chooses no candidate and lists all as undecided; returns the number chosen, 0.
    fn leave_all_undecided(&mut self) -> usize {
        self.chosen.fill(0);
        self.undecided.clear();
        let all = 0..self.len() as u32;
        self.undecided.extend(all.map(|place| (0.0, place, 0)));
        0
    }

    /// Chooses all candidates.
    fn choose_all(&mut self) {
        self.leave_all_undecided();
        for &(_, at, _) in &self.undecided {
            self.chosen[at as usize / WORD] |= 1 << (at as usize % WORD);
        }
    }

    /// Chooses the candidates within `radius_m` of `query`.
    #[inline(always)]
    pub(super) fn within<L: Lanes>(&mut self, query: &Vec3, radius_m: f64) {
        let limit = radius_m * radius_m;
        if self.extent < FARTHEST && radius_m < f64::from(FARTHEST) {
            self.compute_distances(query);
            let rounded = limit as f32;
            let bound = 2.0 * self.error_bound(rounded);
            self.split::<L>(rounded - bound, rounded + bound);
        } else {
            self.leave_all_undecided();
        }
        for &(_, at, _) in &self.undecided {
            let [x, y, z, _] = self.points[at as usize];
            let inside = squared_distance(&Vec3::new(x, y, z), query) <= limit;
            self.chosen[at as usize / WORD] |= u64::from(inside) << (at as usize % WORD);
        }
    }

    /// Indices of the chosen candidates, in the order of the index.
    #[inline(always)]
    pub(super) fn chosen_indices<L: Lanes>(&mut self) -> Vec<u32> {
        L::places(&self.chosen, &mut self.places);
        let indices = self
            .places
            .iter()
            .map(|&place| self.indices[place as usize]);
        indices.collect()
    }

    /// The structure tensor of the chosen candidates; see [`StructureTensor::from_points`].
    #[inline(always)]
    pub(super) fn tensor<L: Lanes>(&mut self, query: &Vec3) -> StructureTensor {
        L::places(&self.chosen, &mut self.places);
        if self.places.is_empty() {
            return StructureTensor::from_points(&[]);
        }
        let n = self.places.len() as f64;
        let mut centre = *query;
        loop {
            let [x, y, z] = L::moments(
                &self.points,
                &self.places,
                &[centre.x, centre.y, centre.z, 0.0],
            );
            let mean = Vec3::new(x[3], y[3], z[3]) / n;
            let second = Mat3::new(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]) / n;
            let covariance = second - mean * mean.transpose();
            // Far from its neighbours, the square of their distance would swamp their scatter.
            if mean.norm_squared() > FAR * covariance.trace() && centre != centre + mean {
                centre += mean;
                continue;
            }
            return StructureTensor {
                mean: centre + mean,
                covariance,
                count: self.places.len(),
            };
        }
    }
}

/// Sorts the few undecided candidates; longer lists, for example of coincident points, go to the
/// library's sort.
#[inline(always)]
fn insertion_sort(list: &mut [(f64, u32, u32)]) {
    let before = |a: &(f64, u32, u32), b: &(f64, u32, u32)| (a.0, a.2) < (b.0, b.2);
    if list.len() > 4 * UNDECIDED {
        list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        return;
    }
    for end in 1..list.len() {
        let mut at = end;
        while at > 0 && before(&list[at], &list[at - 1]) {
            list.swap(at, at - 1);
            at -= 1;
        }
    }
}
