//! LAS and LAZ as recordings of a scanner: points in its frame with times, or points in the world
//! with the sensor's pose beside each.

use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::las::{LasFile, LasPoint, PoseColumns, point_error};
use super::profile::ProfileReader;
use super::{CHUNK_POINTS, nothing_in};
use crate::error::{Error, Location, Result};
use crate::geometry::{Pose, Rotation, Vec3, pose};
use crate::sensor::{PoseRecord, ScanPoint};

/// Points in the scanner frame, in the order of the file; decoded on a thread of their own, one
/// chunk ahead.
pub(crate) struct LasScan {
    chunks: Receiver<Result<Vec<ScanPoint>>>,
    points: u64,
    points_read: u64,
    bytes: u64,
}

impl LasScan {
    pub(crate) fn new(file: &LasFile) -> Result<Self> {
        let path = file.path().to_owned();
        if !file.has_time() {
            return Err(Error::format(
                path,
                Location::Whole,
                "points without time",
                "a point format with GPS time (1, 3 to 10)",
            ));
        }
        let points = file.header().number_of_points();
        if points == 0 {
            return Err(nothing_in(&path, "point"));
        }
        let bytes = file.bytes_total();
        let (sender, chunks) = sync_channel(1);
        std::thread::spawn(move || decode(&path, &sender));
        Ok(Self {
            chunks,
            points,
            points_read: 0,
            bytes,
        })
    }
}

/// Sends the chunks of a file until it ends, fails, or nobody wants more.
fn decode(path: &Path, sender: &SyncSender<Result<Vec<ScanPoint>>>) {
    let mut last = f64::NEG_INFINITY;
    let mut next = |file: &mut LasFile| {
        let mut chunk = Vec::new();
        file.read(CHUNK_POINTS, |index, point| {
            if point.time_s < last {
                let found = format!("time {} s after {last} s", point.time_s);
                return Err(point_error(path, index, &found, "points in time order"));
            }
            last = point.time_s;
            chunk.push(ScanPoint {
                time_s: point.time_s,
                position_m: point.position,
                intensity: point.intensity,
            });
            Ok(())
        })?;
        Ok(chunk)
    };
    let mut file = match LasFile::open(path) {
        Ok(file) => file,
        Err(e) => {
            let _ = sender.send(Err(e));
            return;
        }
    };
    loop {
        let chunk = next(&mut file);
        let is_last = chunk.as_ref().map_or(true, Vec::is_empty);
        if sender.send(chunk).is_err() || is_last {
            return;
        }
    }
}

impl ProfileReader for LasScan {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        // The thread hangs up after the last chunk.
        if let Ok(chunk) = self.chunks.recv() {
            *into = chunk?;
        }
        self.points_read += into.len() as u64;
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        (self.points_read as f64 / self.points as f64 * self.bytes as f64) as u64
    }

    fn bytes_total(&self) -> u64 {
        self.bytes
    }
}

/// Reads every point with its pose world_from_sensor, R = Rz(yaw) Ry(pitch) Rx(roll).
fn read_posed(file: &mut LasFile, mut take: impl FnMut(&LasPoint<'_>, Pose)) -> Result<()> {
    let path = file.path().to_owned();
    let Some(columns) = PoseColumns::of(file) else {
        return Err(Error::format(
            &path,
            Location::Whole,
            "no pose of the sensor beside the points",
            "times and the extra dimensions SensorX, SensorY, SensorZ (m), SensorRollRads, \
             SensorPitchRads, SensorYawRads",
        ));
    };
    while file.read(CHUNK_POINTS, |index, point| {
        let values = columns.values(&point);
        if !values.iter().all(|v| v.is_finite()) {
            let found = "a pose that is not finite";
            return Err(point_error(&path, index, found, "finite numbers"));
        }
        let [x, y, z, roll, pitch, yaw] = values;
        let rotation = Rotation::from_euler_angles(roll, pitch, yaw);
        take(&point, pose(rotation, Vec3::new(x, y, z)));
        Ok(())
    })? > 0
    {}
    if file.taken() == 0 {
        return Err(nothing_in(&path, "point"));
    }
    Ok(())
}

/// Points taken back into the frame of the sensor and sorted by time. They are held in memory:
/// such files come ordered by place, not by time.
pub(crate) struct PosedScan {
    points: Vec<ScanPoint>,
    given: usize,
    bytes: u64,
}

impl PosedScan {
    pub(crate) fn read(mut file: LasFile) -> Result<Self> {
        let mut points = Vec::new();
        read_posed(&mut file, |point, world_from_sensor| {
            points.push(ScanPoint {
                time_s: point.time_s,
                position_m: world_from_sensor
                    .inverse_transform_point(&point.position.into())
                    .coords,
                intensity: point.intensity,
            });
        })?;
        // Stable: points of the same time keep the order of the file.
        points.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(Self {
            points,
            given: 0,
            bytes: file.bytes_total(),
        })
    }
}

impl ProfileReader for PosedScan {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        let end = (self.given + CHUNK_POINTS).min(self.points.len());
        into.extend_from_slice(&self.points[self.given..end]);
        self.given = end;
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        let share = self.given as f64 / self.points.len().max(1) as f64;
        (share * self.bytes as f64) as u64
    }

    fn bytes_total(&self) -> u64 {
        self.bytes
    }
}

/// The poses world_from_sensor at the distinct times of a file, in time order; of several points
/// of one time the first counts.
pub(crate) fn read_poses(path: &Path) -> Result<Vec<PoseRecord>> {
    let mut poses = Vec::new();
    read_posed(&mut LasFile::open(path)?, |point, world_from_body| {
        poses.push(PoseRecord {
            time_s: point.time_s,
            world_from_body,
            velocity_m_s: None,
            bias: None,
            sigma: None,
        });
    })?;
    poses.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    poses.dedup_by_key(|p| p.time_s);
    Ok(poses)
}
