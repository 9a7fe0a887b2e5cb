//! Exact nearest neighbours: a balanced k-d tree whose nodes carry the bounding box of their
//! points.
//!
//! The tree is laid out without pointers. Points are reordered so that every leaf is a run of
//! 32 points (the last leaf may be shorter), and a subtree of L leaves occupies 2 L − 1
//! consecutive nodes: its root, its left subtree of ⌊L/2⌋ leaves, its right subtree.
//!
//! Exactness needs no tolerance. Squared distances are computed as
//! ((p − q)ₓ² + (p − q)ᵧ²) + (p − q)_z², and the squared distance to a box by the same operations on
//! the nearest corner. Rounding is monotone, so the computed distance to a box never exceeds the
//! computed distance to a point inside it, and no point is lost by leaving out boxes that are
//! farther than the k-th point found. Differences of f64 coordinates are rounded relative to the
//! difference and not to the coordinates, so UTM-sized coordinates need no origin.

use crate::geometry::Vec3;

/// Points in a leaf. With k = 50 on surface points, 8 to 64 measure within a tenth of each other.
const LEAF: usize = 32;

/// Subtrees with more points than this are built by another thread.
const PARALLEL_BUILD: usize = 1 << 14;

/// Axis-aligned bounding box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    /// Smallest coordinates.
    pub(crate) low: Vec3,
    /// Largest coordinates.
    pub(crate) high: Vec3,
}

impl Bounds {
    fn of(points: &[(Vec3, u32)]) -> Self {
        let empty = Self {
            low: Vec3::repeat(f64::INFINITY),
            high: Vec3::repeat(f64::NEG_INFINITY),
        };
        points.iter().fold(empty, |bounds, (point, _)| Self {
            low: bounds.low.inf(point),
            high: bounds.high.sup(point),
        })
    }

    fn widest_axis(&self) -> usize {
        (self.high - self.low).imax()
    }

    /// Squared distance from `query` to the nearest point of the box, 0 inside.
    #[inline]
    pub(crate) fn squared_distance(&self, query: &Vec3) -> f64 {
        let mut gap = [0.0; 3];
        for (axis, gap) in gap.iter_mut().enumerate() {
            let below = self.low[axis] - query[axis];
            let above = query[axis] - self.high[axis];
            *gap = below.max(above).max(0.0);
        }
        gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]
    }
}

#[inline]
fn squared_distance(a: &Vec3, b: &Vec3) -> f64 {
    let (x, y, z) = (a.x - b.x, a.y - b.y, a.z - b.z);
    x * x + y * y + z * z
}

/// Finds neighbours among the points it was built from.
///
/// Points must be finite: readers refuse others. A point with a NaN coordinate is never returned,
/// and a NaN query has no neighbours.
///
/// ```
/// use boresight::cloud::NeighbourIndex;
/// use boresight::geometry::Vec3;
/// let points: Vec<Vec3> = (0..10).map(|i| Vec3::new(f64::from(i), 0.0, 0.0)).collect();
/// let index = NeighbourIndex::new(&points);
/// let mut found = Vec::new();
/// index.nearest(&Vec3::new(4.1, 0.0, 0.0), 3, &mut found);
/// assert_eq!(found, [4, 5, 3]);
/// index.within(&Vec3::new(4.0, 0.0, 0.0), 1.0, &mut found);
/// assert_eq!(found, [3, 4, 5]);
/// ```
#[derive(Debug, Clone)]
pub struct NeighbourIndex {
    /// In leaf order.
    points: Vec<Vec3>,
    /// Index that each of `points` had in the list the caller gave.
    indices: Vec<u32>,
    /// Where each point of the caller's list stands in `points`.
    places: Vec<u32>,
    nodes: Vec<Bounds>,
}

impl NeighbourIndex {
    /// An index over a copy of `points`, which may be empty and hold duplicates. O(n log n), on all
    /// threads; the result does not depend on their number.
    ///
    /// # Panics
    /// With more than 2³² points, which would occupy 100 GB.
    pub fn new(points: &[Vec3]) -> Self {
        assert!(
            u32::try_from(points.len()).is_ok(),
            "more points than u32 can count"
        );
        let mut tagged: Vec<(Vec3, u32)> = points.iter().copied().zip(0u32..).collect();
        let leaves = tagged.len().div_ceil(LEAF);
        let nothing = Bounds {
            low: Vec3::zeros(),
            high: Vec3::zeros(),
        };
        let mut nodes = vec![nothing; (2 * leaves).saturating_sub(1)];
        if leaves > 0 {
            build(&mut tagged, &mut nodes, leaves);
        }
        let mut places = vec![0; tagged.len()];
        for ((_, index), place) in tagged.iter().zip(0u32..) {
            places[*index as usize] = place;
        }
        Self {
            places,
            points: tagged.iter().map(|(point, _)| *point).collect(),
            indices: tagged.iter().map(|(_, index)| *index).collect(),
            nodes,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The point that stood at `index` in the list the caller gave.
    pub fn point(&self, index: u32) -> &Vec3 {
        &self.points[self.places[index as usize] as usize]
    }

    /// Every index once, in an order in which neighbours in the list are neighbours in space.
    /// Queries in this order find their part of the tree in the cache and run several times faster
    /// than in random order.
    pub fn spatial_order(&self) -> &[u32] {
        &self.indices
    }

    /// Replaces `into` by the indices of the `k` points nearest to `query` (one of which is the
    /// query where it belongs to the cloud), nearest first, of equal distances the smaller index
    /// first; all points where there are fewer than `k`.
    pub fn nearest(&self, query: &Vec3, k: usize, into: &mut Vec<u32>) {
        into.clear();
        let k = k.min(self.len());
        if k == 0 {
            return;
        }
        let mut nearest = Nearest::new(query, k);
        self.collect_nearest(&mut nearest, 0, 0, self.leaves());
        into.extend(nearest.finish());
    }

    /// Replaces `into` by the indices of the points in the closed ball of `radius` (metres) around
    /// `query`, ascending. The squares are compared: |p − q|² ≤ radius².
    pub fn within(&self, query: &Vec3, radius: f64, into: &mut Vec<u32>) {
        into.clear();
        let limit = radius * radius;
        self.visit(
            |bounds| bounds.squared_distance(query) <= limit,
            |index, point| {
                if squared_distance(point, query) <= limit {
                    into.push(index);
                }
            },
        );
        into.sort_unstable();
    }

    /// Hands every point to `each` that lies in a leaf whose box, and the boxes above it, `enter`
    /// accepts; always in the same order.
    pub(crate) fn visit(&self, enter: impl Fn(&Bounds) -> bool, mut each: impl FnMut(u32, &Vec3)) {
        // The tree is balanced: its depth is below 32, and a depth-first search keeps one waiting
        // sibling a level.
        let mut waiting = [(0usize, 0usize, 0usize); 64];
        let mut depth = 0;
        if !self.is_empty() {
            waiting[0] = (0, 0, self.leaves());
            depth = 1;
        }
        while depth > 0 {
            depth -= 1;
            let (node, first_leaf, leaves) = waiting[depth];
            if !enter(&self.nodes[node]) {
                continue;
            }
            if leaves == 1 {
                for at in self.leaf(first_leaf) {
                    each(self.indices[at], &self.points[at]);
                }
            } else {
                let left = leaves / 2;
                waiting[depth] = (node + 2 * left, first_leaf + left, leaves - left);
                waiting[depth + 1] = (node + 1, first_leaf, left);
                depth += 2;
            }
        }
    }

    fn leaves(&self) -> usize {
        self.len().div_ceil(LEAF)
    }

    fn leaf(&self, leaf: usize) -> std::ops::Range<usize> {
        leaf * LEAF..((leaf + 1) * LEAF).min(self.len())
    }

    fn collect_nearest(&self, nearest: &mut Nearest, node: usize, first: usize, leaves: usize) {
        if leaves == 1 {
            let leaf = self.leaf(first);
            nearest.offer(&self.points[leaf.clone()], &self.indices[leaf]);
            return;
        }
        let left = leaves / 2;
        let near = (node + 1, first, left);
        let far = (node + 2 * left, first + left, leaves - left);
        let to_near = self.nodes[near.0].squared_distance(&nearest.query);
        let to_far = self.nodes[far.0].squared_distance(&nearest.query);
        let ordered = if to_far < to_near {
            [(to_far, far), (to_near, near)]
        } else {
            [(to_near, near), (to_far, far)]
        };
        for (distance, (node, first, leaves)) in ordered {
            // A box exactly as far as the k-th point may hold a tie with a smaller index.
            if distance <= nearest.limit {
                self.collect_nearest(nearest, node, first, leaves);
            }
        }
    }
}

/// Orders the points into leaves and writes the boxes of this subtree.
fn build(points: &mut [(Vec3, u32)], nodes: &mut [Bounds], leaves: usize) {
    let bounds = Bounds::of(points);
    let parallel = points.len() > PARALLEL_BUILD;
    let (root, below) = nodes.split_at_mut(1);
    root[0] = bounds;
    if leaves == 1 {
        return;
    }
    let left = leaves / 2;
    let axis = bounds.widest_axis();
    // The index makes the order total, so that duplicates split like any other points.
    points.select_nth_unstable_by(left * LEAF, |(a, i), (b, j)| {
        a[axis].total_cmp(&b[axis]).then(i.cmp(j))
    });
    let (left_points, right_points) = points.split_at_mut(left * LEAF);
    let (left_nodes, right_nodes) = below.split_at_mut(2 * left - 1);
    if parallel {
        rayon::join(
            || build(left_points, left_nodes, left),
            || build(right_points, right_nodes, leaves - left),
        );
    } else {
        build(left_points, left_nodes, left);
        build(right_points, right_nodes, leaves - left);
    }
}

/// The k nearest so far. Candidates pile up and are cut to the k best when twice as many have
/// come, which costs a constant time each, where a heap costs log k.
struct Nearest {
    query: Vec3,
    k: usize,
    /// No point farther than this (squared) can be among the k nearest.
    limit: f64,
    /// Squared distance and, in the low 32 bits, index: the bits of non-negative f64 sort like the
    /// numbers, and one integer compares without branches. Those from `filled` on are unused.
    candidates: Vec<u128>,
    filled: usize,
}

impl Nearest {
    fn new(query: &Vec3, k: usize) -> Self {
        Self {
            query: *query,
            k,
            limit: f64::INFINITY,
            candidates: vec![0; 2 * k + LEAF],
            filled: 0,
        }
    }

    fn offer(&mut self, points: &[Vec3], indices: &[u32]) {
        for (point, &index) in points.iter().zip(indices) {
            let distance = squared_distance(point, &self.query);
            // Written in any case and kept by counting it: whether it is kept is as good as
            // random, which would cost a mispredicted branch every other time.
            self.candidates[self.filled] = u128::from(distance.to_bits()) << 32 | u128::from(index);
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
        if self.filled >= self.k {
            let candidates = &mut self.candidates[..self.filled];
            let (_, farthest, _) = candidates.select_nth_unstable(self.k - 1);
            self.limit = f64::from_bits((*farthest >> 32) as u64);
            self.filled = self.k;
        }
    }

    /// Indices of the k nearest, nearest first.
    fn finish(mut self) -> impl Iterator<Item = u32> {
        self.keep_k();
        self.candidates.truncate(self.filled);
        self.candidates.sort_unstable();
        self.candidates
            .into_iter()
            .map(|candidate| candidate as u32)
    }
}
