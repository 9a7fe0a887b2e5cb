//! What an extra dimension is called, how it is stored, and its place in the record that describes
//! all of them (LAS 1.4 R15, table 24).

use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::las::{LasFile, extra_columns};

/// Asked once for every point of the input, in its order, with the index of the point: fills one
/// value for each dimension and says whether the point is to be written at all. What it does not
/// fill is NaN.
pub type Row<'a> = dyn FnMut(u64, &mut [f64]) -> Result<bool> + 'a;

/// Bytes of the description of one dimension.
const ENTRY: usize = 192;
/// Bytes of a name and of a description text.
const TEXT: usize = 32;
/// Most bytes that one entry without a type can cover.
const MOST_UNTYPED: usize = 255;

/// How the values of a dimension are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExtraKind {
    /// 32-bit floating point: values are rounded to 6 · 10⁻⁸ of themselves; NaN is no value.
    F32,
    /// 64-bit floating point: as computed; NaN is no value.
    F64,
    /// Whole numbers from 0 to 2³² − 1: values are cut off to that range, NaN becomes 0.
    U32,
}

/// A named value beside each point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExtraDimension {
    /// By which others find it: ASCII, 32 bytes at most.
    pub name: String,
    /// How it is stored.
    pub kind: ExtraKind,
    /// What it is, with its unit: ASCII, 32 bytes at most.
    pub description: String,
}

impl ExtraKind {
    /// Bytes of a value.
    pub(super) fn size(self) -> usize {
        match self {
            Self::F32 | Self::U32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number of the type in the standard.
    fn code(self) -> u8 {
        match self {
            Self::U32 => 5,
            Self::F32 => 9,
            Self::F64 => 10,
        }
    }

    pub(in crate::format) fn append(self, value: f64, into: &mut Vec<u8>) {
        match self {
            Self::F32 => into.extend_from_slice(&(value as f32).to_le_bytes()),
            Self::F64 => into.extend_from_slice(&value.to_le_bytes()),
            // `as` saturates and makes 0 of NaN.
            Self::U32 => into.extend_from_slice(&(value as u32).to_le_bytes()),
        }
    }
}

impl ExtraDimension {
    /// A dimension of this name.
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
        entry[4..4 + self.name.len()].copy_from_slice(self.name.as_bytes());
        entry[160..160 + self.description.len()].copy_from_slice(self.description.as_bytes());
        entry
    }
}

/// Checks what the format demands of names and texts.
///
/// # Errors
/// An empty name, one given twice, text that is too long or not ASCII.
pub(in crate::format) fn check(path: &Path, dimensions: &[ExtraDimension]) -> Result<()> {
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
                "different names, names and descriptions of at most 32 ASCII characters",
            ));
        }
    }
    Ok(())
}

/// Makes room for `dimensions` in each point, after the extra bytes that `described` describes,
/// and adds the record that describes both.
///
/// # Errors
/// Points that would be too long.
pub(in crate::format) fn append(
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
            format!("{length} extra bytes beside each point"),
            "at most 65535 bytes a point",
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

/// Which extra bytes of a file stay when dimensions are appended, and their description.
pub(super) struct Kept {
    /// Entries of the dimensions that stay.
    pub(super) entries: Vec<u8>,
    /// Where they stand among the extra bytes of a point, in order.
    pub(super) ranges: Vec<Range<usize>>,
}

impl Kept {
    /// All of the file's extra bytes but those of dimensions that `dimensions` name anew. Bytes
    /// that nothing describes get an entry without type, so that others find what follows.
    pub(super) fn of(file: &LasFile, dimensions: &[ExtraDimension]) -> Result<Self> {
        let length = usize::from(file.header().point_format().extra_bytes);
        let described: Vec<&[u8]> = file
            .header()
            .all_vlrs()
            .filter(|vlr| vlr.user_id == "LASF_Spec" && vlr.record_id == 4)
            .flat_map(|vlr| vlr.data.chunks_exact(ENTRY))
            .collect();
        let columns = extra_columns(file);
        let mut kept = Self {
            entries: Vec::new(),
            ranges: Vec::new(),
        };
        let mut end = 0;
        for ((name, column), entry) in columns.iter().zip(described) {
            end = column.at + column.size;
            if end > length {
                return Err(Error::format(
                    file.path(),
                    Location::Whole,
                    format!(
                        "the extra dimension `{name}` at bytes {} to {end}",
                        column.at
                    ),
                    format!("dimensions within the {length} extra bytes of a point"),
                ));
            }
            if dimensions.iter().all(|dimension| dimension.name != *name) {
                kept.entries.extend_from_slice(entry);
                kept.ranges.push(column.at..end);
            }
        }
        if end < length {
            kept.ranges.push(end..length);
        }
        while end < length {
            let size = MOST_UNTYPED.min(length - end);
            let mut entry = [0; ENTRY];
            entry[3] = size as u8;
            let name = format!("undescribed_{end}");
            entry[4..4 + name.len()].copy_from_slice(name.as_bytes());
            kept.entries.extend_from_slice(&entry);
            end += size;
        }
        Ok(kept)
    }

    /// Bytes that stay.
    pub(super) fn len(&self) -> usize {
        self.ranges.iter().map(|range| range.len()).sum()
    }
}
