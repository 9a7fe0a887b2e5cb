//! From hundreds of millions of laser points to the few that the adjustment needs.
//!
//! One point is kept for each voxel, scanner and pass. A pass ends where the scanner has not seen
//! the voxel for a while. Keeping every pass apart matters: their disagreement is what the
//! calibration looks for, and one point a voxel would hide it.

use crate::cloud::voxel::{VoxelKey, VoxelMap, squared_distance_to_centre, voxel_key};
use crate::error::Result;
use crate::format::ProfileReader;
use crate::geometry::{BodyFromScanner, Vec3, WorldFromBody};
use crate::georeference::{Georeferencer, Refused};
use crate::progress::Progress;
use crate::sensor::ScanPoint;
use crate::trajectory::Trajectory;

/// A laser point that takes part in the adjustment, with the pose at its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplePoint {
    /// Seconds.
    pub time_s: f64,
    /// Scanner frame, metres.
    pub position_m: Vec3,
    /// Pose of the body at `time_s`.
    pub world_from_body: WorldFromBody,
}

/// What reading a scanner's profiles gave.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScannerSample {
    /// Points in time order.
    pub points: Vec<SamplePoint>,
    /// Laser points read.
    pub read: u64,
    /// Laser points outside the trajectory's span, left out.
    pub outside: u64,
    /// Laser points without a pose that is known well enough, left out.
    pub refused: Refused,
}

/// Keeps, of the points it is shown in time order, the one nearest each voxel's centre a pass.
struct Thinner {
    voxel_m: f64,
    pass_gap_s: f64,
    latest: VoxelMap<VoxelKey, Latest>,
    kept: Vec<SamplePoint>,
}

struct Latest {
    kept: usize,
    seen_s: f64,
    offset_squared: f64,
}

impl Thinner {
    fn new(voxel_m: f64, pass_gap_s: f64) -> Self {
        Self {
            voxel_m,
            pass_gap_s,
            latest: VoxelMap::default(),
            kept: Vec::new(),
        }
    }

    fn show(&mut self, point: SamplePoint, world: &Vec3) {
        let key = voxel_key(world, self.voxel_m);
        let offset_squared = squared_distance_to_centre(world, self.voxel_m);
        let next = self.kept.len();
        let entry = self.latest.entry(key).or_insert(Latest {
            kept: next,
            seen_s: point.time_s,
            offset_squared: f64::INFINITY,
        });
        if point.time_s - entry.seen_s > self.pass_gap_s {
            *entry = Latest {
                kept: next,
                seen_s: point.time_s,
                offset_squared: f64::INFINITY,
            };
        }
        entry.seen_s = point.time_s;
        if entry.kept == next {
            self.kept.push(point);
            entry.offset_squared = offset_squared;
        } else if offset_squared < entry.offset_squared {
            self.kept[entry.kept] = point;
            entry.offset_squared = offset_squared;
        }
    }

    fn finish(mut self) -> Vec<SamplePoint> {
        self.kept.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        self.kept
    }
}

/// Reads a scanner's profiles once, in bounded memory, and thins them on a grid of `voxel_m`.
///
/// The voxels are those of the mounting `body_from_scanner` as known so far: within a pass a wrong
/// mounting shifts all points alike, so the density comes out right all the same. `offset_s` is
/// added to the sensor's times.
///
/// # Errors
/// What the reader finds; no point within the trajectory's span (with both spans).
#[allow(clippy::too_many_arguments)]
pub fn sample_profiles(
    name: &str,
    readers: Vec<Box<dyn ProfileReader>>,
    offset_s: f64,
    trajectory: &Trajectory,
    body_from_scanner: &BodyFromScanner,
    voxel_m: f64,
    pass_gap_s: f64,
    progress: &dyn Progress,
) -> Result<ScannerSample> {
    let mut thinner = Thinner::new(voxel_m, pass_gap_s);
    let mut georeferencer = Georeferencer::new(trajectory, *body_from_scanner, offset_s);
    let mut chunk: Vec<ScanPoint> = Vec::new();
    for mut reader in readers {
        let mut bytes = 0;
        while reader.next_chunk(&mut chunk)? {
            for point in &chunk {
                let (time_s, pose) = georeferencer.body_at(point);
                let Some(world_from_body) = pose else {
                    continue;
                };
                let position_m = point.position_m;
                let world = world_from_body.map(&body_from_scanner.map(&position_m));
                thinner.show(
                    SamplePoint {
                        time_s,
                        position_m,
                        world_from_body,
                    },
                    &world,
                );
            }
            progress.advance(reader.bytes_read() - bytes);
            progress.check()?;
            bytes = reader.bytes_read();
        }
    }
    georeferencer.check(name)?;
    Ok(ScannerSample {
        points: thinner.finish(),
        read: georeferencer.read(),
        outside: georeferencer.outside(),
        refused: georeferencer.refused().clone(),
    })
}

/// Thins a sample further, on a grid of `voxel_m`, with the mounting as now known.
pub fn thin_further(
    points: &[SamplePoint],
    body_from_scanner: &BodyFromScanner,
    voxel_m: f64,
    pass_gap_s: f64,
) -> Vec<SamplePoint> {
    let mut thinner = Thinner::new(voxel_m, pass_gap_s);
    for point in points {
        let body = body_from_scanner.map(&point.position_m);
        thinner.show(*point, &point.world_from_body.map(&body));
    }
    thinner.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_s: f64, x: f64) -> SamplePoint {
        SamplePoint {
            time_s,
            position_m: Vec3::new(x, 0.5, 0.5),
            world_from_body: WorldFromBody::identity(),
        }
    }

    #[test]
    fn each_pass_keeps_the_point_nearest_the_centre() {
        // Voxel [0, 1): seen at 0–0.3 s, again at 10 s; voxel [1, 2) once.
        let points = [
            at(0.0, 0.1),
            at(0.1, 0.45),
            at(0.2, 0.9),
            at(0.3, 1.2),
            at(10.0, 0.8),
        ];
        let kept = thin_further(&points, &BodyFromScanner::identity(), 1.0, 3.0);
        let found: Vec<_> = kept.iter().map(|p| (p.time_s, p.position_m.x)).collect();
        assert_eq!(found, [(0.1, 0.45), (0.3, 1.2), (10.0, 0.8)]);
    }

    #[test]
    fn a_standing_scanner_makes_one_pass_however_long_it_stands() {
        let points: Vec<_> = (0..100).map(|i| at(f64::from(i), 0.5)).collect();
        assert_eq!(
            thin_further(&points, &BodyFromScanner::identity(), 1.0, 3.0).len(),
            1
        );
    }
}
