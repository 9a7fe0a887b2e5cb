//! Checks the chunks of compressed files before they are decoded: the decoder invents points that a chunk does not
//! hold, and allocates the sizes that the layers claim (point formats 6 to 10) before it reads them.
//!
//! A chunk is its first point uncompressed, the number of its points (u32), the size of each layer (u32), and the
//! layers. A file may end with a table of the sizes of its chunks.

use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use laz::LazItemType;
use laz::laszip::ChunkTable;

use crate::error::{Error, Location, Result};
use crate::format::file::guarded;
use crate::format::input::{Input, Stream};

/// Largest chunk that is unpacked in parallel with others, bytes of points: COPC cells have 100,000 points of 30 to
/// 150 bytes, those written by this program up to 200,000.
const LARGEST_BESIDE: u64 = 32 << 20;

/// Checks that the layers of every chunk end where the chunk does, within a file of `size` bytes, and that the
/// chunks hold as many points as the header claims.
///
/// Returns whether the chunks have different sizes, as in COPC, and can be unpacked in parallel: a table gives the
/// start and the number of points of each, and these numbers add up to that of the header.
///
/// # Errors
/// The first chunk whose sizes contradict each other, with its byte; too few points.
pub(crate) fn check(input: &Input, header: &las::Header, size: u64) -> Result<bool> {
    let Ok(vlr) = header.laz_vlr() else {
        return Ok(false);
    };
    let (mut file, _) = input.open()?;
    let data = data_start(input.path(), &mut file)?;
    let table = guarded(input.path(), "LAZ", || {
        let mut from = BufReader::new(&mut file);
        from.seek(SeekFrom::Start(data))
            .map_err(|e| Error::io(input.path(), e))?;
        Ok(ChunkTable::read_from(from, &vlr).ok())
    })?;
    let points = header.number_of_points();
    let points_in = |table: &ChunkTable| {
        let chunks = table.as_ref().iter();
        chunks.fold(0u64, |sum, chunk| sum.saturating_add(chunk.point_count))
    };
    if let Some(table) = &table
        && points_in(table) < points
    {
        let chunks = table.as_ref().len();
        return Err(Error::format(
            input.path(),
            Location::Byte(107),
            format!(
                "{points} points in {chunks} chunks of {} points",
                points_in(table)
            ),
            "as many points as the chunks hold",
        ));
    }
    let layers: Option<usize> = vlr
        .items()
        .iter()
        .map(|item| layers(item.item_type()))
        .sum();
    let Some(layers) = layers.filter(|layers| *layers > 0) else {
        return Ok(false);
    };
    let mut chunks = Chunks {
        path: input.path(),
        file,
        // After the position of the table.
        at: data + ChunkTable::OFFSET_SIZE as u64,
        size,
        head: vec![0; 4 * layers],
        before_layers: vlr.items_size() + 4,
    };
    let Some(table) = table else {
        // Without a table the chunks are walked through; if their sizes vary, only the first can be checked.
        let per_chunk = if vlr.uses_variable_size_chunks() {
            points
        } else {
            vlr.chunk_size().into()
        };
        for _ in 0..points.div_ceil(per_chunk.max(1)) {
            chunks.next(None)?;
        }
        return Ok(false);
    };
    let mut largest = 0;
    for chunk in table.as_ref() {
        chunks.next(Some(chunk.byte_count))?;
        largest = chunk.point_count.max(largest);
    }
    Ok(vlr.uses_variable_size_chunks()
        && points_in(&table) == points
        && largest.saturating_mul(vlr.items_size()) <= LARGEST_BESIDE)
}

/// Number of layers of an item of the points; `None` for the older items, which have no layers.
fn layers(item: LazItemType) -> Option<usize> {
    Some(match item {
        LazItemType::Point14 => 9,
        LazItemType::RGB14 | LazItemType::WavePacket14 => 1,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => count.into(),
        _ => return None,
    })
}

/// Where the points begin: byte 96 of the header.
fn data_start(path: &Path, file: &mut Stream) -> Result<u64> {
    let mut bytes = [0; 4];
    file.seek(SeekFrom::Start(96))
        .and_then(|_| file.read_exact(&mut bytes))
        .map_err(|e| Error::io(path, e))?;
    Ok(u32::from_le_bytes(bytes).into())
}

/// The chunks of a file, one after the other.
struct Chunks<'a> {
    path: &'a Path,
    file: Stream,
    at: u64,
    size: u64,
    /// Buffer for the sizes of the layers.
    head: Vec<u8>,
    /// Bytes of a chunk before these sizes.
    before_layers: u64,
}

impl Chunks<'_> {
    /// Checks the next chunk, which has this many `bytes` according to the table, if there is one.
    fn next(&mut self, bytes: Option<u64>) -> Result<()> {
        let layers = self.at.saturating_add(self.before_layers);
        let first = layers.saturating_add(self.head.len() as u64);
        let error = |at: u64, found: String, expected: String| {
            Err(Error::format(
                self.path,
                Location::Byte(at),
                found,
                expected,
            ))
        };
        if first > self.size {
            let found = format!("a file of {} bytes", self.size);
            return error(self.at, found, "another compressed chunk".to_owned());
        }
        self.file
            .seek(SeekFrom::Start(layers))
            .and_then(|_| self.file.read_exact(&mut self.head))
            .map_err(|e| Error::io(self.path, e))?;
        let sizes = self.head.as_chunks::<4>().0.iter();
        let sum: u64 = sizes.map(|size| u64::from(u32::from_le_bytes(*size))).sum();
        let end = first.saturating_add(sum);
        let most = bytes.map_or(self.size, |bytes| self.at.saturating_add(bytes));
        if end > self.size || bytes.is_some() && end != most {
            let found = format!("layers of {sum} bytes from byte {first}");
            return error(layers, found, format!("layers that end at byte {most}"));
        }
        self.at = end;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::format::input::Input;
    use crate::format::las::file::LasFile;

    /// Writes ten points of format 6; returns the bytes of the file, and where its points begin.
    fn written(path: &std::path::Path) -> (Vec<u8>, usize) {
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = las::point::Format::new(6).unwrap();
        builder.point_format.is_compressed = true;
        let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
        for i in 0..10 {
            let point = las::Point {
                x: f64::from(i * i % 7),
                gps_time: Some(f64::from(i)),
                ..Default::default()
            };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
        let bytes = std::fs::read(path).unwrap();
        let data = u32::from_le_bytes(bytes[96..100].try_into().unwrap());
        (bytes, data as usize)
    }

    #[test]
    fn sizes_that_the_chunk_contradicts_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.laz");
        let (whole, data) = written(&path);
        assert_eq!(
            LasFile::open(&Input::from(&path))
                .unwrap()
                .read(99, |_, _| Ok(()))
                .unwrap(),
            10
        );
        let message = |at: usize, value: u32| {
            let mut bytes = whole.clone();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            if at == 107 {
                // The number of points with 64 bits, which counts if the two contradict each other.
                bytes[247..251].copy_from_slice(&value.to_le_bytes());
            }
            std::fs::write(&path, bytes).unwrap();
            let error = LasFile::open(&Input::from(&path)).err().expect("an error");
            error.to_string()
        };
        // After the position of the table, the first point and the number of points.
        let sizes = data + 8 + 30 + 4;
        for size in [u32::MAX, 1 << 20, 0] {
            let found = message(sizes, size);
            let expected = format!("byte {sizes}: found layers of");
            assert!(found.contains(&expected), "{found}");
        }
        // Ten million points in a chunk of ten.
        let found = message(107, 10_000_000);
        assert!(found.contains("10000000 points of 30 bytes"), "{found}");
        // More than the chunk of 50,000 holds.
        let found = message(107, 60_000);
        assert!(
            found.contains("60000 points in 1 chunks of 50000"),
            "{found}"
        );
    }
}
