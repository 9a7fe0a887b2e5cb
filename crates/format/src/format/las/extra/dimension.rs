//! Name, storage type and description record of an extra dimension (LAS 1.4 R15, table 24).

use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::las::columns::{HAS_NO_DATA, NO_DATA, extra_entries};
use crate::format::las::file::LasFile;
use crate::format::las::value::ExtraValue;

/// Called once for every point of the input, in order, with the index of the point: fills one value
/// for each dimension and returns whether to write the point. Values that it does not fill are NaN.
pub type Row<'a> = dyn FnMut(u64, &mut [f64]) -> Result<bool> + 'a;

/// Bytes of the description of a dimension.
const ENTRY: usize = 192;
/// Bytes of a name and of a description text.
const TEXT: usize = 32;
/// Most bytes that one entry without a type can cover.
const MOST_UNTYPED: usize = 255;

/// The storage type of a dimension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExtraKind {
    /// 32-bit floating point: relative rounding error 6 · 10⁻⁸; NaN means no value.
    F32,
    /// 64-bit floating point: as computed; NaN means no value.
    F64,
    /// Integers from 0 to 2³² − 1: values are clamped to this range, NaN becomes 0.
    U32,
    /// Integers from −2⁶³ to 2⁶³ − 1; −2⁶³ means no value in formats that have no empty cells.
    I64,
    /// Integers from 0 to 2⁶⁴ − 1; 2⁶⁴ − 1 means no value in formats that have no empty cells.
    U64,
}

/// A named value for each point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExtraDimension {
    /// Name: ASCII, 32 bytes at most.
    pub name: String,
    /// Storage type.
    pub kind: ExtraKind,
    /// Description with unit: ASCII, 32 bytes at most.
    pub description: String,
}

impl ExtraKind {
    /// Bytes of a value.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::F32 | Self::U32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
        }
    }

    /// The type code of the standard.
    fn code(self) -> u8 {
        match self {
            Self::U32 => 5,
            Self::U64 => 7,
            Self::I64 => 8,
            Self::F32 => 9,
            Self::F64 => 10,
        }
    }

    /// The bytes that stand for no value among integers of 64 bits.
    fn no_data(self) -> Option<[u8; 8]> {
        match self {
            Self::F32 | Self::F64 | Self::U32 => None,
            Self::I64 => Some(i64::MIN.to_le_bytes()),
            Self::U64 => Some(u64::MAX.to_le_bytes()),
        }
    }

    pub(crate) fn append(self, value: ExtraValue, into: &mut Vec<u8>) {
        match self {
            Self::F32 => into.extend_from_slice(&(value.number() as f32).to_le_bytes()),
            Self::F64 => into.extend_from_slice(&value.number().to_le_bytes()),
            // `as` saturates and converts NaN to 0.
            Self::U32 => into.extend_from_slice(&(value.number() as u32).to_le_bytes()),
            Self::I64 => into.extend_from_slice(&value.signed().unwrap_or(i64::MIN).to_le_bytes()),
            Self::U64 => {
                into.extend_from_slice(&value.unsigned().unwrap_or(u64::MAX).to_le_bytes());
            }
        }
    }
}

impl ExtraDimension {
    /// A dimension with this name.
    pub fn new(name: &str, kind: ExtraKind, description: &str) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            description: description.to_owned(),
        }
    }

    fn entry(&self) -> [u8; ENTRY] {
        let mut entry = [0; ENTRY];
        entry[2] = self.kind.code();
        if let Some(no_data) = self.kind.no_data() {
            entry[3] = HAS_NO_DATA;
            entry[NO_DATA..NO_DATA + 8].copy_from_slice(&no_data);
        }
        entry[4..4 + self.name.len()].copy_from_slice(self.name.as_bytes());
        entry[160..160 + self.description.len()].copy_from_slice(self.description.as_bytes());
        entry
    }
}

/// Checks names and descriptions against the format.
///
/// # Errors
/// A name that is empty or not unique; text that is too long or not ASCII.
pub(crate) fn check(path: &Path, dimensions: &[ExtraDimension]) -> Result<()> {
    for (at, dimension) in dimensions.iter().enumerate() {
        let fits = |text: &str| text.is_ascii() && text.len() <= TEXT;
        let is_new = dimensions[..at].iter().all(|d| d.name != dimension.name);
        if dimension.name.is_empty()
            || !is_new
            || !fits(&dimension.name)
            || !fits(&dimension.description)
        {
            return Err(Error::format(
                path,
                Location::Whole,
                format!(
                    "the extra dimension `{}` described as `{}`",
                    dimension.name, dimension.description
                ),
                "different names, and names and descriptions of at most 32 ASCII characters",
            ));
        }
    }
    Ok(())
}

/// Makes room for `dimensions` in each point, after the extra bytes of the entries in `described`,
/// and adds the record that describes both.
///
/// # Errors
/// Points that would be too long.
pub(crate) fn append(
    path: &Path,
    builder: &mut las::Builder,
    described: Vec<u8>,
    dimensions: &[ExtraDimension],
) -> Result<()> {
    let format = &mut builder.point_format;
    let added: usize = dimensions.iter().map(|d| d.kind.size()).sum();
    let length = usize::from(format.extra_bytes) + added;
    let standard = usize::from(format.len() - format.extra_bytes);
    if standard + length > usize::from(u16::MAX) {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{length} extra bytes per point"),
            "at most 65535 bytes per point",
        ));
    }
    format.extra_bytes = length as u16;
    let mut data = described;
    for dimension in dimensions {
        data.extend_from_slice(&dimension.entry());
    }
    if !data.is_empty() {
        builder.vlrs.push(las::Vlr {
            user_id: "LASF_Spec".to_owned(),
            record_id: 4,
            description: "extra bytes".to_owned(),
            data,
        });
    }
    Ok(())
}

/// The extra bytes of a file that are kept when dimensions are appended, and their description.
pub(super) struct Retained {
    /// Entries of the dimensions that are kept.
    pub(super) entries: Vec<u8>,
    /// Their ranges in the extra bytes of a point, in order.
    pub(super) ranges: Vec<Range<usize>>,
}

impl Retained {
    /// All of the file's extra bytes except the dimensions replaced by `dimensions`. Undescribed
    /// bytes get an untyped entry, so that readers find the dimensions behind them.
    pub(super) fn of(file: &LasFile, dimensions: &[ExtraDimension]) -> Result<Self> {
        let length = usize::from(file.header().point_format().extra_bytes);
        let mut retained = Self {
            entries: Vec::new(),
            ranges: Vec::new(),
        };
        let mut end = 0;
        for entry in extra_entries(file) {
            let name = &entry.name;
            end = entry.at + entry.size;
            if end > length {
                return Err(Error::format(
                    file.path(),
                    Location::Whole,
                    format!(
                        "the extra dimension `{name}` at bytes {} to {end}",
                        entry.at
                    ),
                    format!("dimensions within the {length} extra bytes of a point"),
                ));
            }
            if dimensions.iter().all(|dimension| dimension.name != *name) {
                retained.entries.extend_from_slice(entry.record);
                retained.ranges.push(entry.at..end);
            }
        }
        if end < length {
            retained.ranges.push(end..length);
        }
        while end < length {
            let size = MOST_UNTYPED.min(length - end);
            let mut entry = [0; ENTRY];
            entry[3] = size as u8;
            let name = format!("undescribed_{end}");
            entry[4..4 + name.len()].copy_from_slice(name.as_bytes());
            retained.entries.extend_from_slice(&entry);
            end += size;
        }
        Ok(retained)
    }

    /// Number of bytes that are kept.
    pub(super) fn len(&self) -> usize {
        self.ranges.iter().map(|range| range.len()).sum()
    }
}
