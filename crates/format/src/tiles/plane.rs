//! Division of the plane into rectangles with about equal numbers of points, for clouds larger than
//! memory.
//!
//! The rectangles are the leaves of a k-d tree over east and north, split at medians of a sample of
//! the points, so that dense and sparse parts and distant outliers all get tiles of equal work.
//! They are half-open, the outer ones extend to infinity, and together they cover the plane: every
//! point lies in exactly one. Heights are not divided.

use crate::geometry::Vec3;

/// A rectangle in the plane: low ≤ (east, north) < high, metres; sides may be infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Smallest east and north, included.
    pub low: [f64; 2],
    /// Largest east and north, excluded.
    pub high: [f64; 2],
}

impl Rectangle {
    /// The whole plane.
    pub const PLANE: Self = Self {
        low: [f64::NEG_INFINITY; 2],
        high: [f64::INFINITY; 2],
    };

    /// Whether the point lies inside.
    pub fn contains(&self, point: &Vec3) -> bool {
        (0..2).all(|axis| self.low[axis] <= point[axis] && point[axis] < self.high[axis])
    }

    /// The rectangle with `margin_m` added on every side.
    pub fn widened(&self, margin_m: f64) -> Self {
        Self {
            low: self.low.map(|side| side - margin_m),
            high: self.high.map(|side| side + margin_m),
        }
    }

    /// The same rectangle, in which each side is moved to infinity if a cloud between `low` and `high`
    /// has no points beyond it.
    pub fn open_beyond(&self, low: &Vec3, high: &Vec3) -> Self {
        let mut open = *self;
        for axis in 0..2 {
            if low[axis] >= open.low[axis] {
                open.low[axis] = f64::NEG_INFINITY;
            }
            if high[axis] < open.high[axis] {
                open.high[axis] = f64::INFINITY;
            }
        }
        open
    }

    /// Whether the two rectangles intersect.
    pub fn intersects(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.low[axis] < other.high[axis] && other.low[axis] < self.high[axis])
    }

    /// A lower bound on the horizontal distance (m) from a point inside to any point outside:
    /// infinite for the whole plane, negative if the point is outside.
    ///
    /// Rounding is monotone: for every point p outside, the computed difference |p − point| along
    /// the axis of the nearest side is not smaller.
    pub fn depth_m(&self, point: &Vec3) -> f64 {
        (0..2)
            .flat_map(|axis| [point[axis] - self.low[axis], self.high[axis] - point[axis]])
            .fold(f64::INFINITY, f64::min)
    }

    /// Horizontal distance (m) from a point to the rectangle, 0 inside.
    pub fn distance_m(&self, point: &Vec3) -> f64 {
        let gap = |axis: usize| {
            let (below, above) = (self.low[axis] - point[axis], point[axis] - self.high[axis]);
            below.max(above).max(0.0)
        };
        gap(0).hypot(gap(1))
    }
}

/// A node of the tree over the plane.
#[derive(Debug, Clone, PartialEq)]
enum Node {
    /// Points whose coordinate is less than `at` go to the next node, others to node `other`.
    Cut {
        axis: usize,
        at: f64,
        other: usize,
    },
    Tile(usize),
}

/// Rectangles that together cover the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Tiles {
    nodes: Vec<Node>,
    rectangles: Vec<Rectangle>,
}

impl Tiles {
    /// Tiles with at most `most` points of `sample` (east, north) each, and more than half of that
    /// unless coordinates repeat; more only if points coincide in the plane. At least one tile. The
    /// sample is reordered.
    pub fn new(sample: &mut [[f64; 2]], most: usize) -> Self {
        let mut tiles = Self {
            nodes: Vec::new(),
            rectangles: Vec::new(),
        };
        tiles.cut(sample, most.max(1), Rectangle::PLANE);
        tiles
    }

    fn cut(&mut self, sample: &mut [[f64; 2]], most: usize, within: Rectangle) {
        if sample.len() > most {
            let range = |axis: usize| {
                let values = || sample.iter().map(|p| p[axis]);
                values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
            };
            let longer = usize::from(range(1) > range(0));
            for axis in [longer, 1 - longer] {
                if let Some((at, left)) = halve(sample, axis) {
                    let (below, above) = sample.split_at_mut(left);
                    let place = self.nodes.len();
                    let (mut near, mut far) = (within, within);
                    near.high[axis] = at;
                    far.low[axis] = at;
                    self.nodes.push(Node::Cut { axis, at, other: 0 });
                    self.cut(below, most, near);
                    let next = self.nodes.len();
                    self.nodes[place] = Node::Cut {
                        axis,
                        at,
                        other: next,
                    };
                    self.cut(above, most, far);
                    return;
                }
            }
        }
        self.nodes.push(Node::Tile(self.rectangles.len()));
        self.rectangles.push(within);
    }

    /// The rectangles, in an order in which neighbours in the list are often neighbours in space.
    pub fn rectangles(&self) -> &[Rectangle] {
        &self.rectangles
    }

    /// The index of the tile that contains a point.
    pub fn tile_of(&self, point: &Vec3) -> usize {
        let mut node = 0;
        loop {
            match self.nodes[node] {
                Node::Cut { axis, at, .. } if point[axis] < at => node += 1,
                Node::Cut { other, .. } => node = other,
                Node::Tile(tile) => return tile,
            }
        }
    }
}

/// Orders `points` so that the first ones lie below a split on `axis`; returns the coordinate of
/// the split and the number of points below it, as close to half as duplicates allow. `None` if all
/// points have the same coordinate.
fn halve(points: &mut [[f64; 2]], axis: usize) -> Option<(f64, usize)> {
    let middle = points.len() / 2;
    points.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
    let at = points[middle][axis];
    let first_equal = points.partition_point(|p| p[axis] < at);
    let first_above = points.partition_point(|p| p[axis] <= at);
    // The split is below or above the points with the middle coordinate.
    if first_equal > 0 && middle - first_equal <= first_above - middle {
        return Some((at, first_equal));
    }
    match points.get(first_above) {
        Some(above) => Some((above[axis], first_above)),
        None => (first_equal > 0).then_some((at, first_equal)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(n: u32) -> Vec<[f64; 2]> {
        // Dense in a corner, with one distant outlier and many points on one line.
        let mut points: Vec<[f64; 2]> = (0..n)
            .map(|i| {
                let u = f64::from(i) * 0.618_033_988_749_895 % 1.0;
                [
                    u * u * 100.0,
                    (f64::from(i) * 0.754_877_666 % 1.0).powi(3) * 50.0,
                ]
            })
            .collect();
        points.extend((0..n / 4).map(|i| [7.0, f64::from(i % 8)]));
        points.push([1e6, -3e5]);
        points
    }

    #[test]
    fn every_point_lies_in_exactly_one_tile_and_tiles_are_even() {
        let points = sample(4000);
        let tiles = Tiles::new(&mut points.clone(), 300);
        let mut counts = vec![0; tiles.rectangles().len()];
        for p in points.iter().chain(&[[1e9, 1e9], [-1e9, 0.0], [7.0, 3.0]]) {
            let point = Vec3::new(p[0], p[1], 5.0);
            let tile = tiles.tile_of(&point);
            let containing: Vec<usize> = (0..counts.len())
                .filter(|i| tiles.rectangles()[*i].contains(&point))
                .collect();
            assert_eq!(containing, [tile]);
            assert!(tiles.rectangles()[tile].depth_m(&point) >= 0.0);
            assert_eq!(tiles.rectangles()[tile].distance_m(&point), 0.0);
            counts[tile] += 1;
        }
        // 125 points coincide at each of eight positions, which can unbalance a split by that many.
        assert!(counts.iter().all(|n| (50..=300).contains(n)), "{counts:?}");
    }

    #[test]
    fn points_in_one_place_are_one_tile() {
        for n in [0, 1, 50] {
            let tiles = Tiles::new(&mut vec![[3.0, 4.0]; n], 10);
            assert_eq!(tiles.rectangles(), [Rectangle::PLANE]);
        }
        // One coordinate differs, for a minority of the points.
        let mut points = vec![[3.0, 4.0]; 50];
        points[49] = [3.0, 5.0];
        let tiles = Tiles::new(&mut points, 10);
        assert_eq!(tiles.rectangles().len(), 2);
        assert_eq!(tiles.tile_of(&Vec3::new(3.0, 4.5, 0.0)), 0);
        assert_eq!(tiles.tile_of(&Vec3::new(3.0, 5.0, 0.0)), 1);
    }

    #[test]
    fn distances_to_the_sides_are_those_of_geometry() {
        let tile = Rectangle {
            low: [0.0, f64::NEG_INFINITY],
            high: [4.0, 3.0],
        };
        let at = |x, y| Vec3::new(x, y, 99.0);
        assert_eq!(tile.depth_m(&at(1.5, 0.0)), 1.5);
        assert_eq!(tile.depth_m(&at(2.0, 2.5)), 0.5);
        assert!(tile.depth_m(&at(5.0, 0.0)) < 0.0);
        assert_eq!(tile.distance_m(&at(7.0, 7.0)), 5.0);
        assert_eq!(tile.distance_m(&at(2.0, -1e9)), 0.0);
        assert_eq!(tile.widened(1.0).high, [5.0, 4.0]);
        assert!(tile.intersects(&tile.widened(-0.5)));
        let beside = Rectangle {
            low: [4.0, 0.0],
            high: [5.0, 1.0],
        };
        assert!(!tile.intersects(&beside) && tile.intersects(&beside.widened(0.1)));
        let open = tile.open_beyond(&at(0.0, 0.0), &at(3.9, 3.0));
        assert_eq!(open.low, [f64::NEG_INFINITY; 2]);
        assert_eq!(open.high, [f64::INFINITY, 3.0]);
        assert_eq!(Rectangle::PLANE.depth_m(&at(1.0, 2.0)), f64::INFINITY);
    }
}
