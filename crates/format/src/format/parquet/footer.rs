//! The footer of a Parquet file: checked before the library reads it.
//!
//! The footer is a structure in the compact protocol of Apache Thrift. The library reserves memory
//! for as many children as a group of the schema claims, and recurses as deep as the schema does:
//! both are checked first, as is the memory that the decoded footer will take.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use ::parquet::file::metadata::{
    ParquetMetaData, ParquetMetaDataOptions, ParquetMetaDataReader, ParquetStatisticsPolicy,
};

use super::{WHOLE, damaged};
use crate::error::{Error, Location, Result};

/// Most levels of nested structures: the format has eight.
const DEEPEST: usize = 32;
/// Most levels of nested groups of columns.
const DEEPEST_SCHEMA: usize = 32;
/// Memory that a decoded footer may take in addition to the size of the file, bytes.
const MOST_MEMORY: u64 = 16 << 20;
/// Decoded size of an element of the schema, of a row group, of a column of a row group, and of an
/// element of another list: upper bounds, bytes.
const SIZES: [u64; 4] = [768, 512, 1280, 64];

/// Reads and checks the footer.
///
/// # Errors
/// A file that cannot be read, is no Parquet, is encrypted, or has a damaged footer.
pub(super) fn read(path: &Path, file: &mut File, total: u64) -> Result<ParquetMetaData> {
    let io = |e| Error::io(path, e);
    let bad = |at: u64, found: String, expected: &str| {
        Err(Error::format(path, Location::Byte(at), found, expected))
    };
    if total < 12 {
        let found = format!("{total} bytes");
        return bad(0, found, "a Parquet file of at least 12 bytes");
    }
    let end = total - 8;
    let mut tail = [0; 8];
    file.seek(SeekFrom::Start(end)).map_err(io)?;
    file.read_exact(&mut tail).map_err(io)?;
    match &tail[4..] {
        b"PAR1" => {}
        b"PARE" => {
            let found = "an encrypted footer".to_owned();
            return bad(end, found, "a Parquet file without encryption");
        }
        _ => {
            let found = "no `PAR1` at the end: the file is cut off".to_owned();
            return bad(end, found, WHOLE);
        }
    }
    let length = u32::from_le_bytes([tail[0], tail[1], tail[2], tail[3]]);
    let Some(start) = end.checked_sub(u64::from(length)).filter(|at| *at >= 4) else {
        return bad(end, format!("a footer of {length} bytes"), WHOLE);
    };
    let mut bytes = vec![0; length as usize];
    file.seek(SeekFrom::Start(start)).map_err(io)?;
    file.read_exact(&mut bytes).map_err(io)?;
    let mut walk = Walk {
        bytes: &bytes,
        at: 0,
        counts: [0; 4],
        schema: Vec::new(),
    };
    let walked = walk
        .fields(Place::File, 0)
        .and_then(|()| walk.check_schema());
    if let Err(found) = walked {
        return bad(start + walk.at as u64, found.to_owned(), WHOLE);
    }
    let sizes = walk.counts.iter().zip(SIZES);
    let memory = 3 * u64::from(length) + sizes.map(|(n, size)| n * size).sum::<u64>();
    if memory > MOST_MEMORY + total {
        let [_, groups, chunks, _] = walk.counts;
        let found = format!("a footer with {groups} row groups and {chunks} column chunks");
        return bad(start, found, "fewer and larger row groups");
    }
    let mut options = ParquetMetaDataOptions::new();
    options.set_column_stats_policy(ParquetStatisticsPolicy::SkipAll);
    options.set_size_stats_policy(ParquetStatisticsPolicy::SkipAll);
    options.set_encoding_stats_policy(ParquetStatisticsPolicy::SkipAll);
    ParquetMetaDataReader::decode_metadata_with_options(&bytes, Some(&options))
        .map_err(|e| damaged(path, Location::Byte(start), e))
}

/// Which structure is being walked through.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Place {
    File,
    SchemaElement,
    RowGroup,
    Other,
}

/// What is wrong with the footer.
type Walked<T> = std::result::Result<T, &'static str>;

const CUT_OFF: &str = "a footer that is cut off";

/// A walk through the footer that counts what the library will allocate.
struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Elements of the schema, row groups, columns of row groups, elements of other lists.
    counts: [u64; 4],
    /// The number of children of each element.
    schema: Vec<u32>,
}

impl Walk<'_> {
    fn byte(&mut self) -> Walked<u8> {
        let byte = *self.bytes.get(self.at).ok_or(CUT_OFF)?;
        self.at += 1;
        Ok(byte)
    }

    fn varint(&mut self) -> Walked<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("a number of more than 64 bits")
    }

    fn skip(&mut self, n: u64) -> Walked<()> {
        let left = (self.bytes.len() - self.at) as u64;
        if n > left {
            return Err(CUT_OFF);
        }
        self.at += n as usize;
        Ok(())
    }

    /// The fields of a structure, until its end.
    fn fields(&mut self, place: Place, depth: usize) -> Walked<()> {
        if depth > DEEPEST {
            return Err("structures that are nested too deeply");
        }
        let (mut id, mut children) = (0_i64, 0_u32);
        loop {
            let head = self.byte()?;
            if head == 0 {
                break;
            }
            id = match head >> 4 {
                0 => zigzag(self.varint()?),
                step => id.saturating_add(i64::from(step)),
            };
            match (place, id, head & 0x0f) {
                (Place::SchemaElement, 5, 5) => {
                    children = u32::try_from(zigzag(self.varint()?))
                        .map_err(|_| "a negative number of columns")?;
                }
                (_, _, 1 | 2) => {}
                (Place::File, 2, 9) => self.list(Place::SchemaElement, 0, depth)?,
                (Place::File, 4, 9) => self.list(Place::RowGroup, 1, depth)?,
                (Place::RowGroup, 1, 9) => self.list(Place::Other, 2, depth)?,
                (_, _, kind) => self.value(kind, depth)?,
            }
        }
        if place == Place::SchemaElement {
            self.schema.push(children);
        }
        Ok(())
    }

    fn value(&mut self, kind: u8, depth: usize) -> Walked<()> {
        match kind {
            // In lists a Boolean is a byte.
            1..=3 => self.skip(1),
            4..=6 => self.varint().map(drop),
            7 => self.skip(8),
            8 => {
                let length = self.varint()?;
                self.skip(length)
            }
            9 | 10 => self.list(Place::Other, 3, depth),
            12 => self.fields(Place::Other, depth + 1),
            _ => Err("a field of an unknown type"),
        }
    }

    /// A list whose elements are structures of the kind `place`, or values of any type.
    fn list(&mut self, place: Place, counter: usize, depth: usize) -> Walked<()> {
        if depth > DEEPEST {
            return Err("lists that are nested too deeply");
        }
        let head = self.byte()?;
        let size = match head >> 4 {
            15 => self.varint()?,
            size => u64::from(size),
        };
        // Every element takes at least a byte, so that the loop ends at the end of the bytes.
        for _ in 0..size {
            self.counts[counter] += 1;
            match head & 0x0f {
                12 => self.fields(place, depth + 1)?,
                kind => self.value(kind, depth + 1)?,
            }
        }
        Ok(())
    }

    /// Groups must have the children that they claim, and not be nested too deeply.
    fn check_schema(&self) -> Walked<()> {
        // Children that are still to come, of every open group.
        let mut open: Vec<u32> = Vec::new();
        for (i, &children) in self.schema.iter().enumerate() {
            while open.last() == Some(&0) {
                open.pop();
            }
            match open.last_mut() {
                Some(left) => *left -= 1,
                None if i > 0 => return Err("columns outside the schema"),
                None => {}
            }
            if children as usize > self.schema.len() {
                return Err("a group with more columns than there are");
            }
            if children > 0 {
                open.push(children);
            }
            if open.len() > DEEPEST_SCHEMA {
                return Err("columns that are nested too deeply");
            }
        }
        if open.iter().all(|left| *left == 0) {
            Ok(())
        } else {
            Err("a schema with fewer columns than it claims")
        }
    }
}

fn zigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}
