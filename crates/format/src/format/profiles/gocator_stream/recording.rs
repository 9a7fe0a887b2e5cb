//! Reader of a recorded data channel, `.gocator`.

use std::collections::VecDeque;
use std::io::Read;
use std::path::PathBuf;

use super::message::Message;
use super::profile::{Profile, ProfileReader as Stream};
use crate::error::{Error, Location, Result};
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::{self, Input};
use crate::format::kind::{Frame, Kind};
use crate::format::profiles::bonn::STAND_OFF_M;
use crate::format::profiles::reader::ProfileReader;
use crate::geometry::Vec3;
use crate::sensor::ScanPoint;

pub(crate) const STREAM: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    extensions: &["gocator"],
    profiles: Some(|path| Ok(Box::new(StreamReader::open(path)?))),
    record_ends: Some(record_ends),
    contents: Some(contents),
    frame: Frame::Fixed(
        "nanometres and micrometres, ticks of 1/1.024 µs of the scanner's clock (the format); scanner frame: x along the laser line, y = 0, z towards the scanner",
    ),
    ..Kind::new("gocator", "profiles (Gocator data channel)")
};

/// Bytes read from the file at a time.
const CHUNK: usize = 1 << 20;

/// Whether these could be the first bytes: a complete message of stamps, with which each set begins.
fn looks_like(start: &[u8]) -> bool {
    let size = start.first_chunk().map(|size| u32::from_le_bytes(*size));
    let message = size.and_then(|size| start.get(..usize::try_from(size).ok()?));
    matches!(
        message.and_then(Message::parse),
        Some((Message::Stamps(_), _))
    )
}

/// The profiles of a file one after the other.
struct Profiles {
    path: PathBuf,
    file: input::Stream,
    stream: Stream,
    buffer: Vec<u8>,
    ready: VecDeque<Profile>,
    read: u64,
    total: u64,
    has_ended: bool,
}

impl Profiles {
    fn open(input: &Input) -> Result<Self> {
        let (file, total) = input.open()?;
        Ok(Self {
            path: input.path().to_owned(),
            file,
            stream: Stream::new(),
            buffer: vec![0; CHUNK],
            ready: VecDeque::new(),
            read: 0,
            total,
            has_ended: false,
        })
    }

    fn next(&mut self) -> Result<Option<Profile>> {
        while self.ready.is_empty() && !self.has_ended {
            let read = self.file.read(&mut self.buffer);
            let count = read.map_err(|error| Error::io(&self.path, error))?;
            self.read += count as u64;
            let ready = &mut self.ready;
            match count {
                0 => {
                    self.stream.finish(|profile| ready.push_back(profile));
                    self.has_ended = true;
                }
                _ => self
                    .stream
                    .read(&self.buffer[..count], |profile| ready.push_back(profile)),
            }
        }
        Ok(self.ready.pop_front())
    }
}

/// Reads a recording in bounded memory.
struct StreamReader {
    profiles: Profiles,
    last_time_s: f64,
    has_points: bool,
}

impl StreamReader {
    fn open(input: &Input) -> Result<Self> {
        Ok(Self {
            profiles: Profiles::open(input)?,
            last_time_s: f64::NEG_INFINITY,
            has_points: false,
        })
    }
}

impl ProfileReader for StreamReader {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        into.clear();
        while into.len() < CHUNK_POINTS {
            let Some(profile) = self.profiles.next()? else {
                break;
            };
            let time_s = 1e-6 * profile.time_us;
            if time_s < self.last_time_s {
                return Err(Error::format(
                    &self.profiles.path,
                    Location::Byte(profile.bytes.start),
                    format!("time {time_s} s after {} s", self.last_time_s),
                    "times that do not go back: split the recording where the scanner was restarted",
                ));
            }
            self.last_time_s = time_s;
            let points = profile.x_m.iter().zip(&profile.z_m).enumerate();
            into.extend(points.map(|(i, (x_m, z_m))| {
                ScanPoint {
                    time_s,
                    position_m: Vec3::new(*x_m, 0.0, z_m - STAND_OFF_M),
                    intensity: profile
                        .intensity
                        .as_ref()
                        .and_then(|all| all.get(i))
                        .map_or(0.0, |value| f32::from(*value)),
                }
            }));
        }
        if into.is_empty() && !self.has_points {
            return Err(nothing_in(&self.profiles.path, "valid point"));
        }
        self.has_points = true;
        Ok(!into.is_empty())
    }

    fn bytes_read(&self) -> u64 {
        self.profiles.read
    }

    fn bytes_total(&self) -> u64 {
        self.profiles.total
    }
}

/// The end of each profile's data set, in bytes from the start of the file, and its time on the scanner's clock,
/// seconds.
fn record_ends(input: &Input) -> Result<Vec<(u64, f64)>> {
    let (mut profiles, mut ends) = (Profiles::open(input)?, Vec::new());
    while let Some(profile) = profiles.next()? {
        ends.push((profile.bytes.end, 1e-6 * profile.time_us));
    }
    Ok(ends)
}

/// The content of a recording in one line.
fn contents(input: &Input) -> Result<String> {
    let mut profiles = Profiles::open(input)?;
    while profiles.next()?.is_some() {}
    let counts = profiles.stream.counts();
    let mut text = format!("{} profiles", counts.profiles);
    if counts.skipped_bytes > 0 {
        let (bytes, places) = (counts.skipped_bytes, counts.gaps);
        text += &format!(", {bytes} damaged bytes in {places} places");
    }
    let incomplete = counts.unstamped + counts.empty;
    if incomplete > 0 {
        text += &format!(", {incomplete} incomplete");
    }
    Ok(text)
}
