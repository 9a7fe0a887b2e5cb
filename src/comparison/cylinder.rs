//! The cylinder around a core point.

use super::window::Window;
use crate::cloud::NeighbourIndex;
use crate::cloud::neighbours::Bounds;
use crate::geometry::Vec3;
use crate::project::ComparisonSettings;

/// Points that are tested side by side.
const LANES: usize = 2;

/// Closed at its side. Open at its ends, closed at the core point where it is one-sided.
pub(super) struct Cylinder {
    centre: Vec3,
    axis: Vec3,
    radius_m: f64,
    half_length_m: f64,
    one_sided: bool,
    /// Smallest height.
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
    pub(super) fn heights_in_tree(&self, cloud: &NeighbourIndex, heights: &mut Vec<f64>) {
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
    }

    /// As [`Self::heights_in_tree`], of the points in a window that holds all of the cylinder.
    pub(super) fn heights_in_window(&self, window: &Window, heights: &mut Vec<f64>) {
        // No more than this from the centre, along each coordinate, to the one side and the other.
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
        heights.clear();
        let mut filled = 0;
        window.in_box(&(self.centre + low), &(self.centre + high), |points| {
            filled = self.keep(points, heights, filled);
        });
        heights.truncate(filled);
    }

    /// Writes the heights of those of `points` that are inside to `heights`, from `filled` on, and
    /// returns where they end.
    fn keep(&self, points: [&[f64]; 3], heights: &mut Vec<f64>, mut filled: usize) -> usize {
        let count = points[0].len();
        if heights.len() < filled + count {
            heights.resize(2 * (filled + count), 0.0);
        }
        let [(x, x_rest), (y, y_rest), (z, z_rest)] =
            points.map(|coordinates| coordinates.as_chunks::<LANES>());
        // Written in any case and kept by counting it: which points are inside is as good as random,
        // and would cost a mispredicted branch every other time.
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            let placed: [(f64, bool); LANES] =
                std::array::from_fn(|lane| self.place([x[lane], y[lane], z[lane]]));
            for (height, inside) in placed {
                heights[filled] = height;
                filled += usize::from(inside);
            }
        }
        for ((x, y), z) in x_rest.iter().zip(y_rest).zip(z_rest) {
            let (height, inside) = self.place([*x, *y, *z]);
            heights[filled] = height;
            filled += usize::from(inside);
        }
        filled
    }

    /// The height of a point along the axis, and whether it lies inside.
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
        // All of them in any case: branches would be mispredicted.
        let inside = (height.abs() < self.half_length_m)
            & (height >= self.lowest_m)
            & (squared <= self.radius_m * self.radius_m);
        (height, inside)
    }
}
