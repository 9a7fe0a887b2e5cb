//! The header of a LAS file, checked against the size of the file before a decoder relies on it, and corrected where
//! the decoder would read it wrongly.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::binary::bytes_at;
use crate::format::input::{Input, Stream};

/// Bytes of the header of LAS 1.4, and the fewest of any version.
const HEADER: usize = 375;
const SHORTEST_HEADER: usize = 227;
/// Bytes before the data of a record between header and points.
const RECORD_HEAD: u64 = 54;
/// More points than any chunk of a compressed file contains; real files have 50,000.
const LARGEST_CHUNK: u64 = 100_000_000;
/// The points of a compressed file unpack to at most this many times its size, plus `ALWAYS_BYTES`: a file that
/// claims more was made to keep the reader busy.
const MOST_EXPANDED: u64 = 250;
const ALWAYS_BYTES: u64 = 8 << 20;
/// Bit of the global encoding of LAS 1.5: times are relative to an offset in the header.
const TIME_OFFSET_BIT: u16 = 1 << 6;

/// A LAS file whose header is corrected.
pub(super) struct Corrected {
    stream: Stream,
    at: u64,
    head: Vec<u8>,
}

impl Read for Corrected {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.stream.read(into)?;
        let from = self.head.len().min(self.at as usize);
        let to = self.head.len().min(self.at as usize + read);
        into[..to - from].copy_from_slice(&self.head[from..to]);
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Corrected {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.stream.seek(to)?;
        Ok(self.at)
    }
}

/// A file with a checked header.
pub(super) struct Checked {
    pub(super) content: Corrected,
    /// Size of the file, bytes.
    pub(super) bytes: u64,
    /// What was corrected.
    pub(super) remarks: Vec<String>,
}

/// Opens a file and checks its header against its size.
///
/// # Errors
/// A file that ends early or whose header contradicts itself.
pub(super) fn open(input: &Input) -> Result<Checked> {
    let (mut stream, size) = input.open()?;
    let path = input.path();
    let mut head = vec![0; HEADER.min(size as usize)];
    stream
        .read_exact(&mut head)
        .map_err(|e| Error::io(path, e))?;
    let mut remarks = correct(path, &mut head, size)?;
    check(path, &mut stream, &head, size)?;
    remarks.extend(remark_on_rest(&head, size));
    stream.rewind().map_err(|e| Error::io(path, e))?;
    Ok(Checked {
        content: Corrected {
            stream,
            at: 0,
            head,
        },
        bytes: size,
        remarks,
    })
}

fn short(path: &Path, size: u64, at: u64, what: &str) -> Error {
    Error::format(
        path,
        Location::Byte(at),
        format!("a LAS file of {size} bytes that ends before {what}"),
        "a complete LAS or LAZ file",
    )
}

/// Changes what the decoder would read wrongly; returns what that was.
fn correct(path: &Path, head: &mut [u8], size: u64) -> Result<Vec<String>> {
    let mut remarks = Vec::new();
    let minor = if head.len() < SHORTEST_HEADER {
        0
    } else {
        head[25]
    };
    if head.len() < SHORTEST_HEADER || head.len() < HEADER && minor >= 4 {
        return Err(short(path, size, size, "its header does"));
    }
    if minor < 4 {
        return Ok(remarks);
    }
    let encoding = u16::from_le_bytes(bytes_at(head, 6));
    if minor == 5 {
        if encoding & TIME_OFFSET_BIT != 0 {
            return Err(Error::format(
                path,
                Location::Byte(6),
                "LAS 1.5 with GPS times relative to a time offset of the header",
                "GPS times of the week or adjusted standard GPS times: convert the file to LAS 1.4",
            ));
        }
        // Its header begins as that of 1.4, and its points have the same formats.
        head[25] = 4;
    }
    let legacy = u64::from(u32::from_le_bytes(bytes_at(head, 107)));
    let count = u64::from_le_bytes(bytes_at(head, 247));
    if count > 0 {
        if legacy > 0 && legacy != count {
            remarks.push(format!(
                "the header gives {count} points (64 bits) and {legacy} (32 bits, for old readers): {count} are read"
            ));
        }
        // The decoder prefers the legacy counts.
        head[107..131].fill(0);
    }
    Ok(remarks)
}

/// What to say of an uncompressed file with room for more points than its header announces.
fn remark_on_rest(head: &[u8], size: u64) -> Option<String> {
    let u32_at = |at| u64::from(u32::from_le_bytes(bytes_at(head, at)));
    let (minor, data) = (head[25], u32_at(96));
    let length = u64::from(u16::from_le_bytes(bytes_at(head, 105)));
    if head[104] & 0x80 != 0 || length == 0 {
        return None;
    }
    // Waveforms and extended records follow the points.
    let u64_at = |at: usize, since: u8| {
        let has = minor >= since && head.len() >= at + 8;
        has.then(|| u64::from_le_bytes(bytes_at(head, at)))
    };
    let ends = [u64_at(227, 3), u64_at(235, 4), Some(size)];
    let end = ends
        .into_iter()
        .flatten()
        .filter(|end| *end > data && *end <= size)
        .min()?;
    let points = announced(head);
    let room = (end - data) / length;
    (room > points && points > 0).then(|| {
        format!(
            "left out: {} points beyond the {points} points of the header, for which the file has room",
            room - points
        )
    })
}

/// The number of points in a header.
fn announced(head: &[u8]) -> u64 {
    match (u32::from_le_bytes(bytes_at(head, 107)), head[25] >= 4) {
        (0, true) => u64::from_le_bytes(bytes_at(head, 247)),
        (n, _) => u64::from(n),
    }
}

/// Checks sizes and positions in the header against the size of the file.
fn check(path: &Path, file: &mut Stream, head: &[u8], size: u64) -> Result<()> {
    let minor = head[25];
    let u32_at = |at| u64::from(u32::from_le_bytes(bytes_at(head, at)));
    let u64_at = |at| u64::from_le_bytes(bytes_at(head, at));
    let data = u32_at(96);
    if data > size {
        return Err(short(path, size, 96, "its points begin"));
    }
    let first_record = u64::from(u16::from_le_bytes(bytes_at(head, 94)));
    check_records(path, file, first_record..data, u32_at(100))?;
    let compressed = head[104] & 0x80 != 0;
    let length = u64::from(u16::from_le_bytes(bytes_at(head, 105)));
    let points = announced(head);
    if !compressed && points.saturating_mul(length) > size - data {
        return Err(short(path, size, 107, &format!("its {points} points do")));
    }
    let most = size
        .saturating_mul(MOST_EXPANDED)
        .saturating_add(ALWAYS_BYTES);
    if compressed && points.saturating_mul(length) > most {
        return Err(Error::format(
            path,
            Location::Byte(107),
            format!("{points} points of {length} bytes in a file of {size} bytes"),
            format!("{most} bytes of points at most in a file of this size"),
        ));
    }
    if compressed {
        check_chunk_table(path, file, data, size, points)?;
    }
    if minor >= 4 {
        check_extended_records(path, file, (u64_at(235), u32_at(243)), size)?;
    }
    Ok(())
}

/// Checks that the records between the header and the points end before the points begin.
fn check_records(
    path: &Path,
    file: &mut Stream,
    within: std::ops::Range<u64>,
    count: u64,
) -> Result<()> {
    let mut at = within.start;
    for record in 1..=count {
        let mut length = [0; 2];
        let mut end = at.saturating_add(RECORD_HEAD);
        if end <= within.end {
            file.seek(SeekFrom::Start(at + 20))
                .and_then(|_| file.read_exact(&mut length))
                .map_err(|e| Error::io(path, e))?;
            end += u64::from(u16::from_le_bytes(length));
        }
        if end > within.end {
            return Err(Error::format(
                path,
                Location::Byte(100),
                format!(
                    "{count} variable-length records in the {} bytes between the header and the points, of which \
                     number {record} does not fit",
                    within.end.saturating_sub(within.start)
                ),
                format!(
                    "records that end before the points begin at byte {}: is this number wrong?",
                    within.end
                ),
            ));
        }
        at = end;
    }
    Ok(())
}

/// Checks the position and length of the table of compressed chunks.
fn check_chunk_table(
    path: &Path,
    file: &mut Stream,
    data: u64,
    size: u64,
    points: u64,
) -> Result<()> {
    let mut read_at = |at: u64| -> Result<[u8; 8]> {
        let mut bytes = [0; 8];
        file.seek(SeekFrom::Start(at))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof => Error::format(
                    path,
                    Location::Byte(size),
                    "the end of the file",
                    "compressed points and the table of their chunks",
                ),
                _ => Error::io(path, e),
            })?;
        Ok(bytes)
    };
    let mut table = i64::from_le_bytes(read_at(data)?);
    if table <= data as i64 {
        table = i64::from_le_bytes(read_at(size.saturating_sub(8))?);
    }
    if table <= data as i64 {
        return Ok(());
    }
    let head = read_at(table as u64)?;
    let chunks = u64::from(u32::from_le_bytes(bytes_at(&head, 4)));
    // A chunk takes at least a byte, and no writer makes more chunks than there are points.
    if chunks > size.min(points.max(1)) || points > chunks.max(1) * LARGEST_CHUNK {
        return Err(Error::format(
            path,
            Location::Byte(table as u64 + 4),
            format!("{chunks} compressed chunks for {points} points"),
            "a table of chunks that fits the file",
        ));
    }
    Ok(())
}

/// Checks that extended records, which are read into memory, end within the file.
fn check_extended_records(
    path: &Path,
    file: &mut Stream,
    (first, count): (u64, u64),
    size: u64,
) -> Result<()> {
    const HEAD: u64 = 60;
    let mut at = first;
    for record in 0..count {
        let mut head = [0; HEAD as usize];
        let error = |found: String| {
            let expected = "an extended record that ends within the file";
            Error::format(path, Location::Byte(at), found, expected)
        };
        if at.saturating_add(HEAD) > size {
            return Err(error(format!(
                "extended record {record} of {count} beyond the end"
            )));
        }
        file.seek(SeekFrom::Start(at))
            .and_then(|_| file.read_exact(&mut head))
            .map_err(|e| Error::io(path, e))?;
        let length = u64::from_le_bytes(bytes_at(&head, 20));
        let end = at.saturating_add(HEAD).saturating_add(length);
        if end > size {
            return Err(error(format!("an extended record of {length} bytes")));
        }
        at = end;
    }
    Ok(())
}
