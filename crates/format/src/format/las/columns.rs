//! The extra dimensions of LAS and LAZ points (LAS 1.4 R15, table 24), and the sensor's pose among them.

use crate::format::binary::bytes_at;
use crate::format::las::file::{LasFile, LasPoint};
use crate::format::las::value::ExtraValue;

/// The sensor's pose in the extra bytes of each point: position (m), then roll, pitch, yaw (rad).
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseColumns {
    places: [ExtraColumn; 6],
}

/// The description of an extra dimension in a file.
pub(crate) struct ExtraEntry<'a> {
    pub(crate) name: String,
    /// Offset in the extra bytes.
    pub(crate) at: usize,
    /// Number of its bytes.
    pub(crate) size: usize,
    /// The entry as stored.
    pub(crate) record: &'a [u8],
}

/// One value in the extra bytes: its position, type, scale, offset, and the value that stands for no data.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExtraColumn {
    at: usize,
    /// Type code of a single value, from 1 to 10.
    code: u8,
    scale: f64,
    offset: f64,
    /// As stored: its first bytes have the type of the column if that is an integer, else it is a 64-bit float.
    no_data: Option<[u8; 8]>,
}

const POSE_NAMES: [&str; 6] = [
    "SensorX",
    "SensorY",
    "SensorZ",
    "SensorRollRads",
    "SensorPitchRads",
    "SensorYawRads",
];

/// Bytes of an entry.
const ENTRY: usize = 192;
/// Bytes of the extra-dimension types 1 to 10.
const TYPE_SIZES: [usize; 11] = [0, 1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
/// Type codes of 64-bit integers and of floating point.
const U64: u8 = 7;
const I64: u8 = 8;
const F32: u8 = 9;
const F64: u8 = 10;
/// Option bits of an entry, and the positions of what they announce, an array of three for each.
pub(crate) const HAS_NO_DATA: u8 = 1;
const HAS_SCALE: u8 = 8;
const HAS_OFFSET: u8 = 16;
pub(crate) const NO_DATA: usize = 40;
const SCALE: usize = 112;
const OFFSET: usize = 136;

/// The extra dimensions that a file describes, in the order of their bytes.
pub(crate) fn extra_entries(file: &LasFile) -> Vec<ExtraEntry<'_>> {
    let mut entries = Vec::new();
    let mut at = 0;
    let described = file
        .header()
        .all_vlrs()
        .filter(|vlr| vlr.user_id == "LASF_Spec" && vlr.record_id == 4);
    for record in described.flat_map(|vlr| vlr.data.chunks_exact(ENTRY)) {
        let (code, options) = (record[2], record[3]);
        let size = match code {
            // For the untyped code, the options give the number of bytes.
            0 => usize::from(options),
            1..=30 => {
                let (code, count) = single(code);
                TYPE_SIZES[usize::from(code)] * count
            }
            _ => break,
        };
        let name = record[4..36].split(|b| *b == 0).next().unwrap_or_default();
        entries.push(ExtraEntry {
            name: String::from_utf8_lossy(name).into_owned(),
            at,
            size,
            record,
        });
        at += size;
    }
    entries
}

/// The type of one value of a type from 1 to 30, and the number of its values: types above 10 are arrays of two and
/// three, which are deprecated.
fn single(code: u8) -> (u8, usize) {
    ((code - 1) % 10 + 1, usize::from((code - 1) / 10 + 1))
}

impl ExtraEntry<'_> {
    /// Its values by name, if it has a type and lies within `length` extra bytes: one value under its own name, or
    /// those of an array with their numbers.
    pub(crate) fn columns(&self, length: usize) -> Vec<(String, ExtraColumn)> {
        let (code, options) = (self.record[2], self.record[3]);
        if code == 0 || self.at + self.size > length {
            return Vec::new();
        }
        let (code, count) = single(code);
        let number = |at: usize| f64::from_le_bytes(bytes_at(self.record, at));
        let column = |i: usize| ExtraColumn {
            at: self.at + i * TYPE_SIZES[usize::from(code)],
            code,
            scale: if options & HAS_SCALE != 0 {
                number(SCALE + 8 * i)
            } else {
                1.0
            },
            offset: if options & HAS_OFFSET != 0 {
                number(OFFSET + 8 * i)
            } else {
                0.0
            },
            no_data: (options & HAS_NO_DATA != 0).then(|| bytes_at(self.record, NO_DATA + 8 * i)),
        };
        let name = |i: usize| {
            if count == 1 {
                self.name.clone()
            } else {
                format!("{}_{i}", self.name)
            }
        };
        (0..count).map(|i| (name(i), column(i))).collect()
    }
}

/// The values in the extra bytes of a point, by name.
pub(crate) fn extra_columns(file: &LasFile) -> Vec<(String, ExtraColumn)> {
    let length = usize::from(file.header().point_format().extra_bytes);
    let entries = extra_entries(file);
    entries
        .iter()
        .flat_map(|entry| entry.columns(length))
        .collect()
}

/// The names of the extra dimensions.
pub(crate) fn extra_names(file: &LasFile) -> Vec<String> {
    let entries = extra_entries(file).into_iter();
    entries.map(|entry| entry.name).collect()
}

impl ExtraColumn {
    fn is_plain(&self) -> bool {
        self.scale == 1.0 && self.offset == 0.0
    }

    /// Whether its values are unsigned integers of at most 32 bits, each of them a value.
    pub(crate) fn is_small_count(&self) -> bool {
        matches!(self.code, 1 | 3 | 5) && self.is_plain() && self.no_data.is_none()
    }

    /// Whether its values are integers of 64 bits without a sign.
    pub(crate) fn is_u64(&self) -> bool {
        self.code == U64 && self.is_plain()
    }

    /// Whether its values are integers of 64 bits with a sign.
    pub(crate) fn is_i64(&self) -> bool {
        self.code == I64 && self.is_plain()
    }

    /// The value of a point with these extra bytes; NaN stands for no data.
    pub(crate) fn value(&self, extra: &[u8]) -> ExtraValue {
        if self.is_no_data(extra) {
            return ExtraValue::NONE;
        }
        match self.code {
            U64 if self.is_plain() => {
                ExtraValue::Unsigned(u64::from_le_bytes(bytes_at(extra, self.at)))
            }
            I64 if self.is_plain() => {
                ExtraValue::Signed(i64::from_le_bytes(bytes_at(extra, self.at)))
            }
            _ => ExtraValue::Number(self.raw(extra) * self.scale + self.offset),
        }
    }

    fn is_no_data(&self, extra: &[u8]) -> bool {
        let Some(no_data) = self.no_data else {
            return false;
        };
        if matches!(self.code, F32 | F64) {
            return self.raw(extra) == f64::from_le_bytes(no_data);
        }
        let size = TYPE_SIZES[usize::from(self.code)];
        extra[self.at..self.at + size] == no_data[..size]
    }

    /// The stored number.
    fn raw(&self, extra: &[u8]) -> f64 {
        let at = self.at;
        match self.code {
            1 => f64::from(extra[at]),
            2 => f64::from(extra[at] as i8),
            3 => f64::from(u16::from_le_bytes(bytes_at(extra, at))),
            4 => f64::from(i16::from_le_bytes(bytes_at(extra, at))),
            5 => f64::from(u32::from_le_bytes(bytes_at(extra, at))),
            6 => f64::from(i32::from_le_bytes(bytes_at(extra, at))),
            U64 => u64::from_le_bytes(bytes_at(extra, at)) as f64,
            I64 => i64::from_le_bytes(bytes_at(extra, at)) as f64,
            F32 => f64::from(f32::from_le_bytes(bytes_at(extra, at))),
            _ => f64::from_le_bytes(bytes_at(extra, at)),
        }
    }
}

impl PoseColumns {
    /// The columns, if the file has all six, and times.
    pub(crate) fn of(file: &LasFile) -> Option<Self> {
        let columns = extra_columns(file);
        let find = |name: &str| columns.iter().find(|(other, _)| other == name);
        let found: Vec<ExtraColumn> = POSE_NAMES
            .iter()
            .filter_map(|name| find(name).map(|(_, column)| *column))
            .collect();
        let places = found.try_into().ok()?;
        file.has_time().then_some(Self { places })
    }

    /// Position (m) and roll, pitch, yaw (rad) of the sensor at a point.
    pub(crate) fn values(&self, point: &LasPoint<'_>) -> [f64; 6] {
        self.places.map(|place| place.value(point.extra).number())
    }
}
