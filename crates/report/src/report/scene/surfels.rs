//! The surfels of a joint adjustment, for the viewer.

use super::quantised::{Bytes, Places};
use super::{REFERENCE_STEP_M, Surfels};
use crate::geometry::Vec3;
use crate::joint::SurfelPlane;
use crate::number::nice_above;
use crate::statistics::quantile;

/// Number of steps of a component of a normal from 0 to 1.
const STEPS: f64 = 127.0;
/// Quantile of the roughness that the largest byte stands for.
const REACHED: f64 = 0.98;

/// Encodes `planes`; coordinates are relative to the origin.
pub fn surfels(planes: &[SurfelPlane], origin_m: &Vec3) -> Surfels {
    let mut sizes: Vec<f64> = planes.iter().map(|plane| plane.roughness_m).collect();
    sizes.sort_by(f64::total_cmp);
    let most = if sizes.is_empty() {
        1.0
    } else {
        nice_above(quantile(&sizes, REACHED).max(1e-5))
    };
    let mut surfels = Surfels {
        roughness: Bytes::of((0.0, most), planes.iter().map(|plane| plane.roughness_m)),
        size_m: planes.first().map_or(0.0, |plane| plane.size_m),
        centres: Places::default(),
        normals: Default::default(),
    };
    for plane in planes {
        let from_origin = plane.centre_m - origin_m;
        surfels.centres.push(&from_origin, REFERENCE_STEP_M);
        // The side of the surfel that faces up.
        let up = if plane.normal.z < 0.0 {
            -plane.normal
        } else {
            plane.normal
        };
        for (list, x) in surfels.normals.iter_mut().zip(up.iter()) {
            list.push(((x * STEPS).round() as i8).cast_unsigned());
        }
    }
    surfels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_are_where_they_are_and_face_up() {
        let plane = SurfelPlane {
            centre_m: Vec3::new(11.0, 20.5, 3.0),
            normal: Vec3::new(0.6, 0.0, -0.8),
            size_m: 0.1,
            roughness_m: 1e-3,
        };
        let encoded = surfels(&[plane], &Vec3::new(10.0, 20.0, 3.0));
        assert_eq!(encoded.centres.axes, [vec![100_000], vec![50_000], vec![0]]);
        let normal = encoded.normals.map(|list| list[0].cast_signed());
        assert_eq!(normal, [-76, 0, 102]);
        assert_eq!(encoded.size_m, 0.1);
        assert_eq!(surfels(&[], &Vec3::zeros()).centres, Places::default());
    }
}
