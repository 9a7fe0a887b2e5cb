//! The records of a bag, one after another from the start of the file.

use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::records::{Cursor, Kind, Raw, Record};
use super::{db3, mcap, rosbag, split, sqlite};
use crate::error::{Error, Location, Result};
use crate::format::input::{Input, Stream};

/// The kinds of bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Container {
    /// MCAP.
    Mcap,
    /// ROS 1, version 2.0.
    Rosbag,
    /// ROS 2 as SQLite, whose records are rows and not in chunks.
    Db3,
}

impl Container {
    /// Takes the next record of an unpacked chunk.
    pub(super) fn split<'a>(self, bytes: &mut Cursor<'a>) -> Option<Raw<'a>> {
        match self {
            Self::Mcap => mcap::split(bytes),
            Self::Rosbag => rosbag::split(bytes),
            Self::Db3 => None,
        }
    }

    /// The content of a record.
    fn parse(self, raw: Raw<'_>) -> Option<Record<'_>> {
        match self {
            Self::Mcap => mcap::parse(raw),
            Self::Rosbag => rosbag::parse(raw),
            Self::Db3 => db3::parse(raw),
        }
    }
}

/// A bag being read.
pub(super) struct Walk {
    input: Input,
    reader: BufReader<Stream>,
    /// Its kind.
    pub(super) container: Container,
    /// Start of the record of the last step, bytes.
    pub(super) start: u64,
    /// Start of the first record, bytes.
    first: u64,
    /// Start of the next record, bytes.
    pub(super) at: u64,
    /// End of the last record of the file, bytes.
    end: u64,
    /// Size of the file in bytes.
    total: u64,
    /// From this byte on, records may be cut off, because the recording was not finished or not copied
    /// completely. Before it, a record that is cut off is damage.
    may_be_cut_from: u64,
    /// Bytes of all chunks unpacked so far.
    pub(super) unpacked: u64,
    /// Whether the file ended in the middle of the last record.
    pub(super) is_cut: bool,
    /// Damaged places that were passed over: their number, and the first.
    pub(super) damage: (u64, Option<Error>),
    /// The tables of SQLite.
    pub(super) tables: db3::Tables,
    pub(super) kind: Kind,
    pub(super) head: Vec<u8>,
    /// The data of the last record, if its kind was wanted.
    pub(super) data: Vec<u8>,
}

impl Walk {
    /// Opens a file at its first record.
    pub(super) fn open(input: &Input) -> Result<Self> {
        let (mut file, total) = input.open()?;
        let start = input.first_bytes(&mut file)?;
        let container = if start.starts_with(mcap::MAGIC) {
            Container::Mcap
        } else if start.starts_with(rosbag::MAGIC) {
            Container::Rosbag
        } else if start.starts_with(sqlite::MAGIC) {
            Container::Db3
        } else if start.starts_with(split::START) {
            return Err(Error::format(
                input.path(),
                Location::Whole,
                "the list of the files of a recording",
                "one of the files, each by itself",
            ));
        } else {
            let first = String::from_utf8_lossy(&start[..start.len().min(13)]);
            return Err(Error::format(
                input.path(),
                Location::Byte(0),
                format!("{:?}", first.trim_end()),
                "an MCAP file, a .db3 of ROS 2, or a ROS 1 bag of version 2.0",
            ));
        };
        let mut walk = Self {
            input: input.clone(),
            reader: BufReader::with_capacity(1 << 18, file),
            container,
            start: 0,
            first: 0,
            at: 0,
            end: total,
            total,
            may_be_cut_from: 0,
            unpacked: 0,
            is_cut: false,
            damage: (0, None),
            tables: db3::Tables::default(),
            kind: Kind::Other,
            head: Vec::new(),
            data: Vec::new(),
        };
        match container {
            Container::Mcap => walk.find_end_of_mcap()?,
            Container::Rosbag => walk.find_index_of_rosbag()?,
            Container::Db3 => walk.find_tables()?,
        }
        walk.first = walk.at;
        Ok(walk)
    }

    /// Finds the end of the records: a complete MCAP file repeats its first bytes at the end.
    fn find_end_of_mcap(&mut self) -> Result<()> {
        let size = mcap::MAGIC.len() as u64;
        if let Some(end) = self.total.checked_sub(size).filter(|end| *end >= size) {
            self.seek(end)?;
            let mut last = [0; 8];
            self.fill(&mut last)?;
            if last == mcap::MAGIC {
                self.end = end;
                self.may_be_cut_from = u64::MAX;
            }
        }
        self.seek(size)
    }

    /// Finds the index: the first record of a ROS 1 bag has its position.
    fn find_index_of_rosbag(&mut self) -> Result<()> {
        let first = rosbag::MAGIC.len() as u64;
        self.seek(first)?;
        self.start = first;
        let index = self.prefix()?.and_then(|_| rosbag::index_start(&self.head));
        match index {
            Some(index) if index < self.total => self.may_be_cut_from = index,
            Some(_) => {}
            None => return Err(self.error("another record", "the header of a bag")),
        }
        self.seek(first)
    }

    /// Continues at byte `at`.
    pub(super) fn seek(&mut self, at: u64) -> Result<()> {
        let sought = match i64::try_from(i128::from(at) - i128::from(self.at)) {
            Ok(by) => self.reader.seek_relative(by),
            Err(_) => self.reader.seek(SeekFrom::Start(at)).map(|_| ()),
        };
        sought.map_err(|e| Error::io(self.input.path(), e))?;
        self.at = at;
        Ok(())
    }

    /// Fills `into`; the file must have as many bytes.
    fn fill(&mut self, into: &mut [u8]) -> Result<()> {
        self.reader
            .read_exact(into)
            .map_err(|e| Error::io(self.input.path(), e))?;
        self.at += into.len() as u64;
        Ok(())
    }

    /// Number of bytes up to the end of the last record.
    fn left(&self) -> u64 {
        self.end.saturating_sub(self.at)
    }

    /// Reads a number of 32 bits; `None` at the end of the records.
    fn length(&mut self) -> Result<Option<u32>> {
        if self.left() < 4 {
            return Ok(None);
        }
        let mut word = [0; 4];
        self.fill(&mut word)?;
        Ok(Some(u32::from_le_bytes(word)))
    }

    /// Reads the header of the next record and returns its kind and the length of its data; `None` if the
    /// header is not complete.
    fn prefix(&mut self) -> Result<Option<(Kind, u64)>> {
        self.head.clear();
        match self.container {
            Container::Mcap => {
                if self.left() < mcap::PREFIX as u64 {
                    return Ok(None);
                }
                let mut bytes = [0; mcap::PREFIX];
                self.fill(&mut bytes)?;
                Ok(mcap::prefix(Cursor(&bytes)))
            }
            Container::Rosbag => {
                let length = self.length()?;
                let longest = self.left().min(rosbag::LONGEST_HEADER.into());
                let Some(length) = length.filter(|n| u64::from(*n) <= longest) else {
                    return Ok(None);
                };
                let mut head = vec![0; length as usize];
                self.fill(&mut head)?;
                self.head = head;
                let data = self.length()?;
                let kind = rosbag::kind(&self.head);
                Ok(kind.zip(data.map(u64::from)))
            }
            Container::Db3 => Ok(None),
        }
    }

    /// Advances to the next record and reads its data if its kind is `wanted`. `None` at the end of the
    /// file, at the end of its messages, or where the file is cut off.
    pub(super) fn step(&mut self, wanted: &[Kind]) -> Result<Option<Kind>> {
        if self.container == Container::Db3 {
            return self.step_row(wanted);
        }
        self.start = self.at;
        if self.is_cut || self.left() == 0 {
            return Ok(None);
        }
        let may_be_cut = self.start >= self.may_be_cut_from;
        let Some((kind, mut length)) = self.prefix()? else {
            if may_be_cut {
                self.is_cut = true;
                return Ok(None);
            }
            let error = self.error("bytes that are not a record", "a record");
            return self.stop(error, wanted);
        };
        let left = self.left();
        // The recorder of ROS 1 writes the length of a chunk only when the chunk is complete.
        if may_be_cut && kind == Kind::Chunk && length == 0 && self.is_packed() {
            length = u64::MAX;
        }
        if length > left {
            if !may_be_cut {
                let error = self.error(
                    format!("only {left} bytes left in the file"),
                    format!("{length} bytes of a record"),
                );
                return self.stop(error, wanted);
            }
            self.is_cut = true;
            if kind != Kind::Chunk {
                return Ok(None);
            }
            length = left;
        }
        self.kind = kind;
        self.data.clear();
        if wanted.contains(&kind) {
            let size = usize::try_from(length).map_err(|_| self.too_large(length))?;
            let mut data = std::mem::take(&mut self.data);
            data.resize(size, 0);
            self.fill(&mut data)?;
            self.data = data;
        } else {
            self.seek(self.at + length)?;
        }
        Ok(Some(kind))
    }

    /// Whether a chunk of a ROS 1 bag is compressed according to its header. The records of an incomplete
    /// chunk without compression are read like records outside of chunks.
    fn is_packed(&self) -> bool {
        rosbag::chunk_head(&self.head).is_some_and(|head| head.compression != b"none")
    }

    /// The content of the last record, whose data were read; `None` if the content does not fit its kind.
    pub(super) fn record(&self) -> Option<Record<'_>> {
        self.container.parse(Raw {
            kind: self.kind,
            head: &self.head,
            data: &self.data,
        })
    }

    /// Swaps the data of the last record, which were read, with `into`.
    pub(super) fn swap_data(&mut self, into: &mut Vec<u8>) {
        std::mem::swap(&mut self.data, into);
    }

    /// The content of a record from a chunk; `None`, and a damaged place, if it cannot be read.
    pub(super) fn parse<'a>(&mut self, raw: Raw<'a>) -> Option<Record<'a>> {
        let record = self.container.parse(raw);
        if record.is_none() {
            let error = self.unreadable(raw.kind);
            self.pass_over(error);
        }
        record
    }

    /// Goes on after a damaged record at the next chunk of an MCAP file, or ends there.
    ///
    /// # Errors
    /// Nothing was read before, and nothing can be read after it.
    fn stop(&mut self, error: Error, wanted: &[Kind]) -> Result<Option<Kind>> {
        let is_first = self.start <= self.first;
        let has_more = self.container == Container::Mcap && self.find_chunk(self.start + 1)?;
        if is_first && !has_more {
            return Err(error);
        }
        self.pass_over(error);
        if has_more {
            return self.step(wanted);
        }
        self.end = self.start;
        self.seek(self.start)?;
        Ok(None)
    }

    /// Fills `into` from byte `at`; the file must have as many bytes.
    pub(super) fn read_at(&mut self, at: u64, into: &mut [u8]) -> Result<()> {
        self.seek(at)?;
        self.fill(into)
    }

    /// End of the last record of the file, bytes.
    pub(super) fn end(&self) -> u64 {
        self.end
    }

    /// The error for a record whose content does not fit its kind.
    pub(super) fn unreadable(&self, kind: Kind) -> Error {
        self.error(
            format!("a record ({kind:?}) that ends early or lacks a field"),
            "a complete record",
        )
    }

    /// A format error at the last record.
    pub(super) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::format(
            self.input.path(),
            Location::Byte(self.start),
            found,
            expected,
        )
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        self.input.path()
    }

    /// The file, for remarks.
    pub(super) fn input(&self) -> &Input {
        &self.input
    }

    /// Bytes read so far.
    pub(super) fn bytes_read(&self) -> u64 {
        match self.container {
            Container::Db3 => self.tables.farthest,
            Container::Mcap | Container::Rosbag => self.at,
        }
    }

    /// Size of the file in bytes.
    pub(super) fn bytes_total(&self) -> u64 {
        self.total
    }
}
