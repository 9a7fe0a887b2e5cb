//! Writer of messages, for the simulated scanner and for tests.

use super::layout::{
    ATTRIBUTES_AT, INTENSITY, LAST_FLAG, NULL_RANGE, POINT_CLOUD, STAMP, STAMP_BYTES,
    STAMP_BYTES_WITH_PTP, STAMPS_AT, UNIFORM_PROFILE,
};
use super::message::{Attributes, Stamp};

/// Steps and offsets between raw ranges and metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scales {
    /// Step of x; in a uniform profile the spacing of the points.
    pub x_scale_nm: u32,
    /// Step of z.
    pub z_scale_nm: u32,
    /// x of the raw value 0; in a uniform profile x of the first point.
    pub x_offset_um: i32,
    /// z of the raw value 0.
    pub z_offset_um: i32,
}

impl Scales {
    /// Raw x of metres; [`NULL_RANGE`] if it is not finite or out of range.
    pub fn raw_x(&self, x_m: f64) -> i16 {
        raw(x_m, self.x_scale_nm, self.x_offset_um)
    }

    /// Raw z of metres; [`NULL_RANGE`] if it is not finite or out of range.
    pub fn raw_z(&self, z_m: f64) -> i16 {
        raw(z_m, self.z_scale_nm, self.z_offset_um)
    }
}

fn raw(metres: f64, scale_nm: u32, offset_um: i32) -> i16 {
    let steps = ((metres * 1e9 - f64::from(offset_um) * 1e3) / f64::from(scale_nm)).round();
    if steps.abs() <= f64::from(i16::MAX) {
        steps as i16
    } else {
        // Out of range or NaN.
        NULL_RANGE
    }
}

/// Writes messages one after the other.
///
/// Attributes and stamps are only as long as their content requires: a stream step, array fields and a time of
/// PTP make them longer.
#[derive(Debug, Clone, Default)]
pub struct Encoder {
    bytes: Vec<u8>,
    unknown: Vec<u8>,
}

impl Encoder {
    /// An encoder that appends these bytes to all attributes and stamps, as a later firmware could.
    pub fn with_unknown(unknown: Vec<u8>) -> Self {
        Self {
            bytes: Vec::new(),
            unknown,
        }
    }

    /// Removes and returns the bytes written so far.
    pub fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Writes a message of stamps. Either all stamps have a time of PTP or none.
    pub fn stamps(&mut self, source: u8, stamps: &[Stamp], is_last: bool) {
        let has_ptp = stamps.iter().any(|stamp| stamp.ptp_time_us.is_some());
        let known = if has_ptp {
            STAMP_BYTES_WITH_PTP
        } else {
            STAMP_BYTES
        };
        let stamp_bytes = known + self.unknown.len();
        self.head(STAMP, STAMPS_AT + stamps.len() * stamp_bytes, is_last);
        self.u32(stamps.len());
        self.u16(stamp_bytes);
        self.bytes.extend([source, 0]);
        for stamp in stamps {
            self.bytes.extend(stamp.frame.to_le_bytes());
            self.bytes.extend(stamp.time_ticks.to_le_bytes());
            self.bytes.extend(stamp.encoder.to_le_bytes());
            self.bytes.extend(stamp.encoder_at_z.to_le_bytes());
            self.bytes.extend(stamp.status.to_le_bytes());
            self.bytes.extend(stamp.serial_number.to_le_bytes());
            self.bytes.extend([0; 12]);
            if has_ptp {
                let time_us = stamp.ptp_time_us.unwrap_or_default();
                self.bytes.extend(time_us.to_le_bytes());
            }
            self.bytes.extend(&self.unknown);
        }
    }

    /// Writes a message of points: raw x and z of all frames, `attributes.width` points for each frame. The
    /// count in the message follows from the number of points, not from `attributes.count`.
    pub fn point_cloud(&mut self, attributes: &Attributes, points: &[[i16; 2]], is_last: bool) {
        self.samples(POINT_CLOUD, attributes, points.len(), 4, is_last);
        for [x, z] in points {
            self.bytes.extend(x.to_le_bytes());
            self.bytes.extend(z.to_le_bytes());
        }
    }

    /// Writes a message of raw ranges at a constant spacing.
    pub fn uniform_profile(&mut self, attributes: &Attributes, ranges: &[i16], is_last: bool) {
        self.samples(UNIFORM_PROFILE, attributes, ranges.len(), 2, is_last);
        for z in ranges {
            self.bytes.extend(z.to_le_bytes());
        }
    }

    /// Writes a message of intensities.
    pub fn intensity(&mut self, attributes: &Attributes, intensities: &[u8], is_last: bool) {
        self.samples(INTENSITY, attributes, intensities.len(), 1, is_last);
        self.bytes.extend(intensities);
    }

    /// Writes a message of any type.
    pub fn other(&mut self, kind: u16, content: &[u8], is_last: bool) {
        self.head(kind, super::layout::HEADER_BYTES + content.len(), is_last);
        self.bytes.extend(content);
    }

    /// Writes the head and the attributes of a message of samples.
    fn samples(
        &mut self,
        kind: u16,
        attributes: &Attributes,
        samples: usize,
        sample_bytes: usize,
        is_last: bool,
    ) {
        let mut fields = Vec::new();
        let width = attributes.width.max(1);
        let count = u32::try_from(samples).unwrap_or(u32::MAX) / width;
        let has_z = kind != INTENSITY;
        for value in [count, attributes.width, attributes.x_scale_nm] {
            fields.extend(value.to_le_bytes());
        }
        if has_z {
            fields.extend(attributes.z_scale_nm.to_le_bytes());
        }
        fields.extend(attributes.x_offset_um.to_le_bytes());
        if has_z {
            fields.extend(attributes.z_offset_um.to_le_bytes());
        }
        fields.push(attributes.source);
        fields.extend(attributes.exposure_ns.to_le_bytes());
        fields.extend([attributes.camera, 0, 0]);
        // The array fields come after the stream step, so they need it even if it is unknown.
        let stream_step = attributes
            .stream_step
            .or(attributes.arrayed.map(|_| (-1, -1)));
        for (first, second) in stream_step.into_iter().chain(attributes.arrayed) {
            fields.extend(first.to_le_bytes());
            fields.extend(second.to_le_bytes());
        }
        fields.extend(&self.unknown);
        let size = ATTRIBUTES_AT + fields.len() + samples * sample_bytes;
        self.head(kind, size, is_last);
        self.u16(fields.len());
        self.bytes.extend(fields);
    }

    fn head(&mut self, kind: u16, size: usize, is_last: bool) {
        self.u32(size);
        let flag = if is_last { LAST_FLAG } else { 0 };
        self.bytes.extend((kind | flag).to_le_bytes());
    }

    fn u32(&mut self, value: usize) {
        let value = u32::try_from(value).unwrap_or(u32::MAX);
        self.bytes.extend(value.to_le_bytes());
    }

    fn u16(&mut self, value: usize) {
        let value = u16::try_from(value).unwrap_or(u16::MAX);
        self.bytes.extend(value.to_le_bytes());
    }
}
