//! Parser of messages.

use super::layout::{
    ATTRIBUTES_AT, Beginning, INTENSITY, LAST_FLAG, NULL_RANGE, POINT_CLOUD, STAMP,
    STAMP_BYTES_WITH_PTP, STAMPS_AT, UNIFORM_PROFILE, beginning, i32_at, i64_at, u16_at, u32_at,
    u64_at,
};

/// Ticks of a time stamp in a microsecond (SDK, `GoStamp`; the manual says µs, see [`super`]).
pub const TICKS_PER_US: f64 = 1.024;

/// The time and the encoder position of a frame (Gocator user manual, section "Stamp").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stamp {
    /// Index of the frame, from 0 at the start of the scanner.
    pub frame: u64,
    /// Time as it arrived, in ticks of 1/1.024 µs, see [`Stamp::time_us`].
    pub time_ticks: u64,
    /// Encoder, in ticks.
    pub encoder: i64,
    /// Encoder at the last index pulse, in ticks.
    pub encoder_at_z: i64,
    /// Bit 0: digital input of the scanner; bit 4: of the master; bits 8 and 9: pulses between
    /// frames, up to 3.
    pub status: u64,
    /// Serial number of the scanner; if there are two, of the main scanner.
    pub serial_number: u32,
    /// Time of PTP in µs since its epoch, usually TAI, if the stamp has one (SDK, `GoStamp`; not
    /// in the manual).
    pub ptp_time_us: Option<u64>,
}

impl Stamp {
    /// The time in µs.
    pub fn time_us(&self) -> f64 {
        self.time_ticks as f64 / TICKS_PER_US
    }

    /// Ticks of a time in µs.
    pub fn ticks(time_us: f64) -> u64 {
        (time_us * TICKS_PER_US).round() as u64
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        Some(Self {
            frame: u64_at(bytes, 0)?,
            time_ticks: u64_at(bytes, 8)?,
            encoder: i64_at(bytes, 16)?,
            encoder_at_z: i64_at(bytes, 24)?,
            status: u64_at(bytes, 32)?,
            serial_number: u32_at(bytes, 40)?,
            ptp_time_us: u64_at(bytes, STAMP_BYTES_WITH_PTP - 8),
        })
    }
}

/// A message of stamps (Gocator user manual, section "Stamp").
#[derive(Debug, Clone, Copy)]
pub struct Stamps<'a> {
    /// 0 is the main scanner, 1 its buddy.
    pub source: u8,
    stamp_bytes: usize,
    bytes: &'a [u8],
}

impl<'a> Stamps<'a> {
    /// The stamps, one for each frame.
    pub fn iter(&self) -> impl Iterator<Item = Stamp> + use<'a> {
        self.bytes
            .chunks_exact(self.stamp_bytes)
            .filter_map(Stamp::parse)
    }
}

/// The values in a message of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// x and z.
    PointCloud,
    /// z at a constant spacing in x.
    UniformProfile,
    /// Intensity.
    Intensity,
}

/// Attributes of a message of samples (Gocator user manual, sections "Profile Point Cloud",
/// "Uniform Profile", "Profile Intensity").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Attributes {
    /// Frames in this message.
    pub count: u32,
    /// Samples of a frame.
    pub width: u32,
    /// Step of x.
    pub x_scale_nm: u32,
    /// Step of z; zero for intensities, which have none.
    pub z_scale_nm: u32,
    /// x of the raw value 0.
    pub x_offset_um: i32,
    /// z of the raw value 0; zero for intensities, which have none.
    pub z_offset_um: i32,
    /// 0 top, 1 bottom, 2 top left, 3 top right.
    pub source: u8,
    /// Exposure.
    pub exposure_ns: u32,
    /// Index of the camera; reserved in a uniform profile.
    pub camera: u8,
    /// Step of the data stream (2 profile, 8 tool data) and the identifier in it, if the
    /// attributes have them (sections as above; the 2300 manual has none).
    pub stream_step: Option<(i32, i32)>,
    /// Count and index in an array of data, if the attributes have them (SDK, firmware 6; not in
    /// the manual).
    pub arrayed: Option<(i32, i32)>,
}

impl Attributes {
    /// Parses attributes; those of intensities have no z.
    fn parse(bytes: &[u8], has_z: bool) -> Option<Self> {
        // Without the scale and the offset of z, the fields after each of them come four bytes earlier.
        let x_offset_at = if has_z { 16 } else { 12 };
        let source_at = if has_z { 24 } else { 16 };
        let pair = |at| Some((i32_at(bytes, at)?, i32_at(bytes, at + 4)?));
        Some(Self {
            count: u32_at(bytes, 0)?,
            width: u32_at(bytes, 4)?,
            x_scale_nm: u32_at(bytes, 8)?,
            z_scale_nm: if has_z { u32_at(bytes, 12)? } else { 0 },
            x_offset_um: i32_at(bytes, x_offset_at)?,
            z_offset_um: if has_z { i32_at(bytes, 20)? } else { 0 },
            source: *bytes.get(source_at)?,
            exposure_ns: u32_at(bytes, source_at + 1)?,
            camera: *bytes.get(source_at + 5)?,
            stream_step: pair(source_at + 8),
            arrayed: pair(source_at + 16),
        })
    }

    /// Metres of a raw x.
    pub fn x_m(&self, raw: i64) -> f64 {
        metres(raw, self.x_scale_nm, self.x_offset_um)
    }

    /// Metres of a raw z.
    pub fn z_m(&self, raw: i16) -> f64 {
        metres(i64::from(raw), self.z_scale_nm, self.z_offset_um)
    }
}

fn metres(raw: i64, scale_nm: u32, offset_um: i32) -> f64 {
    let nanometres = raw * i64::from(scale_nm) + i64::from(offset_um) * 1000;
    nanometres as f64 / 1e9
}

/// A message of samples.
#[derive(Debug, Clone, Copy)]
pub struct Samples<'a> {
    /// The values of the samples.
    pub kind: Kind,
    /// Attributes of the message.
    pub attributes: Attributes,
    bytes: &'a [u8],
}

impl<'a> Samples<'a> {
    /// Samples of one frame, as bytes.
    fn frame(&self, frame: usize) -> &'a [u8] {
        let sample_bytes = match self.kind {
            Kind::PointCloud => 4,
            Kind::UniformProfile => 2,
            Kind::Intensity => 1,
        };
        let length = self.attributes.width as usize * sample_bytes;
        // `parse` has checked that all frames are present, and no caller asks for more frames.
        self.bytes
            .get(frame.saturating_mul(length)..)
            .and_then(|rest| rest.get(..length))
            .unwrap_or_default()
    }

    /// Intensities of one frame; empty if the samples are points.
    pub fn intensity(&self, frame: usize) -> &'a [u8] {
        match self.kind {
            Kind::Intensity => self.frame(frame),
            Kind::PointCloud | Kind::UniformProfile => &[],
        }
    }

    /// x and z of the points of one frame in metres, `None` for an invalid point; empty if the samples
    /// are intensities.
    pub fn points_m(&self, frame: usize) -> impl Iterator<Item = Option<[f64; 2]>> + use<'a> {
        let (attributes, kind) = (self.attributes, self.kind);
        let step = if kind == Kind::PointCloud { 4 } else { 2 };
        let bytes = match kind {
            Kind::Intensity => &[],
            Kind::PointCloud | Kind::UniformProfile => self.frame(frame),
        };
        bytes
            .chunks_exact(step)
            .zip(0i64..)
            .map(move |(raw, index)| {
                let (x, z) = match *raw {
                    [x0, x1, z0, z1] => {
                        let x = i16::from_le_bytes([x0, x1]);
                        let x = (x != NULL_RANGE).then_some(i64::from(x))?;
                        (x, i16::from_le_bytes([z0, z1]))
                    }
                    [z0, z1] => (index, i16::from_le_bytes([z0, z1])),
                    _ => return None,
                };
                (z != NULL_RANGE).then(|| [attributes.x_m(x), attributes.z_m(z)])
            })
    }
}

/// A message.
#[derive(Debug, Clone, Copy)]
pub enum Message<'a> {
    /// Stamps.
    Stamps(Stamps<'a>),
    /// Points or intensities.
    Samples(Samples<'a>),
    /// A message of another type, with its number.
    Other(u16),
}

impl<'a> Message<'a> {
    /// Parses one complete message; also tells whether it is the last of its data set. `None` if it is damaged.
    pub fn parse(bytes: &'a [u8]) -> Option<(Self, bool)> {
        match beginning(bytes, bytes.len()) {
            Beginning::Certain(size) | Beginning::Possible(size) if size == bytes.len() => {}
            _ => return None,
        }
        let control = u16_at(bytes, 4)?;
        let is_last = control & LAST_FLAG != 0;
        let kind = match control & !LAST_FLAG {
            STAMP => {
                let stamps = Stamps {
                    source: *bytes.get(12)?,
                    stamp_bytes: usize::from(u16_at(bytes, 10)?),
                    bytes: bytes.get(STAMPS_AT..)?,
                };
                return Some((Self::Stamps(stamps), is_last));
            }
            POINT_CLOUD => Kind::PointCloud,
            UNIFORM_PROFILE => Kind::UniformProfile,
            INTENSITY => Kind::Intensity,
            other => return Some((Self::Other(other), is_last)),
        };
        let samples_at = ATTRIBUTES_AT + usize::from(u16_at(bytes, 6)?);
        let attributes = bytes.get(ATTRIBUTES_AT..samples_at)?;
        let samples = Samples {
            kind,
            attributes: Attributes::parse(attributes, kind != Kind::Intensity)?,
            bytes: bytes.get(samples_at..)?,
        };
        Some((Self::Samples(samples), is_last))
    }
}
