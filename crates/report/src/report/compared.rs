//! Comparisons for unit tests.

use crate::comparison::{
    Against, Agreement, CoreDistance, DistanceMap, M3c2, MountingKind, Statistics,
};
use crate::geometry::Vec3;

/// A comparison of the left scanner with the reference, with core points along x: place, distance and level of
/// detection, metres.
pub fn agreement(core: &[[f64; 3]]) -> Agreement {
    let core = core.iter().map(|[x, distance_m, level_m]| CoreDistance {
        point: Vec3::new(*x, 0.0, 0.0),
        normal: Vec3::z(),
        normal_radius_m: 0.04,
        distance_m: *distance_m,
        level_of_detection_m: *level_m,
        reference_spread_m: 1e-3,
        compared_spread_m: 1e-3,
        reference_count: 10,
        compared_count: 10,
    });
    let distances = M3c2 {
        core: core.collect(),
    };
    Agreement {
        coverage: 1.0,
        scanner: "left".into(),
        against: Against::Reference,
        mounting: MountingKind::Final,
        statistics: Statistics::of(&distances).unwrap(),
        distances: DistanceMap::of(&distances),
    }
}
