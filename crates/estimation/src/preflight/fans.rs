//! Where scanners look: neither at the sky nor at the robot.

use crate::calibration::{Mounting, ScannerSample};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::statistics::{median, quantile};
use crate::surface::ProfilePoint;
use crate::verdict::Verdict;

/// A ray that rises by this share of its length looks up.
const RISING: f64 = 0.1;
/// A scanner looks up where this share of its points does.
const MOST: f64 = 0.9;
/// Rays of one direction to this part of the unit sphere are compared.
const DIRECTION: f64 = 0.02;
/// Fewest points of a direction.
const MIN_POINTS: usize = 50;
/// What moves along is always as far away, to this spread of the middle half, metres; the ground is not.
const SAME_M: f64 = 0.004;
const OTHERS_M: f64 = 0.02;
/// Least share of points that is worth mentioning.
const LEAST_SHARE: f64 = 0.02;
/// Most points of a scanner that are looked at.
const MAX_POINTS: usize = 100_000;

/// What the directions and ranges of the points contradict.
pub fn fans(mountings: &[Mounting], samples: &[ScannerSample]) -> Vec<Verdict> {
    let scanners = mountings.iter().zip(samples);
    let found = scanners.flat_map(|(mounting, sample)| {
        let name = &mounting.name;
        let rotation = mounting.body_from_scanner.rotation;
        let rises = |point: &ProfilePoint| {
            let body = sample.profiles[point.profile as usize].world_from_body;
            let ray = body.rotation * (rotation * point.position_m);
            ray.z > RISING * ray.norm()
        };
        let rising = share(sample, rises);
        let upward = (rising > MOST).then(|| {
            let text = format!(
                "As it is mounted, scanner `{name}` looks upwards: {:.0} % of its points lie higher \
                 than itself. Check rotation, rotation_convention and frame.body.",
                100.0 * rising
            );
            Verdict::care("scanner.upward", text).with_value(rising, None)
        });
        let carried = carried(sample).map(|share| {
            let text = format!(
                "{:.0} % of the points of scanner `{name}` are always as far away while the ground is not: it \
                 sees the robot. Leave these points out of the profiles.",
                100.0 * share
            );
            Verdict::care("scanner.robot", text).with_value(share, None)
        });
        upward.into_iter().chain(carried)
    });
    found.collect()
}

fn some(sample: &ScannerSample) -> impl Iterator<Item = &ProfilePoint> {
    let every = sample.points.len().div_ceil(MAX_POINTS).max(1);
    sample.points.iter().step_by(every)
}

fn share(sample: &ScannerSample, is_one: impl Fn(&ProfilePoint) -> bool) -> f64 {
    let all = some(sample).count();
    some(sample).filter(|point| is_one(point)).count() as f64 / all.max(1) as f64
}

/// The share of points in directions in which the range stays the same, if it does not in others.
fn carried(sample: &ScannerSample) -> Option<f64> {
    let mut ranges: VoxelMap<VoxelKey, Vec<f64>> = VoxelMap::default();
    for point in some(sample) {
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
    (share > LEAST_SHARE && typical_m > OTHERS_M).then_some(share)
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
        let found = fans(&[Mounting::new("left", pose)], &[sample(on_robot)]);
        found.into_iter().map(|verdict| verdict.code).collect()
    }

    #[test]
    fn scanners_that_look_up_or_at_the_robot_are_named() {
        let down = Vec3::new(std::f64::consts::PI, 0.0, 0.0);
        assert!(codes(down, 0).is_empty());
        assert_eq!(codes(Vec3::zeros(), 0), ["scanner.upward"]);
        assert_eq!(codes(down, 3), ["scanner.robot"]);
    }
}
