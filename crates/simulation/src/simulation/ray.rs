//! Rays through boxes and squares.

use crate::geometry::Vec3;

/// Where the ray enters and leaves a box, which is bounded along its first `N` axes; `None` if it
/// misses the box.
pub fn within<const N: usize>(
    origin: &Vec3,
    direction: &Vec3,
    [low, high]: [[f64; N]; 2],
) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..N {
        let (o, d) = (origin[axis], direction[axis]);
        if d == 0.0 {
            if o < low[axis] || o > high[axis] {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[axis] - o) / d, (high[axis] - o) / d);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter <= leave).then_some((enter, leave))
}

/// Squares side by side in plan view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Squares {
    /// East and north of the first corner, metres.
    pub origin: [f64; 2],
    /// Side of a square, metres.
    pub side_m: f64,
    /// Number of squares along each axis.
    pub count: [usize; 2],
}

impl Squares {
    /// Column and row of the square at a point; beyond the last one, of the nearest.
    pub fn at(&self, x: f64, y: f64) -> [usize; 2] {
        let [o, n] = [self.origin, [x, y]];
        [0, 1].map(|axis| {
            (((n[axis] - o[axis]) / self.side_m).max(0.0) as usize).min(self.count[axis] - 1)
        })
    }

    /// Range slightly beyond that at which the ray leaves the square of `p`, which it reaches at
    /// `range`: the next point is in the next square.
    pub fn leave(&self, range: f64, p: &Vec3, direction: &Vec3, [i, j]: [usize; 2]) -> f64 {
        let edge = |x: f64, o: f64, t: usize, d: f64| {
            if d > 0.0 {
                (o + (t + 1) as f64 * self.side_m - x) / d
            } else if d < 0.0 {
                (o + t as f64 * self.side_m - x) / d
            } else {
                f64::INFINITY
            }
        };
        range
            + edge(p.x, self.origin[0], i, direction.x)
                .min(edge(p.y, self.origin[1], j, direction.y))
                .max(0.0)
            + 1e-9
    }
}
