//! Copies of damaged recordings without what cannot be read.

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use super::records::{Cursor, Kind, Raw};
use super::walk::{Container, Walk};
use super::{mcap, rosbag};
use crate::error::{Error, Result};
use crate::format::input::{Input, Stream};

/// What a copy of a recording holds and lacks.
#[derive(Debug, Default)]
pub(crate) struct Copied {
    /// Messages in the copy.
    pub(crate) messages: u64,
    /// Start and length of each place that was left out, bytes.
    pub(crate) left_out: Vec<(u64, u64)>,
}

const ALL: [Kind; 7] = [
    Kind::Schema,
    Kind::Channel,
    Kind::Message,
    Kind::Chunk,
    Kind::Index,
    Kind::End,
    Kind::Other,
];

/// Copies the records of a recording that are whole, chunks as they are. The index of the whole file, which does not
/// fit the copy, is left out: readers find the messages without it, and `mcap recover` or `rosbag reindex` adds one.
///
/// # Errors
/// Files that cannot be read or written; another format.
pub(crate) fn copy(input: &Input, to: &Path) -> Result<Copied> {
    let mut walk = Walk::open(input)?;
    if walk.container == Container::Db3 {
        return Err(walk.error(
            "a recording in SQLite",
            "a bag or an MCAP file; sqlite3 FILE .recover salvages SQLite",
        ));
    }
    let (mut from, _) = input.open()?;
    let out = File::create(to).map_err(|e| Error::io(to, e))?;
    let mut out = Copy {
        out: BufWriter::with_capacity(1 << 20, out),
        to,
        copied: Copied::default(),
    };
    let is_mcap = walk.container == Container::Mcap;
    out.write(if is_mcap { mcap::MAGIC } else { rosbag::MAGIC })?;
    let mut block = Vec::new();
    let mut is_chunk_whole = true;
    let mut end = walk.bytes_read();
    while let Some(kind) = walk.step(&ALL)? {
        out.leave_out(end, walk.start);
        end = walk.bytes_read();
        let range = (walk.start, end);
        if kind == Kind::End {
            break;
        }
        match kind {
            Kind::Chunk => {
                is_chunk_whole = false;
                match walk.unpack_whole(&mut block)? {
                    Ok(start) if !walk.is_cut => {
                        is_chunk_whole = true;
                        out.copied.messages += messages(walk.container, &block[start..]);
                        out.copy(&mut from, range, input)?;
                    }
                    // What is readable of the last chunk is copied record by record, out of its chunk.
                    Ok(start) if is_mcap => {
                        let rest = out.records(&block[start..])?;
                        // How much of a compressed chunk is missing is not known.
                        let start = range.1.saturating_sub(rest.max(1));
                        out.leave_out(range.0.max(start), range.1);
                    }
                    _ => out.leave_out(range.0, range.1),
                }
            }
            Kind::Index if !is_chunk_whole => out.leave_out(range.0, range.1),
            Kind::Schema | Kind::Channel | Kind::Message | Kind::Index
                if walk.record().is_none() =>
            {
                out.leave_out(range.0, range.1);
            }
            Kind::Other if !is_mcap => {
                // The header of a bag, without the position of its index; the summary of its chunks is left out.
                if let Some(head) = rosbag::without_index(&walk.head) {
                    out.sized(&head)?;
                    out.sized(&walk.data)?;
                }
            }
            _ => {
                out.copied.messages += u64::from(kind == Kind::Message);
                out.copy(&mut from, range, input)?;
            }
        }
    }
    if walk.is_cut || walk.take_damage().is_some() {
        out.leave_out(end, walk.bytes_total());
    }
    if is_mcap {
        out.write(&mcap::end())?;
    }
    out.out.flush().map_err(|e| Error::io(to, e))?;
    Ok(out.copied)
}

/// The number of messages in the records of a chunk.
fn messages(container: Container, records: &[u8]) -> u64 {
    let mut rest = Cursor(records);
    let mut count = 0;
    while let Some(Raw { kind, .. }) = container.split(&mut rest) {
        count += u64::from(kind == Kind::Message);
    }
    count
}

/// A copy being written.
struct Copy<'a> {
    out: BufWriter<File>,
    to: &'a Path,
    copied: Copied,
}

impl Copy<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(|e| Error::io(self.to, e))
    }

    /// Writes bytes after their number.
    fn sized(&mut self, bytes: &[u8]) -> Result<()> {
        self.write(&(bytes.len() as u32).to_le_bytes())?;
        self.write(bytes)
    }

    /// Copies the bytes between two places of the recording.
    fn copy(&mut self, from: &mut Stream, (start, end): (u64, u64), input: &Input) -> Result<()> {
        let failed = |e| Error::io(input.path(), e);
        from.seek(SeekFrom::Start(start)).map_err(failed)?;
        let mut part = from.take(end - start);
        std::io::copy(&mut part, &mut self.out).map_err(|e| Error::io(self.to, e))?;
        Ok(())
    }

    /// Copies the schemas, channels and messages of an unpacked chunk of MCAP; returns the number of bytes behind the last
    /// whole record.
    fn records(&mut self, records: &[u8]) -> Result<u64> {
        let mut rest = Cursor(records);
        loop {
            let left = rest.0.len() as u64;
            let Some(raw) = Container::Mcap.split(&mut rest) else {
                return Ok(left);
            };
            if let Some(record) = mcap::whole_record(raw) {
                self.write(&record)?;
                self.copied.messages += u64::from(raw.kind == Kind::Message);
            }
        }
    }

    /// Notes the bytes between two places as left out; places that touch are one.
    fn leave_out(&mut self, start: u64, end: u64) {
        if end <= start {
            return;
        }
        match self.copied.left_out.last_mut() {
            Some((before, length)) if *before + *length == start => *length += end - start,
            _ => self.copied.left_out.push((start, end - start)),
        }
    }
}
