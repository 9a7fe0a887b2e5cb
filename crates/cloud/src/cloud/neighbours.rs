//! Exact nearest neighbours: points sorted along a space-filling curve under a tree of boxes.
//!
//! Points are sorted by the keys of `curve.rs`. A node of the tree is a run of points with equal
//! leading bits, with their bounding box; it is split at the next bit that differs, so that its
//! halves never interleave, until at most 32 points are left. Sorting replaces the selections that
//! build a k-d tree, at a fraction of their cost. The children of node i are node i + 1 and the
//! node given by its offset.
//!
//! Exactness needs no tolerance. Squared distances are computed as
//! ((p − q)ₓ² + (p − q)ᵧ²) + (p − q)_z², and the squared distance to a box by the same operations
//! on the nearest corner. Rounding is monotone, so the computed distance to a box never exceeds the
//! computed distance to a point inside it, and no neighbour is lost by skipping boxes that are
//! farther than the k-th point found. Differences of f64 coordinates are rounded relative to the
//! difference and not to the coordinates, so UTM-sized coordinates need no origin.

use rayon::prelude::*;

use super::bounds::{Bounds, squared_distance};
use super::curve::Grid;
use super::nearest::Nearest;
use crate::geometry::{Vec3, is_finite};

/// Most points in a leaf. With k = 50 on surface points, run times for 8 to 64 differ by less than
/// a tenth.
const LEAF: usize = 32;

/// Subtrees with more points than this are built on another thread.
const PARALLEL_BUILD: usize = 1 << 14;

/// A run of points in the order of the curve.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub(super) bounds: Bounds,
    pub(super) first: u32,
    pub(super) end: u32,
    /// Offset of the second child from this node; 0 for a leaf.
    second: u32,
    /// Smallest index of the points.
    least: u32,
}

impl Node {
    pub(super) fn points(&self) -> std::ops::Range<usize> {
        self.first as usize..self.end as usize
    }
}

/// Searches neighbours among the points it was built from.
///
/// Points must be finite; the readers refuse others. A point with a coordinate that is not finite
/// is never returned, and a NaN query has no neighbours.
///
/// ```
/// use boresight_cloud::cloud::NeighbourIndex;
/// use boresight_cloud::geometry::Vec3;
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
    /// In the order of the curve; points that are not finite come last, outside every node.
    pub(super) points: Vec<Vec3>,
    /// Index of each of `points` in the caller's list.
    pub(super) indices: Vec<u32>,
    pub(super) nodes: Vec<Node>,
}

impl NeighbourIndex {
    /// An index over a copy of `points`, which may be empty and contain duplicates. O(n log n), on
    /// all threads; the result does not depend on their number.
    ///
    /// # Panics
    /// With 2³² points or more, which would occupy 100 GB.
    pub fn new(points: &[Vec3]) -> Self {
        let bounds = points
            .par_chunks(PARALLEL_BUILD)
            .map(|chunk| Bounds::around(chunk.iter().filter(|point| is_finite(point))))
            .reduce(Bounds::empty, |a, b| a.union(&b));
        Self::in_extent(points, &bounds.low, &bounds.high)
    }

    /// An index over part of a cloud whose extent is the box from `low` to `high` (metres). The
    /// points have the same order as in an index over the whole cloud, so sums over neighbours are
    /// identical to the last bit.
    ///
    /// # Panics
    /// As [`NeighbourIndex::new`].
    pub fn in_extent(points: &[Vec3], low: &Vec3, high: &Vec3) -> Self {
        assert!(
            u32::try_from(points.len()).is_ok(),
            "more points than u32 can count"
        );
        let grid = Grid::over(low, high);
        let mut keyed = grid.sorted(points);
        let mut ordered: Vec<Vec3> = keyed
            .par_iter()
            .map(|(_, index)| points[*index as usize])
            .collect();
        let finite = keyed.partition_point(|(key, _)| *key < Grid::NOWHERE);
        let run = Run {
            keyed: &mut keyed[..finite],
            ordered: &mut ordered[..finite],
            first: 0,
            all: points,
        };
        let nodes = run.nodes(&grid);
        Self {
            points: ordered,
            indices: keyed.par_iter().map(|(_, index)| *index).collect(),
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

    /// All indices, in an order in which neighbours in the list are neighbours in space.
    pub fn spatial_order(&self) -> &[u32] {
        &self.indices
    }

    /// Replaces `into` by the indices of the `k` points nearest to `query` (including the query
    /// itself if it belongs to the cloud), nearest first, at equal distances the smaller index
    /// first; all points if there are fewer than `k`.
    ///
    /// For the neighbours of many points, [`Self::surroundings`] and [`Self::nearest_of_all`] take
    /// a fraction of the time.
    pub fn nearest(&self, query: &Vec3, k: usize, into: &mut Vec<u32>) {
        into.clear();
        into.extend(
            self.nearest_with_distances(query, k)
                .map(|(_, index, _)| index),
        );
    }

    /// The `k` nearest points, nearest first: squared distance, index, position in `points`.
    pub fn nearest_with_distances(
        &self,
        query: &Vec3,
        k: usize,
    ) -> impl DoubleEndedIterator<Item = (f64, u32, u32)> + use<> {
        let k = k.min(self.len());
        let mut nearest = Nearest::new(query, k);
        if k > 0 && !self.nodes.is_empty() {
            self.collect_nearest(&mut nearest, 0);
        }
        nearest.finish()
    }

    /// Replaces `into` by the indices of the points in the closed ball of `radius` (metres) around
    /// `query`, ascending. Squares are compared: |p − q|² ≤ radius².
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

    /// Calls `each` with every point in the leaves whose boxes, and the boxes above them, `enter`
    /// accepts; in the order of the curve.
    pub(crate) fn visit(&self, enter: impl Fn(&Bounds) -> bool, mut each: impl FnMut(u32, &Vec3)) {
        self.visit_leaves(enter, |leaf| {
            for at in leaf {
                each(self.indices[at], &self.points[at]);
            }
        });
    }

    /// As [`Self::visit`], with the range of each leaf's points in `points` and `indices`.
    #[inline(always)]
    pub(super) fn visit_leaves(
        &self,
        enter: impl Fn(&Bounds) -> bool,
        mut each: impl FnMut(std::ops::Range<usize>),
    ) {
        // A depth-first search keeps one sibling per level: the bits of all grids and the halvings
        // of coincident points.
        let mut waiting = [0u32; Grid::MOST_BITS + 32];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let at = waiting[depth];
            let node = &self.nodes[at as usize];
            if !enter(&node.bounds) {
                continue;
            }
            if node.second == 0 {
                each(node.points());
            } else {
                waiting[depth] = at + node.second;
                waiting[depth + 1] = at + 1;
                depth += 2;
            }
        }
    }

    /// The largest nodes of at most `most` points, in order; together they contain every point.
    pub(super) fn groups(&self, most: usize) -> Vec<&Node> {
        let mut groups = Vec::new();
        let mut at = 0;
        while at < self.nodes.len() {
            let node = &self.nodes[at];
            if node.points().len() <= most || node.second == 0 {
                groups.push(node);
                at += self.nodes_below(at);
            } else {
                at += 1;
            }
        }
        groups
    }

    /// Number of nodes of the subtree, its root included.
    fn nodes_below(&self, mut at: usize) -> usize {
        let root = at;
        while self.nodes[at].second > 0 {
            at += self.nodes[at].second as usize;
        }
        at + 1 - root
    }

    fn collect_nearest(&self, nearest: &mut Nearest, at: usize) {
        let node = &self.nodes[at];
        if node.second == 0 {
            let leaf = node.points();
            nearest.offer(&self.points[leaf.clone()], &self.indices[leaf], node.first);
            return;
        }
        let (first, second) = (at + 1, at + node.second as usize);
        let to_first = self.nodes[first].bounds.squared_distance(nearest.query());
        let to_second = self.nodes[second].bounds.squared_distance(nearest.query());
        let ordered = if to_second < to_first {
            [(to_second, second), (to_first, first)]
        } else {
            [(to_first, first), (to_second, second)]
        };
        for (distance, child) in ordered {
            if nearest.may_take(distance, self.nodes[child].least) {
                self.collect_nearest(nearest, child);
            }
        }
    }
}

/// Points from which a tree is built: a run of them in the order of the curve.
struct Run<'a> {
    /// Keys and indices.
    keyed: &'a mut [(u64, u32)],
    /// The points themselves.
    ordered: &'a mut [Vec3],
    /// Position of the run's first point.
    first: u32,
    /// The points that the indices refer to.
    all: &'a [Vec3],
}

impl Run<'_> {
    /// The nodes over the run; none if it is empty.
    fn nodes(self, grid: &Grid) -> Vec<Node> {
        let mut nodes = Vec::new();
        if !self.keyed.is_empty() {
            self.build(grid, &mut nodes);
        }
        nodes
    }

    fn build(mut self, grid: &Grid, nodes: &mut Vec<Node>) {
        let at = nodes.len();
        let count = self.keyed.len();
        nodes.push(Node {
            bounds: Bounds::empty(),
            first: self.first,
            end: self.first + count as u32,
            second: 0,
            least: u32::MAX,
        });
        if count <= LEAF {
            if self.keyed.windows(2).any(|pair| pair[0].0 == pair[1].0) {
                self.sort_fully(grid);
            }
            nodes[at].bounds = Bounds::around(&*self.ordered);
            nodes[at].least = self.keyed.iter().fold(u32::MAX, |least, k| least.min(k.1));
            return;
        }
        let mut finer = *grid;
        let mut differing = self.keyed[0].0 ^ self.keyed[count - 1].0;
        while differing == 0 {
            let next = finer.inside(&self.ordered[0]).or_else(|| {
                let bounds = Bounds::around(&*self.ordered);
                finer.around(&bounds.low, &bounds.high)
            });
            let Some(next) = next else { break };
            finer = next;
            self.sort_by(&finer);
            differing = self.keyed[0].0 ^ self.keyed[count - 1].0;
        }
        // Coincident points are halved in the order of their indices.
        let half = match differing.checked_ilog2() {
            Some(bit) => self.keyed.partition_point(|(key, _)| key >> bit & 1 == 0),
            None => count / 2,
        };
        let (low, high) = self.split(half);
        if count > PARALLEL_BUILD {
            let (below, after) = rayon::join(|| low.nodes(&finer), || high.nodes(&finer));
            nodes[at].second = 1 + below.len() as u32;
            nodes.extend(below);
            nodes.extend(after);
        } else {
            low.build(&finer, nodes);
            nodes[at].second = (nodes.len() - at) as u32;
            high.build(&finer, nodes);
        }
        let (first, second) = (nodes[at + 1], nodes[at + nodes[at].second as usize]);
        nodes[at].bounds = first.bounds.union(&second.bounds);
        nodes[at].least = first.least.min(second.least);
    }

    fn split(self, half: usize) -> (Self, Self) {
        let (keyed, keyed_after) = self.keyed.split_at_mut(half);
        let (ordered, ordered_after) = self.ordered.split_at_mut(half);
        let low = Self {
            keyed,
            ordered,
            ..self
        };
        let high = Self {
            keyed: keyed_after,
            ordered: ordered_after,
            first: self.first + half as u32,
            all: self.all,
        };
        (low, high)
    }

    /// Sorts points of one cell by a grid inside it.
    fn sort_by(&mut self, finer: &Grid) {
        for ((key, _), point) in self.keyed.iter_mut().zip(&*self.ordered) {
            *key = finer.key(point);
        }
        self.keyed.par_sort_unstable();
        self.reorder();
    }

    /// Sorts the few points of a leaf as they would be sorted among more.
    fn sort_fully(&mut self, grid: &Grid) {
        self.keyed.sort_by_key(|&(key, index)| {
            let point = &self.all[index as usize];
            let finer = grid.inside(point);
            let finest = finer.and_then(|finer| finer.inside(point));
            let [finer, finest] = [finer, finest].map(|grid| grid.map(|grid| grid.key(point)));
            (key, finer, finest, index)
        });
        self.reorder();
    }

    /// Brings the points into the order of the indices.
    fn reorder(&mut self) {
        for (point, (_, index)) in self.ordered.iter_mut().zip(&*self.keyed) {
            *point = self.all[*index as usize];
        }
    }
}
