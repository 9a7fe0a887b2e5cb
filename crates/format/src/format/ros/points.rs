//! The points of a topic as a scanner recording.

use std::collections::VecDeque;

use super::bag::{LeftOut, Messages, Topic};
use super::messages::{LaserScan, PointCloud2};
use super::stamps::{Stamps, WRONG_STEP_S};
use super::timed::{Lost, TimedPoints};
use super::wire::Fault;
use crate::error::{Error, Result};
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::profiles::reader::ProfileReader;
use crate::sensor::ScanPoint;

/// The message types with points.
pub(super) const TYPES: [&str; 2] = [PointCloud2::TYPE, LaserScan::TYPE];

/// Number of clouds that are known ahead of the one whose points are returned.
const AHEAD: usize = 3;
/// Scanners measure for a tenth of the interval between their clouds or longer, up to half as long again where they
/// overlap.
const USUAL_SHARES: std::ops::Range<f64> = 0.1..1.5;

/// A cloud or scan of the topic.
struct Cloud {
    stamp_s: f64,
    /// By how much its stamp is later than the time of recording, seconds.
    offset_s: f64,
    timed: TimedPoints,
    /// What is said of it if it is left out.
    error: Error,
}

/// The points of one topic in time order.
///
/// Neighbouring clouds may overlap in time and be out of order: the points of a cloud are held back until some of the
/// next clouds are known. Clouds with a wrong stamp, or before points that were returned, are left out.
pub(super) struct BagPoints {
    messages: Messages,
    /// Clouds that were read and not yet used.
    ahead: VecDeque<Cloud>,
    /// By how much the last stamp was later than the time of recording, seconds.
    offset_s: Option<f64>,
    /// The last stamp whose cloud had times that were taken for nanoseconds, and how long the cloud lasted, seconds.
    lasted_s: Option<(f64, f64)>,
    /// Whether the unit of the times of points was checked.
    is_unit_checked: bool,
    left_out: LeftOut,
    /// Stamps of clouds that were used.
    stamps: Stamps,
    /// Points that were not measured or have no time.
    lost: Lost,
    /// Clouds that were used.
    used: u64,
    /// Points held back, in time order after `returned`.
    waiting: Vec<ScanPoint>,
    /// Number of points at the start of `waiting` that have been returned.
    returned: usize,
    /// Number of points at the start of `waiting` that can be returned.
    due: usize,
    /// Time of the last point returned, seconds.
    last_time_s: f64,
    has_read_all: bool,
    is_at_end: bool,
    is_empty: bool,
}

impl BagPoints {
    /// Opens a topic of one of the [`TYPES`].
    pub(super) fn open(input: &Input, topic: Topic) -> Result<Self> {
        Ok(Self {
            messages: Messages::open(input, topic)?,
            ahead: VecDeque::new(),
            offset_s: None,
            lasted_s: None,
            is_unit_checked: input.point_times().unit_s.is_some(),
            left_out: LeftOut::default(),
            stamps: Stamps::default(),
            lost: Lost::default(),
            used: 0,
            waiting: Vec::new(),
            returned: 0,
            due: 0,
            last_time_s: f64::NEG_INFINITY,
            has_read_all: false,
            is_at_end: false,
            is_empty: true,
        })
    }

    /// Reads clouds until enough of them are known ahead.
    fn look_ahead(&mut self) -> Result<()> {
        while self.ahead.len() <= AHEAD && !self.has_read_all {
            if !self.messages.advance()? {
                self.has_read_all = true;
                break;
            }
            let held = self.waiting.len() + self.ahead.iter().map(Cloud::len).sum::<usize>();
            let most_bytes = self.messages.walk().largest_allocation();
            let most = usize::try_from(most_bytes).unwrap_or(usize::MAX) / size_of::<ScanPoint>();
            let most = most.saturating_sub(held);
            let messages = &self.messages;
            let how = messages.walk().input().point_times();
            let cloud = if messages.topic().message_type == LaserScan::TYPE {
                messages
                    .read(|scan: LaserScan| Ok((scan.time_s, TimedPoints::of(scan.points(most)?))))
            } else {
                messages.read(|cloud: PointCloud2<'_>| Ok((cloud.time_s, cloud.points(most, how)?)))
            };
            match cloud {
                Ok((stamp_s, timed)) => {
                    self.check_unit(stamp_s, &timed)?;
                    self.remark(&timed);
                    let fault = Fault::new(
                        format!(
                            "the stamp {stamp_s} s, out of order or at the place of another cloud"
                        ),
                        "clouds in time order",
                    );
                    self.ahead.push_back(Cloud {
                        stamp_s,
                        offset_s: stamp_s - self.messages.recorded_s(),
                        timed,
                        error: self.messages.error(fault),
                    });
                }
                Err(fault) if fault.is_asked => return Err(self.messages.error(fault)),
                Err(fault) => self.left_out.add(self.messages.error(fault)),
            }
        }
        Ok(())
    }

    /// Remarks on what the times of a cloud leave open.
    fn remark(&mut self, timed: &TimedPoints) {
        self.lost += timed.lost;
        let topic = &self.messages.topic().name;
        let input = self.messages.walk().input();
        if timed.are_alike {
            input.remark(format!(
                "the points of {topic} have no times of their own, or the same time: all points of a cloud have one time"
            ));
        }
        if timed.wrapped > 0 {
            input.remark(format!(
                "{topic} has times of points that lie before the stamp of their cloud, written as large numbers: they \
                 are taken for negative ones"
            ));
        }
    }

    /// Compares how long clouds last, if the unit of their times is taken for nanoseconds, with the time between them.
    fn check_unit(&mut self, stamp_s: f64, timed: &TimedPoints) -> Result<()> {
        if self.is_unit_checked {
            return Ok(());
        }
        let Some(lasts_s) = timed.lasts_s.filter(|lasts_s| *lasts_s > 0.0) else {
            return Ok(());
        };
        let Some((before_s, lasted_s)) = self.lasted_s.replace((stamp_s, lasts_s)) else {
            return Ok(());
        };
        let between_s = stamp_s - before_s;
        self.is_unit_checked = true;
        let longer = [(1e3, "microseconds", "us"), (1e6, "milliseconds", "ms")];
        let fits = |(factor, ..): &(f64, &str, &str)| {
            USUAL_SHARES.contains(&(factor * lasted_s.min(lasts_s) / between_s))
        };
        let Some((_, unit, key)) = longer.into_iter().find(fits) else {
            return Ok(());
        };
        let found = format!(
            "times of points that last {lasts_s:.9} s in clouds {between_s:.3} s apart, taken for nanoseconds"
        );
        let expected = format!(
            "the unit of the times of points, as they may be {unit}: `point_time_unit` of the scanner in the project, \
             \"{key}\" or \"ns\""
        );
        Err(self.messages.error(Fault::asked(found, expected)))
    }

    /// Whether the stamp of the next cloud fits the one before, or that after it.
    fn is_stamp_right(&self, offset_s: f64) -> bool {
        let fits = |other_s: f64| (other_s - offset_s).abs() < WRONG_STEP_S;
        let mut others = self.ahead.iter().map(|cloud| cloud.offset_s);
        match self.offset_s {
            Some(before_s) if fits(before_s) => true,
            Some(_) => others.next().is_some_and(fits),
            None => self.ahead.is_empty() || others.any(fits),
        }
    }

    /// Takes the next cloud and determines which points can be returned.
    fn next_cloud(&mut self) -> Result<()> {
        self.waiting.drain(..self.returned);
        self.returned = 0;
        self.look_ahead()?;
        let Some(cloud) = self.ahead.pop_front() else {
            self.is_at_end = true;
            self.due = self.waiting.len();
            self.lost
                .remark(self.messages.walk().input(), &self.messages.topic().name);
            return self.left_out.finish(&self.messages, self.used);
        };
        let first_s = cloud.timed.points.first().map(|point| point.time_s);
        let is_in_order = first_s.is_none_or(|first_s| first_s >= self.last_time_s);
        let ahead_s: Vec<f64> = self.ahead.iter().map(|cloud| cloud.stamp_s).collect();
        let is_placed = !self.stamps.is_wrong(cloud.stamp_s, &ahead_s);
        if is_in_order && is_placed && self.is_stamp_right(cloud.offset_s) {
            self.stamps.push(cloud.stamp_s);
            self.offset_s = Some(cloud.offset_s);
            self.used += 1;
            self.waiting.extend(cloud.timed.points);
            self.waiting.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        } else {
            self.left_out.add(cloud.error);
        }
        let next = self
            .ahead
            .iter()
            .filter_map(|cloud| cloud.timed.points.first());
        let next_s = next.map(|point| point.time_s).reduce(f64::min);
        self.due = match next_s {
            Some(next_s) => self.waiting.partition_point(|p| p.time_s <= next_s),
            None if self.has_read_all => self.waiting.len(),
            None => 0,
        };
        Ok(())
    }
}

impl Cloud {
    fn len(&self) -> usize {
        self.timed.points.len()
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
            let damage = self.messages.take_damage();
            return Err(damage.unwrap_or_else(|| nothing_in(self.messages.walk().path(), &what)));
        }
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.messages.bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.messages.bytes_total()
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
        let found = read(&[(10, &[0.0]), (12, &[0.0]), (11, &[0.0]), (9, &[0.0])]);
        assert_eq!(found.unwrap(), [9.0, 10.0, 11.0, 12.0]);
        // One that comes later than that is left out.
        let late: Vec<(u32, &[f32])> = [20, 21, 22, 23, 24, 25, 26, 5, 27]
            .map(|stamp_s| (stamp_s, &[0.0][..]))
            .into();
        let found = read(&late).unwrap();
        let expected = [20.0, 21.0, 22.0, 23.0, 24.0, 25.0, 26.0, 27.0];
        assert_eq!(found, expected);
        let found = text(&[(10, &[])]);
        assert!(found.contains("no valid point in /a"), "{found}");
        let found = text(&[(10, &[0.0, 99.0])]);
        assert!(
            found.contains("the field time (F32) with the value 99"),
            "{found}"
        );
    }
}
