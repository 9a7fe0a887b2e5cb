//! The rows of tables in an SQLite file (<https://www.sqlite.org/fileformat2.html>), in the order of their numbers. A table
//! is a tree of pages; indices and pages that no table holds are not looked at. Numbers are big-endian.

use crate::error::{Error, Result};

/// The first bytes of a file.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Bytes before the tree of the first page, which is that of the table of tables.
pub(super) const HEADER: usize = 100;
/// Levels of a tree; twenty would hold more rows than a file can.
const DEEPEST: usize = 32;
const LEAF: u8 = 0x0d;
const INNER: u8 = 0x05;

/// The file of a database.
pub(super) trait Source {
    /// Its size in bytes.
    fn total(&self) -> u64;

    /// Moves to a byte; later errors name it.
    fn stand_at(&mut self, start: u64);

    /// Fills `into` from where it stands; the file has as many bytes.
    ///
    /// # Errors
    /// The file cannot be read.
    fn fill(&mut self, into: &mut [u8]) -> Result<()>;

    /// The error of the place where it stands.
    fn damage(&self, found: String, expected: String) -> Error;
}

/// A page of a tree, and the next of its cells.
struct Page {
    /// Its first byte in the file.
    start: u64,
    bytes: Vec<u8>,
    /// Start of the tree in it.
    tree: usize,
    cells: usize,
    next: usize,
}

impl Page {
    fn is_leaf(&self) -> bool {
        self.bytes[self.tree] == LEAF
    }

    fn u16(&self, at: usize) -> Option<usize> {
        let bytes = self.bytes.get(at..at + 2)?;
        Some(usize::from(u16::from_be_bytes([bytes[0], bytes[1]])))
    }

    fn u32(&self, at: usize) -> Option<u32> {
        let bytes: &[u8; 4] = self.bytes.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_be_bytes(*bytes))
    }

    /// The start of a cell.
    fn cell(&self, number: usize) -> Option<usize> {
        let head = if self.is_leaf() { 8 } else { 12 };
        self.u16(self.tree + head + 2 * number)
    }

    /// The page below an inner page that follows on the last one; the cells end with one more page.
    fn child(&self, number: usize) -> Option<u32> {
        if number == self.cells {
            return self.u32(self.tree + 8);
        }
        self.u32(self.cell(number)?)
    }
}

/// The rows of a table that are still to come.
#[derive(Default)]
pub(super) struct Rows {
    /// Bytes of a page.
    page: usize,
    /// Bytes of a page that hold content.
    usable: usize,
    /// Pages of the file.
    pages: u64,
    /// The pages from the root of the table to the current one.
    path: Vec<Page>,
    /// Pages that the table may still have.
    left: u64,
}

impl Rows {
    /// Reads the header of a file of `total` bytes; `None` if its pages have an impossible size.
    pub(super) fn of(header: &[u8], total: u64) -> Option<Self> {
        let page = match u16::from_be_bytes([*header.get(16)?, *header.get(17)?]) {
            1 => 1 << 16,
            size => usize::from(size),
        };
        let usable = page.checked_sub(usize::from(*header.get(20)?))?;
        // The least size that the format allows.
        let is_size = page.is_power_of_two() && page >= 512 && usable >= 480;
        is_size.then(|| Self {
            page,
            usable,
            pages: total / page as u64,
            ..Self::default()
        })
    }

    /// Begins with the table whose tree has this root.
    pub(super) fn begin(&mut self, file: &mut dyn Source, root: u32) -> Result<()> {
        self.path.clear();
        self.left = self.pages;
        self.descend(file, root)
    }

    /// Reads a page of the tree.
    fn descend(&mut self, file: &mut dyn Source, number: u32) -> Result<()> {
        let (start, bytes) = self.read(file, number)?;
        let tree = if number == 1 { HEADER } else { 0 };
        let mut page = Page {
            start,
            bytes,
            tree,
            cells: 0,
            next: 0,
        };
        page.cells = page.u16(tree + 3).unwrap_or_default();
        let head = if page.is_leaf() { 8 } else { 12 };
        let is_tree =
            matches!(page.bytes[tree], LEAF | INNER) && tree + head + 2 * page.cells <= self.usable;
        if !is_tree || self.path.len() == DEEPEST {
            let (found, expected) = ("a page of another kind", "a page of a table");
            return Err(file.damage(found.into(), expected.into()));
        }
        self.path.push(page);
        Ok(())
    }

    /// The start and the bytes of a page, none of which belongs to a table twice.
    fn read(&mut self, file: &mut dyn Source, number: u32) -> Result<(u64, Vec<u8>)> {
        if !(1..=self.pages).contains(&u64::from(number)) {
            return Err(file.damage(
                format!("page {number} of a table"),
                format!("at most {}, as many as the file has", self.pages),
            ));
        }
        let start = (u64::from(number) - 1) * self.page as u64;
        file.stand_at(start);
        if self.left == 0 {
            self.path.clear();
            let found = "a page that is in the table twice";
            return Err(file.damage(found.into(), "another page".into()));
        }
        self.left -= 1;
        let mut bytes = vec![0; self.page];
        file.fill(&mut bytes)?;
        Ok((start, bytes))
    }

    /// The number of the next row, whose record is put into `record`: without what lies on pages of its own if it
    /// `is_skimmed`. `None` after the last row.
    ///
    /// # Errors
    /// A damaged page or row, after which the next call goes on.
    pub(super) fn next(
        &mut self,
        file: &mut dyn Source,
        is_skimmed: bool,
        record: &mut Vec<u8>,
    ) -> Result<Option<i64>> {
        loop {
            let Some(page) = self.path.last_mut() else {
                return Ok(None);
            };
            let number = page.next;
            page.next += 1;
            file.stand_at(page.start);
            if page.is_leaf() && number < page.cells {
                return self.row(file, number, is_skimmed, record).map(Some);
            }
            if page.is_leaf() || number > page.cells {
                self.path.pop();
                continue;
            }
            match page.child(number) {
                Some(child) => self.descend(file, child)?,
                None => return Err(damaged(file)),
            }
        }
    }

    /// The row of a cell of the last page: size of the record, number of the row, record, and the page on which it
    /// continues.
    fn row(
        &mut self,
        file: &mut dyn Source,
        number: usize,
        is_skimmed: bool,
        record: &mut Vec<u8>,
    ) -> Result<i64> {
        record.clear();
        let cell = || {
            let page = self.path.last()?;
            let mut cell = page.bytes.get(page.cell(number)?..self.usable)?;
            let size = varint(&mut cell)?;
            let row = varint(&mut cell)?.cast_signed();
            let size = usize::try_from(size).ok()?;
            // A record lies in the file, so it is no larger.
            let local = self.local(size).filter(|_| size as u64 <= file.total())?;
            let (local, rest) = cell.split_at_checked(local)?;
            let next = rest.first_chunk().map(|next| u32::from_be_bytes(*next));
            Some((size, row, local, next))
        };
        let Some((size, row, local, mut next)) = cell() else {
            return Err(damaged(file));
        };
        record.extend_from_slice(local);
        while record.len() < size && !is_skimmed {
            let Some(number) = next else {
                return Err(damaged(file));
            };
            let (_, bytes) = self.read(file, number)?;
            let part = &bytes[4..self.usable];
            record.extend_from_slice(&part[..part.len().min(size - record.len())]);
            next = bytes.first_chunk().map(|next| u32::from_be_bytes(*next));
        }
        Ok(row)
    }

    /// The part of a record of this size that lies in its cell, bytes.
    fn local(&self, size: usize) -> Option<usize> {
        let most = self.usable - 35;
        if size <= most {
            return Some(size);
        }
        let least = (self.usable - 12) * 32 / 255 - 23;
        let local = least + (size - least) % (self.usable - 4);
        Some(if local <= most { local } else { least })
    }
}

fn damaged(file: &dyn Source) -> Error {
    file.damage("a damaged page of a table".into(), "whole rows".into())
}

/// A number in one to nine bytes: seven bits of each but of the ninth, whose eight all count.
fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for at in 0..9 {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        if at == 8 {
            return Some(number << 8 | u64::from(*byte));
        }
        number = number << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            break;
        }
    }
    Some(number)
}

/// A value of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'a> {
    Integer(i64),
    /// A text or bytes, of a skimmed record as far as they were read.
    Bytes(&'a [u8]),
    /// Nothing, and numbers with a fraction, which no recording has.
    Other,
}

impl<'a> Value<'a> {
    pub(super) fn integer(self) -> Option<i64> {
        match self {
            Self::Integer(number) => Some(number),
            _ => None,
        }
    }

    pub(super) fn bytes(self) -> Option<&'a [u8]> {
        match self {
            Self::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }
}

/// The first values of a record; `None` if it has fewer.
pub(super) fn values<const N: usize>(record: &[u8]) -> Option<[Value<'_>; N]> {
    let mut head = record;
    let size = usize::try_from(varint(&mut head)?).ok()?;
    let mut body = record.get(size..)?;
    let mut head = head.get(..size - (record.len() - head.len()))?;
    let mut values = [Value::Other; N];
    for value in &mut values {
        let kind = varint(&mut head)?;
        let length = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return None,
            _ => (kind - 12) / 2,
        };
        let length = usize::try_from(length).ok()?;
        let (bytes, rest) = body.split_at(length.min(body.len()));
        body = rest;
        *value = match kind {
            1..=6 => Value::Integer(signed(bytes)),
            8 => Value::Integer(0),
            9 => Value::Integer(1),
            12.. => Value::Bytes(bytes),
            _ => Value::Other,
        };
    }
    Some(values)
}

/// A signed number of up to eight bytes.
fn signed(bytes: &[u8]) -> i64 {
    let start = if bytes.first().is_some_and(|byte| byte & 0x80 != 0) {
        -1
    } else {
        0
    };
    bytes
        .iter()
        .fold(start, |number, byte| number << 8 | i64::from(*byte))
}
