//! Assembles profiles from the messages of a data set.

use std::ops::Range;

use super::layout::LARGEST_MESSAGE;
use super::message::{Attributes, Kind, Message, Samples, Stamp};
use super::splitter::{Piece, Splitter};

/// Bytes passed to the splitter at a time, so that it buffers little more than one message.
const PORTION: usize = 1 << 16;

/// One profile of a scanner.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Index of its frame, from 0 at the start of the scanner.
    pub frame: u64,
    /// Time on the clock of the scanner, microseconds.
    pub time_us: f64,
    /// Its complete stamp.
    pub stamp: Stamp,
    /// Attributes of its message.
    pub attributes: Attributes,
    /// Whether x has a constant spacing.
    pub is_uniform: bool,
    /// x of the valid points.
    pub x_m: Vec<f64>,
    /// z of the valid points.
    pub z_m: Vec<f64>,
    /// Intensities of the valid points, if the scanner sends them.
    pub intensity: Option<Vec<u8>>,
    /// Range of its data set in the stream, bytes, which gives the time of its arrival.
    pub bytes: Range<u64>,
}

/// Statistics of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Bytes read.
    pub bytes: u64,
    /// Complete messages.
    pub messages: u64,
    /// Messages of types that are not read.
    pub other_messages: u64,
    /// Data sets with at least one message of a type that is read.
    pub sets: u64,
    /// Profiles returned.
    pub profiles: u64,
    /// Profiles that are not returned because their stamp was damaged.
    pub unstamped: u64,
    /// Stamps whose profile was damaged.
    pub empty: u64,
    /// Runs of bytes that belong to no complete message.
    pub gaps: u64,
    /// Number of these bytes.
    pub skipped_bytes: u64,
}

/// Reads profiles from the bytes of a data channel.
#[derive(Debug, Default)]
pub struct ProfileReader {
    splitter: Splitter,
    set: DataSet,
    counts: Counts,
}

impl ProfileReader {
    /// A reader at the beginning of a stream.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the next bytes and passes the profiles that they complete to `sink`.
    ///
    /// A data set is complete when its last message is complete and the next data set begins, or at the end.
    pub fn read(&mut self, bytes: &[u8], mut sink: impl FnMut(Profile)) {
        for portion in bytes.chunks(PORTION) {
            self.counts.bytes += portion.len() as u64;
            self.splitter.push(portion);
            self.take(&mut sink);
        }
    }

    /// Ends the stream and passes the remaining profiles to `sink`.
    pub fn finish(&mut self, mut sink: impl FnMut(Profile)) {
        self.splitter.finish();
        self.take(&mut sink);
        self.set.end(&mut self.counts, &mut sink);
    }

    /// Statistics so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    fn take(&mut self, sink: &mut impl FnMut(Profile)) {
        while let Some(piece) = self.splitter.next() {
            match piece {
                Piece::Message(bytes, at) => {
                    self.counts.messages += 1;
                    self.set.add(bytes, at, &mut self.counts, sink);
                }
                Piece::Gap(bytes) => {
                    self.counts.gaps += 1;
                    self.counts.skipped_bytes += bytes;
                    // Messages after the gap may belong to another frame.
                    self.set.end(&mut self.counts, sink);
                }
            }
        }
    }
}

/// Messages of a data set that is not complete.
#[derive(Debug, Default)]
struct DataSet {
    /// Stamps of the main scanner or, if it sends none, of the other scanner.
    stamps: Vec<Stamp>,
    /// 0 if the stamps are those of the main scanner.
    stamps_source: u8,
    /// Messages of samples, one after the other, and the length of each.
    bytes: Vec<u8>,
    lengths: Vec<usize>,
    span: Option<Range<u64>>,
}

impl DataSet {
    fn add(&mut self, bytes: &[u8], at: u64, counts: &mut Counts, sink: &mut impl FnMut(Profile)) {
        let Some((message, is_last)) = Message::parse(bytes) else {
            return;
        };
        let begins_set = match &message {
            // The last message of the previous set was lost.
            Message::Stamps(stamps) => {
                !self.stamps.is_empty() && stamps.source == self.stamps_source
            }
            Message::Samples(_) => self.bytes.len() + bytes.len() > 2 * LARGEST_MESSAGE,
            Message::Other(_) => false,
        };
        if begins_set {
            self.end(counts, sink);
        }
        let end = at + bytes.len() as u64;
        match message {
            Message::Stamps(stamps) => {
                if self.stamps.is_empty() || stamps.source == 0 {
                    self.stamps.clear();
                    self.stamps.extend(stamps.iter());
                    self.stamps_source = stamps.source;
                }
                self.cover(at..end);
            }
            Message::Samples(_) => {
                self.bytes.extend_from_slice(bytes);
                self.lengths.push(bytes.len());
                self.cover(at..end);
            }
            Message::Other(_) => counts.other_messages += 1,
        }
        if is_last {
            self.end(counts, sink);
        }
    }

    /// Extends the span of the set to the end of a message.
    fn cover(&mut self, message: Range<u64>) {
        let start = self.span.as_ref().map_or(message.start, |span| span.start);
        self.span = Some(start..message.end);
    }

    /// Passes the profiles to `sink` and begins the next set.
    fn end(&mut self, counts: &mut Counts, sink: &mut impl FnMut(Profile)) {
        let Some(span) = self.span.take() else {
            return;
        };
        counts.sets += 1;
        let (mut points, mut intensities) = (Vec::new(), Vec::new());
        let mut at = 0;
        for &length in &self.lengths {
            if let Some((Message::Samples(samples), _)) =
                Message::parse(&self.bytes[at..][..length])
            {
                match samples.kind {
                    Kind::Intensity => intensities.push(samples),
                    Kind::PointCloud | Kind::UniformProfile => points.push(samples),
                }
            }
            at += length;
        }
        if points.is_empty() {
            counts.empty += self.stamps.len() as u64;
        }
        for samples in &points {
            let intensity = intensities.iter().find(|it| belong_together(samples, it));
            // Only as many frames as stamps: a message without points could claim any number of frames.
            let frames = samples.attributes.count as usize;
            counts.unstamped += frames.saturating_sub(self.stamps.len()) as u64;
            for (frame, &stamp) in self.stamps.iter().enumerate().take(frames) {
                counts.profiles += 1;
                sink(profile(samples, intensity, frame, stamp, span.clone()));
            }
        }
        self.stamps.clear();
        self.bytes.clear();
        self.lengths.clear();
    }
}

/// Whether these intensities belong to these points.
fn belong_together(points: &Samples<'_>, intensity: &Samples<'_>) -> bool {
    let key = |it: &Attributes| (it.count, it.width, it.source, it.stream_step, it.arrayed);
    key(&points.attributes) == key(&intensity.attributes)
}

fn profile(
    samples: &Samples<'_>,
    intensity: Option<&Samples<'_>>,
    frame: usize,
    stamp: Stamp,
    bytes: Range<u64>,
) -> Profile {
    let width = samples.attributes.width as usize;
    let (mut x_m, mut z_m) = (Vec::with_capacity(width), Vec::with_capacity(width));
    let mut valid_intensities = intensity.map(|_| Vec::with_capacity(width));
    let values = intensity.map_or(&[][..], |it| it.intensity(frame));
    for (index, point) in samples.points_m(frame).enumerate() {
        let Some([x, z]) = point else { continue };
        x_m.push(x);
        z_m.push(z);
        if let (Some(valid_intensities), Some(&value)) = (&mut valid_intensities, values.get(index))
        {
            valid_intensities.push(value);
        }
    }
    Profile {
        frame: stamp.frame,
        time_us: stamp.time_us(),
        stamp,
        attributes: samples.attributes,
        is_uniform: samples.kind == Kind::UniformProfile,
        x_m,
        z_m,
        intensity: valid_intensities,
        bytes,
    }
}
