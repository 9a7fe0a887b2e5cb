//! Whether files of poses that overlap in time are of one body.

use std::path::Path;

use crate::error::{Error, Result};
use crate::sensor::PoseRecord;

/// Most poses that are compared.
const MOST: usize = 10_000;
/// Poses further apart do not tell where the body was between them, seconds.
const LONGEST_STEP_S: f64 = 0.5;
/// How far two records of one pose may lie apart because of how they were written: metres and radians, and shares of the
/// motion between the poses around it.
const SLACK_M: f64 = 0.01;
const SLACK_RAD: f64 = 2e-3;
const SLACK_OF_MOTION: f64 = 0.25;

/// Checks files of poses, each in time order, that are to be merged. Parts of one trajectory, such as strips or tiles, may
/// overlap: where they do, they have the same poses.
///
/// # Errors
/// Two files with other poses at the same times.
pub(super) fn check(files: &[(&Path, Vec<PoseRecord>)]) -> Result<()> {
    for (at, (first, poses)) in files.iter().enumerate() {
        for (second, others) in &files[at + 1..] {
            if let Some(time_s) = contradiction_s(poses, others) {
                return Err(Error::data(
                    format!(
                        "{} and {} have different poses at the same times, such as {time_s} s",
                        first.display(),
                        second.display()
                    ),
                    "the poses of one body in [trajectory]: name one of these files, and make a project of its own for the \
                     other",
                ));
            }
        }
    }
    Ok(())
}

/// The first time at which two lists of poses contradict each other, if they do so at most of their common times.
fn contradiction_s(poses: &[PoseRecord], others: &[PoseRecord]) -> Option<f64> {
    let (mut compared, mut different, mut first_s) = (0, 0, None);
    for other in others {
        let after = poses.partition_point(|pose| pose.time_s < other.time_s);
        let Some(end) = poses.get(after) else {
            break;
        };
        let start = if end.time_s == other.time_s {
            end
        } else {
            match after.checked_sub(1) {
                Some(before) => &poses[before],
                None => continue,
            }
        };
        if end.time_s - start.time_s > LONGEST_STEP_S {
            continue;
        }
        compared += 1;
        if differs(start, end, other) {
            different += 1;
            first_s.get_or_insert(other.time_s);
        }
        if compared == MOST {
            break;
        }
    }
    first_s.filter(|_| 2 * different > compared)
}

/// Whether a pose is none between two others.
fn differs(start: &PoseRecord, end: &PoseRecord, other: &PoseRecord) -> bool {
    let [a, b, c] = [start, end, other].map(|pose| pose.world_from_body);
    let span_s = end.time_s - start.time_s;
    let share = if span_s > 0.0 {
        (other.time_s - start.time_s) / span_s
    } else {
        0.0
    };
    let motion_m = b.translation_m - a.translation_m;
    let off_m = (c.translation_m - a.translation_m - share * motion_m).norm();
    let off_rad = a
        .rotation
        .angle_to(&c.rotation)
        .min(b.rotation.angle_to(&c.rotation));
    off_m > SLACK_M + SLACK_OF_MOTION * motion_m.norm()
        || off_rad > SLACK_RAD + a.rotation.angle_to(&b.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Rotation, Vec3, WorldFromBody};

    fn poses(times_s: impl Iterator<Item = f64>, aside_m: f64, yaw: f64) -> Vec<PoseRecord> {
        let pose = |time_s: f64| {
            let rotation = Rotation::from_euler_angles(0.0, 0.0, 0.2 * time_s + yaw);
            let place = Vec3::new(3.0 * time_s, aside_m, 0.1 * time_s.sin());
            PoseRecord::new(time_s, WorldFromBody::new(rotation, place))
        };
        times_s.map(pose).collect()
    }

    #[test]
    fn parts_of_a_trajectory_may_overlap_and_two_bodies_may_not() {
        let every = |from: u32, to: u32| (from..to).map(|i| 0.01 * f64::from(i));
        let first = poses(every(0, 300), 0.0, 0.0);
        let between = |from, to| every(from, to).map(|time_s| time_s + 0.004);
        for other in [
            poses(every(300, 400), 5.0, 0.0),
            poses(every(100, 400), 0.0, 0.0),
            poses(between(50, 200), 0.0, 0.0),
        ] {
            assert_eq!(contradiction_s(&first, &other), None);
        }
        for other in [
            poses(between(0, 300), 5.0, 0.0),
            poses(every(299, 400), 0.1, 0.0),
            poses(every(0, 300), 0.0, 1.5),
        ] {
            assert!(contradiction_s(&first, &other).is_some());
        }
        let files = [
            (Path::new("a.tum"), first.clone()),
            (Path::new("b.tum"), poses(between(0, 300), 5.0, 0.0)),
        ];
        let error = check(&files).unwrap_err().to_string();
        assert!(
            error.contains("a.tum and b.tum have different poses"),
            "{error}"
        );
        assert!(check(&files[..1]).is_ok());
    }
}
