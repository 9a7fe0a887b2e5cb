//! Where scanners look: they should see neither the sky nor the robot.

use crate::calibration::{Mounting, ScannerSample};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::statistics::{median, quantile};
use crate::surface::ProfilePoint;
use crate::verdict::Verdict;

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
/// The ground does not: in a typical direction the middle half of the ranges spreads by more, metres.
const VARYING_M: f64 = 0.02;
/// Smallest share of points that is worth mentioning.
const LEAST_SHARE: f64 = 0.02;
/// Largest number of points of a scanner that are examined.
const MAX_POINTS: usize = 100_000;

/// Verdicts on scanners that look up or see the robot.
pub fn fans(mountings: &[Mounting], samples: &[ScannerSample]) -> Vec<Verdict> {
    let scanners = mountings.iter().zip(samples);
    let verdicts = scanners.flat_map(|(mounting, sample)| {
        let name = &mounting.name;
        let rotation = mounting.body_from_scanner.rotation;
        let rises = |point: &ProfilePoint| {
            let body = sample.profiles[point.profile as usize].world_from_body;
            let ray = body.rotation * (rotation * point.position_m);
            ray.z > RISING * ray.norm()
        };
        let rising = share(sample, rises);
        let upward = (rising > MOST_RISING).then(|| {
            let text = format!(
                "As it is mounted, scanner `{name}` looks upwards: {:.0} % of its points lie higher \
                 than the scanner itself. Check rotation, rotation_convention and frame.body.",
                100.0 * rising
            );
            Verdict::care("scanner.upward", text).with_value(rising, None)
        });
        let robot = share_on_robot(sample).map(|share| {
            let text = format!(
                "{:.0} % of the points of scanner `{name}` have the same range all along the drive, unlike those \
                 on the ground: it sees the robot. Leave these points out of the profiles.",
                100.0 * share
            );
            Verdict::care("scanner.robot", text).with_value(share, None)
        });
        upward.into_iter().chain(robot)
    });
    verdicts.collect()
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

/// The share of points in directions in which the range stays the same, if it varies in a typical
/// direction.
fn share_on_robot(sample: &ScannerSample) -> Option<f64> {
    let mut ranges: VoxelMap<VoxelKey, Vec<f64>> = VoxelMap::default();
    for point in examined(sample) {
        let range_m = point.position_m.norm();
        let key = voxel_key(&(point.position_m / range_m), DIRECTION);
        ranges.entry(key).or_default().push(range_m);
    }
    let full = ranges.into_values().filter(|all| all.len() >= MIN_POINTS);
    let spreads = full.map(|mut all| {
        all.sort_unstable_by(f64::total_cmp);
        (quantile(&all, 0.75) - quantile(&all, 0.25), all.len())
    });
    let spreads: Vec<(f64, usize)> = spreads.collect();
    let all: usize = spreads.iter().map(|(_, count)| count).sum();
    let same = spreads.iter().filter(|(spread_m, _)| *spread_m < SAME_M);
    let same: usize = same.map(|(_, count)| count).sum();
    let share = same as f64 / all.max(1) as f64;
    let typical_m = median(spreads.iter().map(|(spread_m, _)| *spread_m))?;
    (share > LEAST_SHARE && typical_m > VARYING_M).then_some(share)
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

    fn codes(rotation: Vec3, on_robot: usize) -> Vec<String> {
        let pose = BodyFromScanner::new(so3::exp(&rotation), Vec3::zeros());
        let verdicts = fans(&[Mounting::new("left", pose)], &[sample(on_robot)]);
        verdicts.into_iter().map(|verdict| verdict.code).collect()
    }

    #[test]
    fn scanners_that_look_up_or_at_the_robot_are_named() {
        let down = Vec3::new(std::f64::consts::PI, 0.0, 0.0);
        assert!(codes(down, 0).is_empty());
        assert_eq!(codes(Vec3::zeros(), 0), ["scanner.upward"]);
        assert_eq!(codes(down, 3), ["scanner.robot"]);
    }
}
