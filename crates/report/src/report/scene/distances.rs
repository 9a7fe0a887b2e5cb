//! The distance at a point, taken from the nearest core point.
//!
//! A misplaced cloud lies above or below the core points by up to the longest distance, and beside them by no more
//! than their spacing. Height differences therefore count less than horizontal ones, in this ratio.

use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::comparison::DistanceMap;
use crate::geometry::Vec3;

/// The core points of a comparison, by place.
pub struct Distances {
    reach_m: f64,
    /// Divisor of heights.
    flatter: f64,
    /// Core points with divided heights, each with its distance and level of detection.
    core: Vec<(Vec3, [f64; 2])>,
    /// First and end index of the core points of a voxel.
    voxels: VoxelMap<VoxelKey, (u32, u32)>,
}

impl Distances {
    /// The distances of a map. Core points are searched up to `reach_m` to the side, the spacing of core points, and up
    /// to `most_m` above or below; both are positive.
    pub fn new(map: &DistanceMap, reach_m: f64, most_m: f64) -> Self {
        let flatter = (most_m / reach_m).max(1.0);
        let points = map.points().zip(map.levels_of_detection_m());
        let mut keyed: Vec<_> = points
            .map(|((point, distance_m), detection_m)| {
                let point = flattened(&point, flatter);
                (
                    voxel_key(&point, reach_m),
                    (point, [distance_m, detection_m]),
                )
            })
            .collect();
        keyed.sort_by_key(|(key, _)| *key);
        let mut voxels = VoxelMap::default();
        let mut begin = 0;
        for same in keyed.chunk_by(|a, b| a.0 == b.0) {
            let end = begin + same.len() as u32;
            voxels.insert(same[0].0, (begin, end));
            begin = end;
        }
        Self {
            reach_m,
            flatter,
            core: keyed.into_iter().map(|(_, core)| core).collect(),
            voxels,
        }
    }

    /// Distance and level of detection of the core point nearest to `point`, metres; NaN if none is within reach.
    pub fn at(&self, point: &Vec3) -> [f64; 2] {
        let point = flattened(point, self.flatter);
        let [x, y, z] = voxel_key(&point, self.reach_m);
        let mut nearest = (self.reach_m.powi(2), [f64::NAN; 2]);
        for place in 0..27 {
            let (i, j, k) = (place % 3 - 1, place / 3 % 3 - 1, place / 9 - 1);
            let Some(&(begin, end)) = self.voxels.get(&[x + i, y + j, z + k]) else {
                continue;
            };
            for (core, values) in &self.core[begin as usize..end as usize] {
                let squared = (core - point).norm_squared();
                if squared <= nearest.0 {
                    nearest = (squared, *values);
                }
            }
        }
        nearest.1
    }
}

fn flattened(point: &Vec3, flatter: f64) -> Vec3 {
    Vec3::new(point.x, point.y, point.z / flatter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::{CoreDistance, M3c2};

    #[test]
    fn the_nearest_core_point_within_reach_counts() {
        let core = |x: f64, distance_m: f64| CoreDistance {
            point: Vec3::new(x, 5.0, 0.0),
            normal: Vec3::z(),
            normal_radius_m: f64::NAN,
            distance_m,
            level_of_detection_m: 2.0 * distance_m,
            reference_spread_m: f64::NAN,
            compared_spread_m: f64::NAN,
            reference_count: 1,
            compared_count: 1,
        };
        let core = vec![core(0.0, 0.5), core(0.0399, 0.25), core(0.9, 1.0)];
        let distances = Distances::new(&DistanceMap::of(&M3c2 { core }), 0.02, 0.1);
        let at = |x: f64| distances.at(&Vec3::new(x, 5.0, 0.001));
        assert_eq!(at(0.019), [0.5, 1.0]);
        assert_eq!(at(0.021), [0.25, 0.5]);
        assert_eq!(at(0.889), [1.0, 2.0]);
        assert!(at(0.879)[0].is_nan());
        let above = |z: f64| distances.at(&Vec3::new(0.9, 5.0, z))[0];
        assert!(above(0.099) == 1.0 && above(-0.101).is_nan());
    }
}
