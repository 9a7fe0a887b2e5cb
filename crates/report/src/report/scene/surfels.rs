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
    let mut roughness: Vec<f64> = planes.iter().map(|plane| plane.roughness_m).collect();
    roughness.sort_by(f64::total_cmp);
    let most = if roughness.is_empty() {
        1.0
    } else {
        nice_above(quantile(&roughness, REACHED).max(1e-5))
    };
    let sizes = planes.iter().map(|plane| plane.size_m);
    let largest_m = sizes.clone().fold(0.0, f64::max);
    let mut surfels = Surfels {
        roughness: Bytes::of((0.0, most), planes.iter().map(|plane| plane.roughness_m)),
        sizes: Bytes::of((0.0, largest_m), sizes),
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
        let small = SurfelPlane {
            centre_m: Vec3::new(11.0, 20.5, 3.0),
            normal: Vec3::new(0.6, 0.0, -0.8),
            size_m: 0.05,
            roughness_m: 1e-3,
        };
        let large = SurfelPlane {
            centre_m: Vec3::new(10.0, 20.0, 4.0),
            size_m: 0.1,
            ..small
        };
        let encoded = surfels(&[small, large], &Vec3::new(10.0, 20.0, 3.0));
        let axes = [vec![100_000, 0], vec![50_000, 0], vec![0, 100_000]];
        assert_eq!(encoded.centres.axes, axes);
        let normal = encoded.normals.map(|list| list[0].cast_signed());
        assert_eq!(normal, [-76, 0, 102]);
        assert_eq!(
            (encoded.sizes.high, encoded.sizes.values),
            (0.1, vec![128, 255])
        );
        assert_eq!(surfels(&[], &Vec3::zeros()).centres, Places::default());
    }
}
