//! LAS and LAZ as scanner recordings: points in the scanner frame with times, or points in the
//! world with the sensor's pose for each.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use crate::error::{Error, Location, Result};
use crate::format::cloud::gathering::counted;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::las::columns::PoseColumns;
use crate::format::las::file::{LasFile, point_error};
use crate::format::profiles::reader::ProfileReader;
use crate::geometry::{Rotation, Vec3, WorldFromBody, is_finite};
use crate::sensor::{Continued, PoseRecord, ScanPoint};

/// Points in the scanner frame, in the order of the file; decoded on a separate thread, one chunk
/// ahead.
pub(crate) struct LasScan {
    path: PathBuf,
    chunks: Receiver<Result<Vec<ScanPoint>>>,
    points: u64,
    points_read: u64,
    bytes: u64,
    has_ended: bool,
}

impl LasScan {
    pub(crate) fn new(file: &LasFile) -> Result<Self> {
        let input = file.input().clone();
        if !file.has_time() {
            return Err(Error::format(
                input.path(),
                Location::Whole,
                "points without time",
                "a point format with GPS time (1, 3 to 10)",
            ));
        }
        let points = file.header().number_of_points();
        if points == 0 {
            return Err(nothing_in(input.path(), "point"));
        }
        let bytes = file.bytes_total();
        let (sender, chunks) = sync_channel(1);
        let path = input.path().to_owned();
        std::thread::spawn(move || decode(&input, &sender));
        Ok(Self {
            path,
            chunks,
            points,
            points_read: 0,
            bytes,
            has_ended: false,
        })
    }
}

/// Sends the chunks of a file until it ends, fails, or the receiver is dropped.
fn decode(input: &Input, sender: &SyncSender<Result<Vec<ScanPoint>>>) {
    let mut times = Continued::default();
    let mut untimed = 0;
    let mut next = |file: &mut LasFile| {
        let mut chunk = Vec::new();
        let count = file.read(CHUNK_POINTS, |index, point| {
            if point.time_s.is_nan() {
                untimed += 1;
                return Ok(());
            }
            let in_order = times.in_order(point.time_s);
            let time_s = in_order.map_err(|found| {
                point_error(input.path(), index, &found, "points in time order")
            })?;
            chunk.push(ScanPoint {
                time_s,
                position_m: point.position,
                intensity: point.intensity,
            });
            Ok(())
        })?;
        if count == 0 && untimed > 0 {
            input.remark(format!(
                "{} without a time left out",
                counted(untimed, "point")
            ));
        }
        Ok((count, chunk))
    };
    let mut file = match LasFile::reopen(input) {
        Ok(file) => file,
        Err(e) => {
            let _ = sender.send(Err(e));
            return;
        }
    };
    loop {
        let chunk = next(&mut file);
        let is_last = chunk.as_ref().map_or(true, |(count, _)| *count == 0);
        let points = chunk.map(|(_, points)| points);
        // A chunk without points would end the recording.
        let is_sent = is_last || points.as_ref().is_ok_and(|points| !points.is_empty());
        if is_sent && sender.send(points).is_err() || is_last {
            return;
        }
    }
}

impl ProfileReader for LasScan {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        if self.has_ended {
            return Ok(false);
        }
        // The last chunk is empty. A channel that is closed before it is no end of the file.
        *into = self.chunks.recv().map_err(|_| {
            Error::format(
                &self.path,
                Location::Whole,
                format!(
                    "content that cannot be decoded after {} points",
                    self.points_read
                ),
                "an undamaged LAS or LAZ file",
            )
        })??;
        self.points_read += into.len() as u64;
        self.has_ended = into.is_empty();
        Ok(!self.has_ended)
    }

    fn bytes_read(&self) -> u64 {
        (self.points_read as f64 / self.points as f64 * self.bytes as f64) as u64
    }

    fn bytes_total(&self) -> u64 {
        self.bytes
    }
}

/// A point in the world with the pose of the sensor that measured it.
struct PosedPoint {
    time_s: f64,
    /// Position (m), then roll, pitch, yaw (rad).
    pose: [f64; 6],
    world: Vec3,
    intensity: f32,
}

impl PosedPoint {
    fn position(&self) -> Vec3 {
        Vec3::from_column_slice(&self.pose[..3])
    }

    /// R = Rz(yaw) Ry(pitch) Rx(roll).
    fn world_from_body(&self) -> WorldFromBody {
        let [_, _, _, roll, pitch, yaw] = self.pose;
        WorldFromBody::new(
            Rotation::from_euler_angles(roll, pitch, yaw),
            self.position(),
        )
    }
}

/// Reads every point with its pose and sorts them by time, in memory, because such files are
/// ordered by position.
fn read_posed(file: &mut LasFile) -> Result<Vec<PosedPoint>> {
    let input = file.input().clone();
    let Some(columns) = PoseColumns::of(file) else {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            "points without the sensor's pose",
            "times and the extra dimensions SensorX, SensorY, SensorZ (m), SensorRollRads, \
             SensorPitchRads, SensorYawRads",
        ));
    };
    let mut points = Vec::new();
    let mut untimed = 0;
    while file.read(CHUNK_POINTS, |index, point| {
        if point.time_s.is_nan() {
            untimed += 1;
            return Ok(());
        }
        let pose = columns.values(&point);
        if !pose.iter().all(|v| v.is_finite()) {
            let found = "a pose that is not finite";
            return Err(point_error(input.path(), index, found, "finite numbers"));
        }
        points.push(PosedPoint {
            time_s: point.time_s,
            pose,
            world: point.position,
            intensity: point.intensity,
        });
        Ok(())
    })? > 0
    {}
    if untimed > 0 {
        input.remark(format!(
            "{} without a time left out",
            counted(untimed, "point")
        ));
    }
    if points.is_empty() {
        return Err(nothing_in(input.path(), "point"));
    }
    // Stable: points of the same time keep the order of the file.
    points.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    spread_times(&mut points);
    Ok(points)
}

/// If a file's times are coarser than its poses, for example rounded to seconds, gives every pose a
/// separate time: poses of one time are ordered along the track and spread evenly over the file's
/// smallest time step. If each time has one pose, nothing changes.
fn spread_times(points: &mut [PosedPoint]) {
    let groups: Vec<(usize, usize)> = {
        let mut start = 0;
        points
            .chunk_by(|a, b| a.time_s == b.time_s)
            .map(|group| {
                let range = (start, start + group.len());
                start = range.1;
                range
            })
            .collect()
    };
    let times: Vec<f64> = groups.iter().map(|g| points[g.0].time_s).collect();
    let centres: Vec<Vec3> = groups
        .iter()
        .map(|g| {
            points[g.0..g.1]
                .iter()
                .map(PosedPoint::position)
                .sum::<Vec3>()
        })
        .zip(&groups)
        .map(|(sum, g)| sum / (g.1 - g.0) as f64)
        .collect();
    let step = times.windows(2).map(|w| w[1] - w[0]).fold(1.0, f64::min);
    for (i, &(start, end)) in groups.iter().enumerate() {
        // The neighbour nearer in time: the other may belong to another pass.
        let after = times.get(i + 1).map_or(f64::INFINITY, |t| t - times[i]);
        let before = if i > 0 {
            times[i] - times[i - 1]
        } else {
            f64::INFINITY
        };
        let ahead = if after.is_finite() && after <= before {
            centres[i + 1] - centres[i]
        } else if before.is_finite() {
            centres[i] - centres[i - 1]
        } else {
            Vec3::x()
        };
        let group = &mut points[start..end];
        let place = |p: &PosedPoint| p.position().dot(&ahead);
        group.sort_by(|a, b| {
            let along = place(a).total_cmp(&place(b));
            (0..6).fold(along, |order, k| {
                order.then_with(|| a.pose[k].total_cmp(&b.pose[k]))
            })
        });
        let count = group.chunk_by(|a, b| a.pose == b.pose).count() as f64;
        for (k, same) in group.chunk_by_mut(|a, b| a.pose == b.pose).enumerate() {
            for point in same {
                point.time_s += step * k as f64 / count;
            }
        }
    }
}

/// Points transformed back into the sensor frame, in time order.
pub(crate) struct PosedScan {
    points: Vec<ScanPoint>,
    given: usize,
    bytes: u64,
}

impl PosedScan {
    pub(crate) fn read(mut file: LasFile) -> Result<Self> {
        let posed = read_posed(&mut file)?;
        let to_scanner = |point: &PosedPoint| {
            let position_m = point.world_from_body().map_back(&point.world);
            if !is_finite(&position_m) {
                return Err(Error::format(
                    file.path(),
                    Location::Whole,
                    format!(
                        "a point whose coordinates overflow in the frame of its sensor, at {} s",
                        point.time_s
                    ),
                    "finite coordinates",
                ));
            }
            Ok(ScanPoint {
                time_s: point.time_s,
                position_m,
                intensity: point.intensity,
            })
        };
        let points = posed.iter().map(to_scanner).collect::<Result<_>>()?;
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

/// The distinct poses world_from_body of a file, in time order.
pub(crate) fn read_poses(input: &Input) -> Result<Vec<PoseRecord>> {
    let mut points = read_posed(&mut LasFile::open(input)?)?;
    points.dedup_by_key(|p| p.time_s);
    Ok(points
        .iter()
        .map(|point| PoseRecord {
            time_s: point.time_s,
            world_from_body: point.world_from_body(),
            velocity_m_s: None,
            bias: None,
            sigma: None,
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decoder_that_breaks_off_is_not_the_end_of_the_file() {
        let scan = |chunks: Vec<Vec<ScanPoint>>| {
            let (sender, receiver) = sync_channel(2);
            for chunk in chunks {
                sender.send(Ok(chunk)).unwrap();
            }
            LasScan {
                path: "a.laz".into(),
                chunks: receiver,
                points: 1,
                points_read: 0,
                bytes: 1,
                has_ended: false,
            }
        };
        let point = ScanPoint {
            time_s: 1.0,
            position_m: Vec3::zeros(),
            intensity: 0.0,
        };
        let mut points = Vec::new();
        let mut whole = scan(vec![vec![point], Vec::new()]);
        assert!(whole.next_chunk(&mut points).unwrap());
        assert!(!whole.next_chunk(&mut points).unwrap());
        assert!(!whole.next_chunk(&mut points).unwrap());
        let mut broken = scan(vec![vec![point]]);
        assert!(broken.next_chunk(&mut points).unwrap());
        let error = broken.next_chunk(&mut points).unwrap_err().to_string();
        assert!(
            error.contains("a.laz") && error.contains("after 1 points"),
            "{error}"
        );
    }
}
