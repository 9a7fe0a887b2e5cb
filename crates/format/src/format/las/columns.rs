//! The extra dimensions of LAS and LAZ points (LAS 1.4 R15, table 24), and the sensor's pose among them.

use crate::format::las::file::{LasFile, LasPoint, bytes_at};

/// The sensor's pose in the extra bytes of each point: position (m), then roll, pitch, yaw (rad).
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseColumns {
    places: [ExtraColumn; 6],
}

/// One extra dimension: position in the extra bytes, type code of the standard, scale and offset.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExtraColumn {
    /// Offset in the extra bytes.
    pub(crate) at: usize,
    /// Number of its bytes.
    pub(crate) size: usize,
    code: u8,
    scale: f64,
    offset: f64,
}

const POSE_NAMES: [&str; 6] = [
    "SensorX",
    "SensorY",
    "SensorZ",
    "SensorRollRads",
    "SensorPitchRads",
    "SensorYawRads",
];

/// Bytes of the extra-dimension types 1 to 10.
const TYPE_SIZES: [usize; 11] = [0, 1, 1, 2, 2, 4, 4, 8, 8, 4, 8];

/// Names and positions of all extra dimensions.
pub(crate) fn extra_columns(file: &LasFile) -> Vec<(String, ExtraColumn)> {
    let mut columns = Vec::new();
    let mut at = 0;
    let described = file
        .header()
        .all_vlrs()
        .filter(|vlr| vlr.user_id == "LASF_Spec" && vlr.record_id == 4);
    for record in described.flat_map(|vlr| vlr.data.chunks_exact(192)) {
        let (code, options) = (record[2], record[3]);
        let size = match TYPE_SIZES.get(usize::from(code)) {
            // For the untyped code, the options give the number of bytes.
            Some(0) => usize::from(options),
            Some(size) => *size,
            // Arrays of two and three: deprecated, of known size.
            None if code <= 30 => {
                TYPE_SIZES[usize::from((code - 1) % 10 + 1)] * usize::from((code - 1) / 10 + 1)
            }
            None => break,
        };
        let name = record[4..36].split(|b| *b == 0).next().unwrap_or_default();
        let number = |at: usize| f64::from_le_bytes(bytes_at(record, at));
        columns.push((
            String::from_utf8_lossy(name).into_owned(),
            ExtraColumn {
                at,
                size,
                code,
                scale: if options & 8 != 0 { number(112) } else { 1.0 },
                offset: if options & 16 != 0 { number(136) } else { 0.0 },
            },
        ));
        at += size;
    }
    columns
}

/// The names of the extra dimensions.
pub(crate) fn extra_names(file: &LasFile) -> Vec<String> {
    extra_columns(file).into_iter().map(|(n, _)| n).collect()
}

impl ExtraColumn {
    /// Whether it has a numeric type and lies within `length` extra bytes.
    pub(crate) fn fits(&self, length: usize) -> bool {
        let size = TYPE_SIZES.get(usize::from(self.code)).copied().unwrap_or(0);
        size > 0 && self.at + size <= length
    }

    /// Whether its values are unsigned integers of at most 32 bits.
    pub(crate) fn is_small_count(&self) -> bool {
        matches!(self.code, 1 | 3 | 5) && self.scale == 1.0 && self.offset == 0.0
    }

    /// The value of a point with these extra bytes.
    pub(crate) fn value(&self, extra: &[u8]) -> f64 {
        let at = self.at;
        let raw = match self.code {
            1 => f64::from(extra[at]),
            2 => f64::from(extra[at] as i8),
            3 => f64::from(u16::from_le_bytes(bytes_at(extra, at))),
            4 => f64::from(i16::from_le_bytes(bytes_at(extra, at))),
            5 => f64::from(u32::from_le_bytes(bytes_at(extra, at))),
            6 => f64::from(i32::from_le_bytes(bytes_at(extra, at))),
            7 => u64::from_le_bytes(bytes_at(extra, at)) as f64,
            8 => i64::from_le_bytes(bytes_at(extra, at)) as f64,
            9 => f64::from(f32::from_le_bytes(bytes_at(extra, at))),
            _ => f64::from_le_bytes(bytes_at(extra, at)),
        };
        raw * self.scale + self.offset
    }
}

impl PoseColumns {
    /// The columns, if the file has all six, and times.
    pub(crate) fn of(file: &LasFile) -> Option<Self> {
        let columns = extra_columns(file);
        let length = usize::from(file.header().point_format().extra_bytes);
        let mut places = [ExtraColumn {
            at: 0,
            size: 0,
            code: 0,
            scale: 1.0,
            offset: 0.0,
        }; 6];
        for (place, name) in places.iter_mut().zip(POSE_NAMES) {
            *place = columns
                .iter()
                .find(|(other, column)| other == name && column.fits(length))?
                .1;
        }
        file.has_time().then_some(Self { places })
    }

    /// Position (m) and roll, pitch, yaw (rad) of the sensor at a point.
    pub(crate) fn values(&self, point: &LasPoint<'_>) -> [f64; 6] {
        self.places.map(|place| place.value(point.extra))
    }
}
