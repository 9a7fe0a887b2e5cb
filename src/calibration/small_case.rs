//! A small scene for tests: every kind of point, nothing symmetric.

use super::neighbourhoods::{MovablePoint, ScaleCloud};
use super::parameters::Mounting;
use crate::geometry::{BodyFromScanner, EulerConvention, Rotation, Vec3};

/// Numbers in [-1, 1) from a linear congruential generator: the same everywhere.
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Two scanners over a bumpy surface, each point with a pose of its own, and a reference.
pub fn case() -> (ScaleCloud, Vec<Mounting>) {
    let mut next = numbers();
    let movable = (0..400)
        .map(|i| {
            let turn = Rotation::from_scaled_axis(Vec3::new(next(), next(), next()) * 0.3);
            MovablePoint {
                scanner: i % 2,
                time_s: f64::from(i),
                position_m: Vec3::new(next(), 0.1 * next(), -1.0 + 0.05 * next()),
                world_from_body: *turn.to_rotation_matrix().matrix(),
                body_m: Vec3::new(next(), next(), 2.0),
            }
        })
        .collect();
    let fixed = (0..100)
        .map(|_| Vec3::new(next(), next(), 1.0 + 0.3 * next()))
        .collect();
    let mountings = ["left", "right"]
        .map(|name| {
            let translation_m = Vec3::new(0.3 * next(), 0.3 * next(), 0.1 * next());
            let rotation = Rotation::from_scaled_axis(Vec3::new(next(), next(), next()));
            Mounting {
                name: name.into(),
                body_from_scanner: BodyFromScanner::new(rotation, translation_m),
                convention: EulerConvention::Zyx,
                fixed: [false; 6],
            }
        })
        .to_vec();
    (
        ScaleCloud {
            movable,
            fixed,
            scanners: 2,
            floor_m: 0.02,
        },
        mountings,
    )
}
