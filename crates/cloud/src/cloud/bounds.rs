//! Bounding boxes, and squared distances.

use crate::geometry::Vec3;

/// Axis-aligned bounding box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    /// Smallest coordinates.
    pub(crate) low: Vec3,
    /// Largest coordinates.
    pub(crate) high: Vec3,
}

impl Bounds {
    /// The smallest box around `points`.
    pub(super) fn around<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> Self {
        let points = points.into_iter();
        points.fold(Self::empty(), |bounds, point| Self {
            low: bounds.low.inf(point),
            high: bounds.high.sup(point),
        })
    }

    /// The empty box.
    pub(super) fn empty() -> Self {
        Self {
            low: Vec3::repeat(f64::INFINITY),
            high: Vec3::repeat(f64::NEG_INFINITY),
        }
    }

    /// The smallest box around both boxes.
    pub(super) fn union(&self, other: &Self) -> Self {
        Self {
            low: self.low.inf(&other.low),
            high: self.high.sup(&other.high),
        }
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

    /// Whether `point` lies in the closed box.
    #[inline(always)]
    pub(crate) fn contains(&self, point: &Vec3) -> bool {
        // No branches.
        (0..3).fold(true, |inside, axis| {
            inside & (point[axis] >= self.low[axis]) & (point[axis] <= self.high[axis])
        })
    }

    /// Distance from `point` to the nearest face, metres; negative outside.
    #[inline(always)]
    pub(crate) fn distance_to_border(&self, point: &Vec3) -> f64 {
        let (below, above) = (point - self.low, self.high - point);
        below.min().min(above.min())
    }

    /// Whether the two boxes intersect.
    #[inline]
    pub(crate) fn intersects(&self, other: &Self) -> bool {
        (0..3).fold(true, |meets, axis| {
            meets & (self.low[axis] <= other.high[axis]) & (self.high[axis] >= other.low[axis])
        })
    }
}

/// Squared distance |p − q|², computed as ((p − q)ₓ² + (p − q)ᵧ²) + (p − q)_z².
#[inline(always)]
pub(super) fn squared_distance(a: &Vec3, b: &Vec3) -> f64 {
    let (x, y, z) = (a.x - b.x, a.y - b.y, a.z - b.z);
    x * x + y * y + z * z
}
