//! Defensive reading of LAS and LAZ: a damaged header must not exhaust memory, damaged points must
//! not cause a panic.

use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::file::guarded;
use crate::format::input::{Input, Stream};
use crate::format::las::chunks as laz_chunks;
use crate::geometry::Vec3;

/// More points than any chunk of a compressed file contains; real files have 50,000.
const LARGEST_CHUNK: u64 = 100_000_000;
/// The points of a compressed file unpack to at most this many times its size, plus `ALWAYS_BYTES`: a file that
/// claims more was made to keep the reader busy.
const MOST_EXPANDED: u64 = 250;
const ALWAYS_BYTES: u64 = 8 << 20;
/// Bytes of points decoded at a time, by each thread; a record may have 65,535 bytes.
const LARGEST_PIECE: usize = 8 << 20;

/// A decoded point with its optional values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LasPoint<'a> {
    pub(crate) position: Vec3,
    pub(crate) time_s: f64,
    pub(crate) intensity: f32,
    /// The bytes after the standard fields.
    pub(crate) extra: &'a [u8],
    /// All bytes as in an uncompressed file.
    pub(crate) record: &'a [u8],
}

/// An open LAS or LAZ file.
pub(crate) struct LasFile {
    input: Input,
    reader: las::Reader,
    /// Whether the reader unpacks chunks on all threads.
    is_parallel: bool,
    points: las::PointData,
    /// Which of the decoded points have not been taken.
    ready: Range<usize>,
    taken: u64,
    bytes: u64,
}

fn problem(path: &Path, error: las::Error) -> Error {
    Error::format(
        path,
        Location::Whole,
        error.to_string(),
        "an undamaged LAS or LAZ file",
    )
}

impl LasFile {
    /// Chunks of different sizes, as in COPC, are unpacked on all threads.
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let file = Self::reopen(input)?;
        if laz_chunks::check(input, file.header(), file.bytes)? {
            return Self::with(input, las::LazParallelism::Yes);
        }
        Ok(file)
    }

    /// As [`open`](Self::open) where the chunks were checked, or only the header is read; unpacks on one thread.
    pub(crate) fn reopen(input: &Input) -> Result<Self> {
        // Sequential decompression does not allocate memory based on a chunk table, which may be
        // damaged.
        Self::with(input, las::LazParallelism::No)
    }

    fn with(input: &Input, parallelism: las::LazParallelism) -> Result<Self> {
        let (mut file, bytes) = input.open()?;
        check_header(input.path(), &mut file, bytes)?;
        guarded(input.path(), "LAS or LAZ", || {
            let options = las::ReaderOptions::default().with_laz_parallelism(parallelism);
            let reader = las::Reader::with_options(BufReader::new(file), options)
                .map_err(|e| problem(input.path(), e))?;
            let points = las::PointDataBuilder::new()
                .for_header(reader.header())
                .build();
            Ok(Self {
                input: input.clone(),
                reader,
                is_parallel: matches!(parallelism, las::LazParallelism::Yes),
                points,
                ready: 0..0,
                taken: 0,
                bytes,
            })
        })
    }

    pub(crate) fn input(&self) -> &Input {
        &self.input
    }

    pub(crate) fn path(&self) -> &Path {
        self.input.path()
    }

    pub(crate) fn header(&self) -> &las::Header {
        self.reader.header()
    }

    pub(crate) fn has_time(&self) -> bool {
        self.header().point_format().has_gps_time
    }

    pub(crate) fn taken(&self) -> u64 {
        self.taken
    }

    pub(crate) fn bytes_total(&self) -> u64 {
        self.bytes
    }

    /// Whether [`LasFile::seek`] works: the decoder cannot seek if compressed chunks have different
    /// numbers of points, as in COPC.
    pub(crate) fn can_seek(&self) -> bool {
        let laz = self.header().laz_vlr();
        !laz.is_ok_and(|laz| laz.uses_variable_size_chunks())
    }

    /// Seeks to a point, counted from 0.
    pub(crate) fn seek(&mut self, index: u64) -> Result<()> {
        self.taken = index;
        self.ready = 0..0;
        let Self { input, reader, .. } = self;
        let path = input.path();
        guarded(path, "LAS or LAZ", || {
            reader.seek(index).map_err(|e| problem(path, e))
        })
    }

    /// Decodes up to `n` points, calls `take` with each and its index, and returns their number.
    pub(crate) fn read(
        &mut self,
        n: usize,
        mut take: impl FnMut(u64, LasPoint<'_>) -> Result<()>,
    ) -> Result<u64> {
        let Self {
            input,
            reader,
            is_parallel,
            points,
            ready,
            taken,
            ..
        } = self;
        let path = input.path();
        let format = *reader.header().point_format();
        let (length, extra) = (points.record_len(), usize::from(format.extra_bytes));
        let most = LARGEST_PIECE / length.max(1);
        let n = n.min(most);
        if ready.start == ready.end {
            let decoded = if *is_parallel {
                most * rayon::current_num_threads()
            } else {
                n
            };
            let count = guarded(path, "LAS or LAZ", || {
                reader
                    .fill_points(decoded as u64, points)
                    .map_err(|e| problem(path, e))
            })?;
            *ready = 0..count as usize;
        }
        let first = *taken;
        let given = ready.start..ready.end.min(ready.start + n);
        let count = given.len() as u64;
        ready.start = given.end;
        *taken += count;
        let transforms = *reader.header().transforms();
        let time_at = if format.is_extended { 22 } else { 20 };
        let records = &points.raw_bytes()[given.start * length..given.end * length];
        for (i, record) in records.chunks_exact(length).enumerate() {
            let raw = |at: usize| i32::from_le_bytes(bytes_at(record, at));
            let point = LasPoint {
                position: Vec3::new(
                    transforms.x.direct(raw(0)),
                    transforms.y.direct(raw(4)),
                    transforms.z.direct(raw(8)),
                ),
                time_s: if format.has_gps_time {
                    f64::from_le_bytes(bytes_at(record, time_at))
                } else {
                    f64::NAN
                },
                intensity: f32::from(u16::from_le_bytes(bytes_at(record, 12))),
                extra: &record[length - extra..],
                record,
            };
            if !point.position.iter().all(|v| v.is_finite())
                || (format.has_gps_time && !point.time_s.is_finite())
            {
                return Err(point_error(
                    path,
                    first + i as u64,
                    "a coordinate or time that is not finite",
                    "finite numbers",
                ));
            }
            take(first + i as u64, point)?;
        }
        Ok(count)
    }
}

/// A format error at a point, counted from 0.
pub(crate) fn point_error(path: &Path, index: u64, found: &str, expected: &str) -> Error {
    Error::format(
        path,
        Location::Whole,
        format!("{found} at point {index}"),
        expected,
    )
}

pub(crate) fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[at..at + N]);
    out
}

/// Checks the header against the size of the file before a decoder relies on it.
fn check_header(path: &Path, file: &mut Stream, size: u64) -> Result<()> {
    let short = |at: u64, what: &str| {
        Error::format(
            path,
            Location::Byte(at),
            format!("a LAS file of {size} bytes that ends before {what}"),
            "a complete LAS or LAZ file",
        )
    };
    let mut head = [0u8; 375];
    let available = size.min(head.len() as u64) as usize;
    file.read_exact(&mut head[..available])
        .map_err(|e| Error::io(path, e))?;
    if available < 227 {
        return Err(short(size, "its header does"));
    }
    let minor = head[25];
    if available < 375 && minor >= 4 {
        return Err(short(size, "its header does"));
    }
    let u32_at = |at| u64::from(u32::from_le_bytes(bytes_at(&head, at)));
    let u64_at = |at| u64::from_le_bytes(bytes_at(&head, at));
    let data = u32_at(96);
    if data > size {
        return Err(short(96, "its points begin"));
    }
    let compressed = head[104] & 0x80 != 0;
    let length = u64::from(u16::from_le_bytes(bytes_at(&head, 105)));
    let points = match (u32_at(107), minor >= 4) {
        (0, true) => u64_at(247),
        (n, _) => n,
    };
    if !compressed && points.saturating_mul(length) > size - data {
        return Err(short(107, &format!("its {points} points do")));
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
    file.seek(SeekFrom::Start(0))
        .map_err(|e| Error::io(path, e))?;
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
                std::io::ErrorKind::UnexpectedEof => Error::format(
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
