//! Where scanners look: they should see neither the sky nor the robot.

use serde::{Deserialize, Serialize};

use crate::calibration::{Mounting, ScannerSample};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::Rotation;
use crate::statistics::{median, quantile};
use crate::surface::ProfilePoint;

/// A ray that rises by this share of its length looks up.
const RISING: f64 = 0.1;
/// A scanner looks up if this share of its rays does.
const MOST_RISING: f64 = 0.9;
/// Rays are compared that have the same direction, to cells of this size on the unit sphere.
const DIRECTION: f64 = 0.02;
/// Fewest points of a direction.
const MIN_POINTS: usize = 50;
/// A part of the robot always has the same range: the middle half of the ranges spreads by less, metres.
const SAME_M: f64 = 0.004;
/// The ground does not: in a typical direction the middle half of the heights below the scanner spreads by more,
/// metres. Ranges to level ground spread too, where rays are oblique and the robot tilts.
const VARYING_M: f64 = 0.02;
/// Smallest share of points that is worth mentioning.
const LEAST_SHARE: f64 = 0.02;
/// Largest number of points of a scanner that are examined.
const MAX_POINTS: usize = 100_000;

/// What a scanner sees that it should not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum View {
    /// It looks upwards.
    Upward {
        /// Name of the scanner.
        scanner: String,
        /// The share of its points that lie higher than the scanner.
        share: f64,
    },
    /// It sees the robot.
    Robot {
        /// Name of the scanner.
        scanner: String,
        /// The share of its points that lie on the robot.
        share: f64,
    },
}

/// The scanners that look up or see the robot.
pub fn fans(mountings: &[Mounting], samples: &[ScannerSample]) -> Vec<View> {
    let scanners = mountings.iter().zip(samples);
    let views = scanners.flat_map(|(mounting, sample)| {
        let scanner = || mounting.name.clone();
        let rotation = mounting.body_from_scanner.rotation;
        let rises = |point: &ProfilePoint| {
            let body = sample.profiles[point.profile as usize].world_from_body;
            let ray = body.rotation * (rotation * point.position_m);
            ray.z > RISING * ray.norm()
        };
        let rising = share(sample, rises);
        let upward = (rising > MOST_RISING).then(|| View::Upward {
            scanner: scanner(),
            share: rising,
        });
        let robot = share_on_robot(sample, &rotation).map(|share| View::Robot {
            scanner: scanner(),
            share,
        });
        upward.into_iter().chain(robot)
    });
    views.collect()
}

/// At most [`MAX_POINTS`] points of a scanner, evenly chosen.
fn examined(sample: &ScannerSample) -> impl Iterator<Item = &ProfilePoint> {
    let every = sample.points.len().div_ceil(MAX_POINTS).max(1);
    sample.points.iter().step_by(every)
}

/// The share of points for which a condition holds.
fn share(sample: &ScannerSample, holds: impl Fn(&ProfilePoint) -> bool) -> f64 {
    let all = examined(sample).count();
    examined(sample).filter(|point| holds(point)).count() as f64 / all.max(1) as f64
}

/// The share of points in directions in which the range stays the same, if the height of the points varies in a typical
/// direction; given the rotation of the scanner on the body.
fn share_on_robot(sample: &ScannerSample, body_from_scanner: &Rotation) -> Option<f64> {
    let mut directions: VoxelMap<VoxelKey, [Vec<f64>; 2]> = VoxelMap::default();
    for point in examined(sample) {
        let range_m = point.position_m.norm();
        let key = voxel_key(&(point.position_m / range_m), DIRECTION);
        let body = sample.profiles[point.profile as usize].world_from_body;
        let ray_m = body.rotation * (body_from_scanner * point.position_m);
        let [ranges_m, heights_m] = directions.entry(key).or_default();
        ranges_m.push(range_m);
        heights_m.push(ray_m.z);
    }
    let full = directions.into_values();
    let full = full.filter(|[ranges_m, _]| ranges_m.len() >= MIN_POINTS);
    let spreads: Vec<([f64; 2], usize)> = full
        .map(|values| {
            let count = values[0].len();
            (values.map(middle_half_m), count)
        })
        .collect();
    let all: usize = spreads.iter().map(|(_, count)| count).sum();
    let same = spreads.iter().filter(|([range_m, _], _)| *range_m < SAME_M);
    let same: usize = same.map(|(_, count)| count).sum();
    let share = same as f64 / all.max(1) as f64;
    let typical_m = median(spreads.iter().map(|([_, height_m], _)| *height_m))?;
    (share > LEAST_SHARE && typical_m > VARYING_M).then_some(share)
}

/// The extent of the middle half of values.
fn middle_half_m(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    quantile(&values, 0.75) - quantile(&values, 0.25)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BodyFromScanner, Vec3, WorldFromBody, so3};
    use crate::surface::Profile;

    /// A hundred profiles over ground that rises and falls by 5 cm, from a metre above it, with rays of 40
    /// directions; those of the first few end on the robot.
    fn sample(on_robot: usize) -> ScannerSample {
        let mut sample = ScannerSample::default();
        for index in 0..100_u32 {
            let time_s = f64::from(index);
            sample.profiles.push(Profile {
                time_s,
                world_from_body: WorldFromBody::new(
                    so3::exp(&Vec3::zeros()),
                    Vec3::new(0.1 * time_s, 0.0, 1.0),
                ),
            });
            for ray in 0..40 {
                let angle = 0.025 * (ray as f64 - 20.0);
                let ground_m = (1.0 + 0.05 * (0.4 * time_s).sin()) / angle.cos();
                let range_m = if ray < on_robot { 0.5 } else { ground_m };
                sample.points.push(ProfilePoint {
                    profile: index,
                    position_m: Vec3::new(0.0, angle.sin(), angle.cos()) * range_m,
                    count: 1,
                });
            }
        }
        sample
    }

    fn views(rotation: Vec3, on_robot: usize) -> Vec<View> {
        let pose = BodyFromScanner::new(so3::exp(&rotation), Vec3::zeros());
        fans(&[Mounting::new("left", pose)], &[sample(on_robot)])
    }

    #[test]
    fn scanners_that_look_up_or_at_the_robot_are_named() {
        let down = Vec3::new(std::f64::consts::PI, 0.0, 0.0);
        let scanner = || "left".to_owned();
        assert!(views(down, 0).is_empty());
        let (upward, robot) = (views(Vec3::zeros(), 0), views(down, 3));
        assert_eq!(
            upward,
            [View::Upward {
                scanner: scanner(),
                share: 1.0
            }]
        );
        assert_eq!(
            robot,
            [View::Robot {
                scanner: scanner(),
                share: 3.0 / 40.0
            }]
        );
    }

    #[test]
    fn a_level_floor_is_not_the_robot() {
        // Where the robot tilts, the ranges of oblique rays vary by decimetres and those of vertical ones hardly.
        let mut sample = ScannerSample::default();
        for index in 0..100_u32 {
            let tilt_rad = 0.03 * (0.4 * f64::from(index)).sin();
            sample.profiles.push(Profile {
                time_s: f64::from(index),
                world_from_body: WorldFromBody::new(
                    so3::exp(&(Vec3::x() * tilt_rad)),
                    Vec3::new(0.1 * f64::from(index), 0.0, 1.0),
                ),
            });
            for ray in 0..50 {
                let angle = 0.05 * f64::from(ray) - 1.25;
                let range_m = 1.0 / (angle + tilt_rad).cos();
                sample.points.push(ProfilePoint {
                    profile: index,
                    position_m: Vec3::new(0.0, angle.sin(), -angle.cos()) * range_m,
                    count: 1,
                });
            }
        }
        let same = |spread_m: f64| spread_m < SAME_M;
        let ranges = |ray: usize| sample.points.iter().skip(ray).step_by(50);
        let spread_m = |ray| middle_half_m(ranges(ray).map(|p| p.position_m.norm()).collect());
        assert!(same(spread_m(25)) && spread_m(0) > VARYING_M);
        let level = Rotation::identity();
        assert_eq!(share_on_robot(&sample, &level), None);
    }
}
