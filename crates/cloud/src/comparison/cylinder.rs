//! The cylinder around a core point.

use super::settings::ComparisonSettings;
use super::window::{BoxQuery, Window};
use crate::cloud::NeighbourIndex;
use crate::cloud::bounds::Bounds;
use crate::cloud::vectors::with_widest_vectors;
use crate::geometry::Vec3;

/// A cylinder along the normal of a core point. It includes its lateral surface but not its ends; a
/// one-sided cylinder includes the plane of the core point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cylinder {
    centre: Vec3,
    axis: Vec3,
    radius_m: f64,
    half_length_m: f64,
    one_sided: bool,
    /// Lower limit of the heights.
    lowest_m: f64,
}

/// Half the length of the cylinders, metres.
pub(super) fn half_length_m(settings: &ComparisonSettings) -> f64 {
    settings.max_distance_m.max(settings.cylinder_radius_m)
}

impl Cylinder {
    pub(super) fn new(centre: Vec3, axis: Vec3, settings: &ComparisonSettings) -> Self {
        Self {
            centre,
            axis,
            radius_m: settings.cylinder_radius_m,
            half_length_m: half_length_m(settings),
            one_sided: settings.one_sided,
            lowest_m: if settings.one_sided {
                0.0
            } else {
                f64::NEG_INFINITY
            },
        }
    }

    /// Whether the box may contain points of the cylinder: false only if it certainly contains
    /// none, with a tolerance for the rounding of the test itself.
    fn may_meet(&self, bounds: &Bounds) -> bool {
        const ROOM: f64 = 1.0 + 1e-12;
        let middle = ((bounds.low - self.centre) + (bounds.high - self.centre)) / 2.0;
        let half = (bounds.high - bounds.low) / 2.0;
        let rounding = 1e-12 * (middle.norm() + half.norm());
        let along = middle.dot(&self.axis);
        let half_along = half.dot(&self.axis.abs());
        if along.abs() > (half_along + self.half_length_m) * ROOM + rounding {
            return false;
        }
        let across = (middle - self.axis * along).norm();
        across <= (half.norm() + self.radius_m) * ROOM + rounding
    }

    /// Replaces `heights` by those of the points of `cloud` inside the cylinder: distances from the centre
    /// along the axis, metres.
    pub(super) fn heights_in_tree(&self, cloud: &NeighbourIndex, heights: &mut Heights) {
        heights.clear();
        cloud.visit(
            |bounds| self.may_meet(bounds),
            |_, point| {
                let (height, inside) = self.place([point.x, point.y, point.z]);
                if inside {
                    heights.push(height);
                }
            },
        );
        // The order of points in a tree depends on all of its points; sums must not.
        heights.heights[..heights.filled].sort_unstable_by(f64::total_cmp);
    }

    /// As [`Self::heights_in_tree`], for the points in a window that contains the whole cylinder.
    pub(super) fn heights_in_window(&self, window: &Window, heights: &mut Heights) {
        // Bounds of the distance from the centre along each coordinate, in both directions.
        let (ends, sides) = (
            self.axis * self.half_length_m,
            self.axis
                .map(|x| self.radius_m * (1.0 - x * x).max(0.0).sqrt() * (1.0 + 1e-12)),
        );
        let beyond = ends.sup(&Vec3::zeros());
        let below = ends.inf(&Vec3::zeros());
        let (low, high) = if self.one_sided {
            (below - sides, beyond + sides)
        } else {
            (-ends.abs() - sides, ends.abs() + sides)
        };
        let between = window.box_between(&(self.centre + low), &(self.centre + high));
        fill_heights(heights, window, &between, self);
    }

    /// The height of a point along the axis, and whether it is inside.
    #[inline(always)]
    fn place(&self, point: [f64; 3]) -> (f64, bool) {
        let [x, y, z] = [
            point[0] - self.centre.x,
            point[1] - self.centre.y,
            point[2] - self.centre.z,
        ];
        let axis = &self.axis;
        let height = x * axis.x + y * axis.y + z * axis.z;
        let across = [
            x - height * axis.x,
            y - height * axis.y,
            z - height * axis.z,
        ];
        let squared = across[0] * across[0] + across[1] * across[1] + across[2] * across[2];
        // All conditions are evaluated: branches would be mispredicted.
        let inside = (height.abs() < self.half_length_m)
            & (height >= self.lowest_m)
            & (squared <= self.radius_m * self.radius_m);
        (height, inside)
    }
}

/// Heights of points along the axis of a cylinder, and a weight for each: 1 inside; outside, both
/// are 0.
#[derive(Debug, Default)]
pub(super) struct Heights {
    heights: Vec<f64>,
    weights: Vec<f64>,
    filled: usize,
}

impl Heights {
    fn clear(&mut self) {
        self.filled = 0;
    }

    fn push(&mut self, height: f64) {
        self.heights.truncate(self.filled);
        self.weights.truncate(self.filled);
        self.heights.push(height);
        self.weights.push(1.0);
        self.filled += 1;
    }

    /// Heights and weights.
    pub(super) fn weighted(&self) -> (&[f64], &[f64]) {
        (&self.heights[..self.filled], &self.weights[..self.filled])
    }
}

with_widest_vectors! {
    fn fill_heights(heights: &mut Heights, window: &Window, between: &BoxQuery, cylinder: &Cylinder)
        = fill
}

/// Replaces all values by those of the points of the window, of which only those in the box are
/// tested. No closures: they would not be compiled for wide vectors.
#[inline(always)]
fn fill(heights: &mut Heights, window: &Window, between: &BoxQuery, cylinder: &Cylinder) {
    heights.filled = 0;
    for row in 0..window.rows() {
        let [x, y, z] = window.row_in_box(row, between);
        let begin = heights.filled;
        let end = begin + x.len();
        if heights.heights.len() < end {
            heights.heights.resize(2 * end, 0.0);
            heights.weights.resize(2 * end, 0.0);
        }
        write(
            x,
            y,
            z,
            cylinder,
            &mut heights.heights[begin..end],
            &mut heights.weights[begin..end],
        );
        heights.filled = end;
    }
}

/// Writes the height and weight of every point.
#[inline(always)]
fn write(
    x: &[f64],
    y: &[f64],
    z: &[f64],
    cylinder: &Cylinder,
    heights: &mut [f64],
    weights: &mut [f64],
) {
    let count = x.len();
    let (y, z) = (&y[..count], &z[..count]);
    let (heights, weights) = (&mut heights[..count], &mut weights[..count]);
    let cylinder = *cylinder;
    for at in 0..count {
        let (height, inside) = cylinder.place([x[at], y[at], z[at]]);
        let inside = u64::from(inside).wrapping_neg();
        heights[at] = f64::from_bits(height.to_bits() & inside);
        weights[at] = f64::from_bits(1f64.to_bits() & inside);
    }
}
