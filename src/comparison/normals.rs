//! Normals at core points.

use crate::cloud::{NeighbourIndex, StructureTensor};
use crate::geometry::Vec3;

/// The direction of `vector`, all NaN where it has none.
pub(super) fn unit(vector: &Vec3) -> Vec3 {
    let norm = vector.norm();
    // The squares of components outside this range overflow or vanish.
    if (1e-140..1e140).contains(&norm) {
        return vector / norm;
    }
    let largest = vector.amax();
    if largest > 0.0 && vector.iter().all(|component| component.is_finite()) {
        (vector / largest).normalize()
    } else {
        Vec3::repeat(f64::NAN)
    }
}

/// The normal of the most planar neighbourhood, on the side of `orientation`, and its radius. `None`
/// where none of them has three points that span a plane.
pub(super) fn most_planar(
    cloud: &NeighbourIndex,
    point: &Vec3,
    radii: &[f64],
    orientation: &Vec3,
    near: &mut Vec<(f64, Vec3)>,
) -> Option<(Vec3, f64)> {
    let widest = radii.iter().copied().fold(0.0, f64::max);
    near.clear();
    cloud.visit(
        |bounds| bounds.squared_distance(point) <= widest * widest,
        |_, neighbour| {
            let squared = (neighbour - point).norm_squared();
            if squared <= widest * widest {
                near.push((squared, *neighbour));
            }
        },
    );
    let mut best: Option<(f64, Vec3, f64)> = None;
    for &radius in radii {
        let inside = near
            .iter()
            .filter(|(squared, _)| *squared <= radius * radius);
        let tensor = StructureTensor::from_points(inside.map(|(_, neighbour)| neighbour));
        if tensor.count < 3 {
            continue;
        }
        let eigen = tensor.eigen();
        let planarity = eigen.planarity();
        if planarity > best.map_or(0.0, |(most, _, _)| most) {
            best = Some((planarity, eigen.vectors.column(2).into_owned(), radius));
        }
    }
    best.map(|(_, normal, radius)| {
        let turned = if normal.dot(orientation) < 0.0 {
            -normal
        } else {
            normal
        };
        (turned, radius)
    })
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
