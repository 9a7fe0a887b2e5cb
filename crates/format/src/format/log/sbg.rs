//! Binary logs of SBG Systems' Ellipse, Ekinox and other devices in the protocol sbgECom. IMU samples,
//! GNSS headings and positions, and UTC are read; all other messages are counted. Layouts, scales and
//! states are those of the manufacturer's description of sbgECom 5.2. Messages of older versions lack
//! fields at their ends, but none that is needed here.
//!
//! The axes of the IMU are those of the device, x forward, y right, z down, unless the device was
//! configured to turn its measurements to the axes of the vehicle. At rest and level it measures
//! −9.8 m/s² along z.

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind;
use crate::sensor::{GeographicFix, HeadingFix, ImuSample};
pub use arriving::Arriving;
use clock::{DeviceClock, Utc};
use fields::is_read;
use frames::{Frames, Start, start_of};
use message::*;

mod arriving;
pub(crate) mod clock;
#[cfg(test)]
mod damage_tests;
mod fields;
mod frames;
mod message;
mod names;
#[cfg(test)]
mod tests;

pub(crate) const LOG: kind::Kind = kind::Kind {
    signature: Some(|start| looks_like(start.bytes)),
    imu: Some(read_imu),
    heading: Some(read_heading),
    geographic: Some(read_positions),
    record_ends: Some(record_ends),
    contents: Some(|path| Ok(summary(path)?.describe())),
    frame: kind::Frame::Fixed(
        "radians or degrees, and m/s² (the format); axes of the device, x forward, y right, z down unless set otherwise; latitude, longitude, height; heading clockwise from north",
    ),
    ..kind::Kind::new("sbg", "log of IMU and GNSS (SBG sbgECom)")
};

/// The number of messages of one kind in a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct KindCount {
    /// The manufacturer's name without `SBG_ECOM_LOG_`, or the numbers of class and message.
    pub(crate) name: String,
    /// Complete frames.
    pub(crate) frames: u64,
    /// Frames with a valid measurement according to status and values; all frames if the kind is
    /// only counted.
    pub(crate) usable: u64,
}

/// The content of a log.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Counts {
    /// Complete frames.
    pub(crate) frames: u64,
    /// Frames of each kind, ordered by class and message.
    pub(crate) by_kind: Vec<KindCount>,
    /// Bytes outside complete frames: damaged, cut off, or of another protocol on the same line (NMEA).
    pub(crate) damaged_bytes: u64,
    /// Unbroken runs of such bytes.
    pub(crate) damaged_places: u64,
    /// Earliest and latest time, seconds as in [`read_imu`]; `None` if no message has a time.
    pub(crate) span_s: Option<(f64, f64)>,
    /// Whether times are UTC, seconds of the Unix epoch; otherwise they are of the clock of the device.
    pub(crate) is_utc: bool,
}

/// Whether these first bytes of a file contain a complete frame with the right CRC.
pub(crate) fn looks_like(start: &[u8]) -> bool {
    (0..start.len()).any(|i| matches!(start_of(&start[i..]), Start::Frame(_)))
}

/// Reads the samples of the IMU in the order of the log. IMU_SHORT is used, which has the rate of the
/// IMU; if the log has none, IMU_DATA, which the manufacturer advises against (it is extrapolated to
/// another rate). FAST_IMU_DATA of old firmware is not read, because its steps of 0.01 m/s² and 1 mrad/s
/// are too coarse. Samples are left out if the device had lost contact to its IMU; saturated samples
/// are kept.
///
/// Both messages give rates and accelerations, in rad/s and m/s², although the manufacturer's library
/// calls them delta angles and delta velocities: they are used as they are, not divided by an interval.
/// A device whose output is slower than its IMU averages the samples of the interval. IMU_DATA has two
/// sets, which are equal according to the manufacturer; the second is used, as in the manufacturer's own
/// exports.
///
/// Times are UTC in seconds of the Unix epoch if the log has UTC_TIME messages with valid UTC, else
/// seconds of the clock of the device. Each UTC_TIME message gives a time on both clocks. Only messages
/// of the best state in the log are used (leap seconds known, aligned to the pulse per second), and the
/// difference of the clocks is interpolated between them, so that times do not step once a second. The
/// clock of the device counts microseconds in 32 bits since it was switched on; roll-overs are undone.
/// The manufacturer does not document where in its interval a sample is stamped: times may be off by up
/// to one interval.
///
/// # Errors
/// No frame, no usable sample; a clock that goes back (the device was restarted), UTC that steps.
pub(crate) fn read_imu(input: &Input) -> Result<Vec<ImuSample>> {
    let expected = "IMU_SHORT or IMU_DATA with contact to the IMU";
    read(input, [IMU_SHORT, IMU_DATA], expected, |time_s, content| {
        let Content::Imu {
            gyro_rad_s,
            accel_m_s2,
        } = content
        else {
            return None;
        };
        Some(ImuSample {
            time_s,
            gyro_rad_s,
            accel_m_s2,
        })
    })
}

/// Reads the true headings of the baseline from the main to the auxiliary antenna: those of the first
/// receiver (GPS1_HDT) or, if it has none, of the second. Times are as in [`read_imu`].
///
/// Messages without a computed solution, or with a standard deviation outside 0 to 180 degrees, are
/// left out, as in the manufacturer's library. The pitch is absent unless its standard deviation is
/// within 0 to 90 degrees. The manufacturer calls it "from the master to the rover" and does not give
/// its sign; it is read as the elevation of the auxiliary antenna above the main antenna.
///
/// # Errors
/// Those of [`read_imu`].
pub(crate) fn read_heading(input: &Input) -> Result<Vec<HeadingFix>> {
    let expected = "GPS1_HDT or GPS2_HDT with a solution";
    read(
        input,
        [GPS1_HDT, GPS2_HDT],
        expected,
        |time_s, content| match content {
            Content::Heading(fix) => Some(HeadingFix { time_s, ..fix }),
            _ => None,
        },
    )
}

/// Reads the positions of the main antenna: those of the first receiver (GPS1_POS) or, if it has none,
/// of the second. Times are as in [`read_imu`]. Messages without a computed solution, or with a standard
/// deviation of 9999 m, which stands for an unknown one, are left out.
///
/// # Errors
/// Those of [`read_imu`].
pub(crate) fn read_positions(input: &Input) -> Result<Vec<GeographicFix>> {
    let expected = "GPS1_POS or GPS2_POS with a solution";
    read(
        input,
        [GPS1_POS, GPS2_POS],
        expected,
        |time_s, content| match content {
            Content::Position(fix) => Some(GeographicFix { time_s, ..fix }),
            _ => None,
        },
    )
}

/// The end of each IMU sample, in bytes from the start of the file, and its time as in [`read_imu`].
fn record_ends(input: &Input) -> Result<Vec<(u64, f64)>> {
    let overview = Overview::of(input)?;
    let mut ends = Vec::new();
    let mut messages = Messages::open(input)?;
    while let Some(message) = messages.next()? {
        if let Some((device_us, Content::Imu { .. })) = message.content {
            ends.push((message.end, overview.utc.time_s(device_us)));
        }
    }
    Ok(ends)
}

/// Counts the messages of a log; a restart of the device is not an error here.
///
/// # Errors
/// No frame.
pub(crate) fn summary(input: &Input) -> Result<Counts> {
    Ok(Overview::of(input)?.counts)
}

/// Reads the usable messages of the first of `kinds` that has usable messages.
fn read<T>(
    input: &Input,
    kinds: [Kind; 2],
    expected: &str,
    record: impl Fn(f64, Content) -> Option<T>,
) -> Result<Vec<T>> {
    let overview = Overview::of(input)?;
    let usable = |kind: &Kind| overview.by_kind.get(kind).is_some_and(|count| count[1] > 0);
    let Some(kind) = kinds.into_iter().find(usable) else {
        let found = overview.counts.describe();
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    };
    overview.check(input.path())?;
    let mut records = Vec::new();
    let mut messages = Messages::open(input)?;
    while let Some(message) = messages.next()? {
        if let (true, Some((device_us, content))) = (message.kind == kind, message.content) {
            records.extend(record(overview.utc.time_s(device_us), content));
        }
    }
    Ok(records)
}

impl Counts {
    /// The content of the log in one line.
    fn describe(&self) -> String {
        let kind = |count: &KindCount| match count.frames - count.usable {
            0 => format!("{} {}", count.frames, count.name),
            bad => format!("{} {} ({bad} unusable)", count.frames, count.name),
        };
        let mut text = self.by_kind.iter().map(kind).collect::<Vec<_>>().join(", ");
        if self.damaged_bytes > 0 {
            let (bytes, places) = (self.damaged_bytes, self.damaged_places);
            text += &format!(", {bytes} damaged bytes in {places} places");
        }
        text
    }
}

/// The result of a first pass over a log.
#[derive(Debug, Default)]
struct Overview {
    counts: Counts,
    /// Number of frames, and number of usable frames.
    by_kind: BTreeMap<Kind, [u64; 2]>,
    utc: Utc,
    /// Byte offset at which the clock of the device goes back, and by how many seconds.
    restart: Option<(u64, f64)>,
}

impl Overview {
    fn of(input: &Input) -> Result<Self> {
        // GNSS messages are late by less than this.
        const BACK_US: i64 = 10_000_000;
        let mut overview = Self::default();
        let mut span_us: Option<(i64, i64)> = None;
        let mut messages = Messages::open(input)?;
        loop {
            let last_us = messages.clock.last_us();
            let Some(message) = messages.next()? else {
                break;
            };
            overview.counts.frames += 1;
            let count = overview.by_kind.entry(message.kind).or_default();
            count[0] += 1;
            count[1] += u64::from(message.content.is_some() || !is_read(message.kind));
            let Some((device_us, content)) = message.content else {
                continue;
            };
            let (first, last) = span_us.unwrap_or((device_us, device_us));
            span_us = Some((first.min(device_us), last.max(device_us)));
            if let Some(back_us) = last_us
                .map(|last| last - device_us)
                .filter(|b| *b > BACK_US)
            {
                let restart = (message.at, clock::seconds(1000 * back_us));
                overview.restart.get_or_insert(restart);
            }
            if let Content::Utc { unix_ns, trust } = content {
                overview.utc.add(message.at, device_us, unix_ns, trust);
            }
        }
        if overview.counts.frames == 0 {
            return Err(nothing_in(input.path(), "complete sbgECom frame"));
        }
        let counts = &mut overview.counts;
        counts.damaged_bytes = messages.frames.other_bytes;
        counts.damaged_places = messages.frames.other_runs;
        counts.is_utc = overview.utc.is_known();
        counts.span_s = span_us.map(|(a, b)| (overview.utc.time_s(a), overview.utc.time_s(b)));
        let named = overview.by_kind.iter().map(|(kind, count)| KindCount {
            name: names::name(*kind),
            frames: count[0],
            usable: count[1],
        });
        counts.by_kind = named.collect();
        Ok(overview)
    }

    /// Checks that the times of the log are on one clock.
    fn check(&self, path: &Path) -> Result<()> {
        let Some((at, back_s)) = self.restart else {
            return self.utc.check(path);
        };
        Err(Error::format(
            path,
            Location::Byte(at),
            format!("a clock of the device that goes back by {back_s:.3} s"),
            "a log without a restart of the device: split it there",
        ))
    }
}

/// A message with its content and its time on the clock of the device, microseconds, if it has both.
struct Message {
    /// Start of the message in the file, bytes.
    at: u64,
    /// End of the message in the file, bytes.
    end: u64,
    kind: Kind,
    content: Option<(i64, Content)>,
}

/// The messages of a log one after the other.
#[derive(Debug)]
struct Messages {
    frames: Frames,
    clock: DeviceClock,
}

impl Messages {
    fn open(input: &Input) -> Result<Self> {
        Ok(Self {
            frames: Frames::open(input)?,
            clock: DeviceClock::default(),
        })
    }

    fn next(&mut self) -> Result<Option<Message>> {
        let Some(frame) = self.frames.next()? else {
            return Ok(None);
        };
        // Stamps of messages without a solution are arbitrary and must not move the clock.
        let content = fields::content(&frame)
            .map(|(stamp_us, content)| (self.clock.unwrapped_us(stamp_us), content));
        Ok(Some(Message {
            at: frame.at,
            end: frame.at + frame.bytes as u64,
            kind: (frame.class, frame.message),
            content,
        }))
    }
}
