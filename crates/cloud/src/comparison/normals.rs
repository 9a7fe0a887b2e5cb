//! Normals at core points.

use super::moments::Offsets;
use super::window::Window;
use crate::cloud::{NeighbourIndex, StructureTensor};
use crate::geometry::{Vec3, is_finite};

/// The normal at a core point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Normal {
    /// Unit vector; NaN if there is none.
    pub(super) direction: Vec3,
    /// Radius of its neighbourhood, metres; NaN if it was given or there is none.
    pub(super) radius_m: f64,
}

impl Normal {
    pub(super) const NONE: Self = Self {
        direction: Vec3::new(f64::NAN, f64::NAN, f64::NAN),
        radius_m: f64::NAN,
    };
}

/// The unit vector of `vector`; NaN if it is zero or not finite.
pub(super) fn unit(vector: &Vec3) -> Vec3 {
    let norm = vector.norm();
    // The squares of components outside this range overflow or underflow.
    if (1e-140..1e140).contains(&norm) {
        return vector / norm;
    }
    let largest = vector.amax();
    if largest > 0.0 && is_finite(vector) {
        (vector / largest).normalize()
    } else {
        Vec3::repeat(f64::NAN)
    }
}

/// Where normals are oriented towards.
#[derive(Debug, Clone)]
pub(super) enum Orientation {
    /// A direction.
    Direction(Vec3),
    /// The nearest of these places.
    SeenFrom(NeighbourIndex, Vec<Vec3>),
}

impl Orientation {
    /// Towards the nearest of these places (metres, at least one).
    pub(super) fn seen_from(places: &[Vec3]) -> Self {
        Self::SeenFrom(NeighbourIndex::new(places), places.to_vec())
    }

    /// The direction at a point, of any length.
    fn at(&self, point: &Vec3) -> Vec3 {
        match self {
            Self::Direction(direction) => *direction,
            Self::SeenFrom(index, places) => {
                let mut nearest = Vec::new();
                index.nearest(point, 1, &mut nearest);
                let place = nearest.first().map(|&place| places[place as usize]);
                place.map_or(Vec3::zeros(), |place| place - point)
            }
        }
    }
}

/// Fraction of the scale of a neighbourhood's covariance below which its normal is computed in two
/// passes over the points instead of one.
const TWO_PASSES_BELOW: f64 = 0.01;

/// The normal of the most planar of the neighbourhoods of `point` with these radii, on the side of
/// `orientation` at the point. `None` if no neighbourhood has three points that span a plane.
pub(super) fn most_planar(
    window: &Window,
    point: &Vec3,
    radii: &[f64],
    orientation: &Orientation,
    offsets: &mut Offsets,
) -> Option<Normal> {
    let mut best: Option<(f64, Vec3, f64)> = None;
    for &radius in radii {
        offsets.fill(window, point, radius);
        let tensor = offsets.tensor(point);
        if tensor.count < 3 {
            continue;
        }
        let mut eigen = tensor.eigen();
        // The rounding error of sums of squares is relative to the squared radius; the normal of a
        // surface depends on this difference of two eigenvalues, which is about a quarter of that.
        if eigen.values.y - eigen.values.z < TWO_PASSES_BELOW * radius * radius {
            let near = points_in_ball(window, point, radius);
            eigen = StructureTensor::from_points(&near).eigen();
        }
        let planarity = eigen.planarity();
        if planarity > best.map_or(0.0, |(most, _, _)| most) {
            best = Some((planarity, eigen.vectors.column(2).into_owned(), radius));
        }
    }
    best.map(|(_, normal, radius_m)| Normal {
        direction: if normal.dot(&orientation.at(point)) < 0.0 {
            -normal
        } else {
            normal
        },
        radius_m,
    })
}

fn points_in_ball(window: &Window, centre: &Vec3, radius: f64) -> Vec<Vec3> {
    let ball = window.ball(centre, radius);
    let mut near = Vec::new();
    for row in 0..window.rows() {
        let [x, y, z] = window.row_in_ball(row, &ball);
        let points = x.iter().zip(y).zip(z);
        let points = points.map(|((x, y), z)| Vec3::new(*x, *y, *z));
        near.extend(points.filter(|point| (point - centre).norm_squared() <= radius * radius));
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_of_any_length_become_units() {
        for scale in [1e-310, 1e-200, 1e-3, 1.0, 1e200, 1e308] {
            let found = unit(&(Vec3::new(0.3, -0.4, 0.0) * scale));
            assert!(
                (found - Vec3::new(0.6, -0.8, 0.0)).norm() < 1e-12,
                "{scale}: {found}"
            );
        }
        for none in [
            Vec3::zeros(),
            Vec3::new(f64::NAN, 1.0, 0.0),
            Vec3::new(f64::INFINITY, 1.0, 0.0),
        ] {
            assert!(unit(&none).iter().all(|x| x.is_nan()));
        }
    }
}
