//! The cylinder around a core point.

use crate::cloud::NeighbourIndex;
use crate::cloud::neighbours::Bounds;
use crate::geometry::Vec3;
use crate::project::ComparisonSettings;

/// Closed at its side. Open at its ends, closed at the core point where it is one-sided.
pub(super) struct Cylinder {
    centre: Vec3,
    axis: Vec3,
    radius_m: f64,
    half_length_m: f64,
    one_sided: bool,
}

impl Cylinder {
    pub(super) fn new(centre: Vec3, axis: Vec3, settings: &ComparisonSettings) -> Self {
        Self {
            centre,
            axis,
            radius_m: settings.cylinder_radius_m,
            half_length_m: settings.max_distance_m.max(settings.cylinder_radius_m),
            one_sided: settings.one_sided,
        }
    }

    /// Whether the box may hold points of the cylinder: false only where surely none is inside,
    /// with room for the rounding of the test itself.
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

    /// Replaces `heights` by those of the points of `cloud` inside, along the axis from the centre,
    /// metres.
    pub(super) fn heights(&self, cloud: &NeighbourIndex, heights: &mut Vec<f64>) {
        heights.clear();
        let lowest = if self.one_sided {
            0.0
        } else {
            f64::NEG_INFINITY
        };
        cloud.visit(
            |bounds| self.may_meet(bounds),
            |_, point| {
                let offset = point - self.centre;
                let height = offset.dot(&self.axis);
                let across = offset - self.axis * height;
                let inside = height.abs() < self.half_length_m
                    && height >= lowest
                    && across.norm_squared() <= self.radius_m * self.radius_m;
                if inside {
                    heights.push(height);
                }
            },
        );
    }
}
