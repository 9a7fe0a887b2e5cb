//! The points of a topic as a scanner recording.

use super::bag::{Messages, Topic};
use super::messages::{LaserScan, PointCloud2};
use super::wire::Fault;
use crate::error::Result;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::profiles::reader::ProfileReader;
use crate::sensor::ScanPoint;

/// The message types with points.
pub(super) const TYPES: [&str; 2] = [PointCloud2::TYPE, LaserScan::TYPE];

/// The points of one topic in time order.
///
/// Neighbouring clouds may overlap in time: the points of a cloud are held back until the first time of
/// the next cloud is known.
pub(super) struct BagPoints {
    messages: Messages,
    /// Points held back, in time order after `returned`.
    waiting: Vec<ScanPoint>,
    /// Number of points at the start of `waiting` that have been returned.
    returned: usize,
    /// Number of points at the start of `waiting` that can be returned.
    due: usize,
    /// Time of the last point returned, seconds.
    last_time_s: f64,
    is_at_end: bool,
    is_empty: bool,
}

impl BagPoints {
    /// Opens a topic of one of the [`TYPES`].
    pub(super) fn open(input: &Input, topic: Topic) -> Result<Self> {
        Ok(Self {
            messages: Messages::open(input, topic)?,
            waiting: Vec::new(),
            returned: 0,
            due: 0,
            last_time_s: f64::NEG_INFINITY,
            is_at_end: false,
            is_empty: true,
        })
    }

    /// Reads the next cloud or scan and determines which points can be returned.
    fn next_cloud(&mut self) -> Result<()> {
        self.waiting.drain(..self.returned);
        self.returned = 0;
        if !self.messages.advance()? {
            self.is_at_end = true;
            self.due = self.waiting.len();
            return Ok(());
        }
        let most_bytes = self.messages.walk().largest_allocation();
        let most = usize::try_from(most_bytes).unwrap_or(usize::MAX) / size_of::<ScanPoint>();
        let most = most - self.waiting.len().min(most);
        let messages = &self.messages;
        let cloud = if messages.topic().message_type == LaserScan::TYPE {
            messages.read(|scan: LaserScan| scan.points(most))
        } else {
            messages.read(|cloud: PointCloud2<'_>| cloud.points(most))
        }?;
        let Some(first) = cloud.first() else {
            self.due = 0;
            return Ok(());
        };
        let first_s = first.time_s;
        if first_s < self.last_time_s {
            return Err(self.messages.error(Fault::new(
                format!("time {first_s} s after {} s", self.last_time_s),
                "clouds in time order",
            )));
        }
        self.due = self.waiting.partition_point(|p| p.time_s <= first_s);
        self.waiting.reserve_exact(cloud.len());
        self.waiting.extend(cloud);
        self.waiting[self.due..].sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(())
    }
}

impl ProfileReader for BagPoints {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        while into.len() < CHUNK_POINTS {
            if self.returned < self.due {
                let end = self.due.min(self.returned + CHUNK_POINTS - into.len());
                into.extend_from_slice(&self.waiting[self.returned..end]);
                self.returned = end;
            } else if self.is_at_end {
                break;
            } else {
                self.next_cloud()?;
            }
            self.last_time_s = into.last().map_or(self.last_time_s, |p| p.time_s);
        }
        self.is_empty &= into.is_empty();
        if self.is_empty {
            let what = format!("valid point in {}", self.messages.topic().name);
            return Err(nothing_in(self.messages.walk().path(), &what));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.messages.walk().bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.messages.walk().bytes_total()
    }
}

#[cfg(test)]
mod tests {
    use super::super::mcap::MAGIC;
    use super::super::open_points;
    use super::*;

    /// A record of MCAP.
    fn record(kind: u8, content: &[u8]) -> Vec<u8> {
        let length = (content.len() as u64).to_le_bytes();
        [&[kind], length.as_slice(), content].concat()
    }

    /// Bytes after their count.
    fn sized(bytes: &[u8]) -> Vec<u8> {
        [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
    }

    /// An MCAP file with clouds in the serialisation of ROS 1: stamp (s) and times since it (s).
    fn read(clouds: &[(u32, &[f32])]) -> Result<Vec<f64>> {
        let number = |n: u32| n.to_le_bytes();
        let schema = [&[1, 0], &*sized(PointCloud2::TYPE.as_bytes()), &[0; 8]].concat();
        let channel = [&[1, 0, 1, 0], &*sized(b"/a"), &sized(b"ros1"), &[0; 4]].concat();
        let mut file = [MAGIC, &record(3, &schema), &record(4, &channel)].concat();
        for (stamp_s, times_s) in clouds {
            let width = times_s.len() as u32;
            let mut message = [0, *stamp_s, 0, 0, 1, width, 4].map(number).concat();
            for (i, name) in ["x", "y", "z", "time"].iter().enumerate() {
                message.extend(sized(name.as_bytes()));
                message.extend(number(4 * i as u32));
                message.push(7);
                message.extend(number(1));
            }
            message.push(0);
            message.extend([16, 16 * width, 16 * width].map(number).concat());
            for time_s in *times_s {
                message.extend([1.0, 2.0, 3.0, *time_s].map(f32::to_le_bytes).concat());
            }
            file.extend(record(5, &[&[1, 0], &[0; 20][..], &message].concat()));
        }
        file.extend([&record(15, &[0; 4]), MAGIC].concat());
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mcap");
        std::fs::write(&path, file).unwrap();
        let mut reader = open_points(&Input::from(&path), None)?;
        let (mut times_s, mut chunk) = (Vec::new(), Vec::new());
        while reader.next_chunk(&mut chunk)? {
            times_s.extend(chunk.iter().map(|p| p.time_s));
        }
        Ok(times_s)
    }

    #[test]
    fn clouds_that_overlap_are_merged() {
        let found = read(&[
            (10, &[0.5, -0.5]),
            (11, &[-0.75, 0.0]),
            (12, &[]),
            (13, &[0.0]),
        ]);
        assert_eq!(found.unwrap(), [9.5, 10.25, 10.5, 11.0, 13.0]);
    }

    #[test]
    fn clouds_without_order_or_points_are_errors() {
        let text = |clouds| read(clouds).unwrap_err().to_string();
        let found = text(&[(10, &[0.0]), (12, &[0.0]), (11, &[0.0]), (9, &[0.0])]);
        assert!(
            found.contains("time 9 s after 10 s in message 4 of /a"),
            "{found}"
        );
        let found = text(&[(10, &[])]);
        assert!(found.contains("no valid point in /a"), "{found}");
        let found = text(&[(10, &[0.0, 99.0])]);
        assert!(
            found.contains("the field time (F32) with the value 99"),
            "{found}"
        );
    }
}
