//! The sampled points of a drive in the world.

use crate::calibration::ScannerSample;
use crate::comparison::TimedPoint;
use crate::geometry::BodyFromScanner;
use crate::joint::Joint;

/// The points of samples on their poses with these mountings.
pub fn on_given_poses(samples: &[ScannerSample], mountings: &[BodyFromScanner]) -> Vec<TimedPoint> {
    let scanners = samples.iter().zip(mountings).enumerate();
    let points = scanners.flat_map(|(scanner, (sample, mounting))| {
        sample.points.iter().map(move |point| {
            let profile = &sample.profiles[point.profile as usize];
            let in_body = mounting.map(&point.position_m);
            TimedPoint {
                scanner,
                time_s: profile.time_s,
                position_m: Some(profile.world_from_body.map(&in_body)),
            }
        })
    });
    points.collect()
}

/// The points of samples on the adjusted poses with the adjusted mountings.
pub fn on_adjusted_poses(samples: &[ScannerSample], joint: &Joint) -> Vec<TimedPoint> {
    let (drive, mountings) = (&joint.drives[0], joint.poses());
    let scanners = samples.iter().zip(&mountings).enumerate();
    let points = scanners.flat_map(|(scanner, (sample, mounting))| {
        let late_s = joint
            .late_s
            .get(scanner)
            .copied()
            .flatten()
            .map_or(0.0, |(late_s, _)| late_s);
        let profiles = sample.profiles.iter();
        let profiles =
            profiles.map(|profile| drive.poses_at(scanner, mounting, profile.time_s - late_s));
        let profiles: Vec<_> = profiles.collect();
        sample.points.iter().map(move |point| {
            let number = point.profile as usize;
            let pose = &profiles[number];
            TimedPoint {
                scanner,
                time_s: sample.profiles[number].time_s,
                position_m: pose
                    .as_ref()
                    .map(|(body, mounting)| body.map(&mounting.map(&point.position_m))),
            }
        })
    });
    points.collect()
}
