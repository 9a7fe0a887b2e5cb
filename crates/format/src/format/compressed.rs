//! Files compressed as a whole, with gzip or Zstandard.

use std::io::{self, BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};

use tempfile::SpooledTempFile;

use crate::error::{Error, Location, Result};
use crate::format::file::guarded;
use crate::format::memory::Budget;

const GZIP: &[u8] = &[0x1f, 0x8b];
/// The first bytes of a frame of Zstandard.
pub(super) const ZSTANDARD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];
/// Extensions of compressed files; that of rosbag2 is the last one.
const EXTENSIONS: [&str; 3] = ["gz", "zst", "zstd"];
/// A compressed file unpacks to at most this many times its size, plus `ALWAYS_BYTES`: text of numbers unpacks to ten
/// times its size, and one that claims more was made to keep the reader busy. It must also fit in memory, as readers keep
/// most of what they read.
const MOST_EXPANDED: u64 = 250;
/// What unpacks to more than this is kept in a temporary file without a name.
const ALWAYS_BYTES: u64 = 8 << 20;
/// Bytes that are unpacked at a time.
const PIECE: usize = 1 << 18;

/// The content of a compressed file.
pub(super) struct Unpacked {
    pub(super) content: SpooledTempFile,
    /// Its number of bytes.
    pub(super) size: u64,
}

/// Unpacks an opened file of `size` bytes; `None` if it is not compressed, and it is left at its beginning.
///
/// # Errors
/// A file that is damaged, cut off, or unpacks to far more than its size.
pub(super) fn unpack(
    path: &Path,
    file: &mut (impl Read + Seek),
    size: u64,
) -> Result<Option<Unpacked>> {
    let mut start = Vec::new();
    let io = |e| Error::io(path, e);
    file.by_ref().take(4).read_to_end(&mut start).map_err(io)?;
    file.rewind().map_err(io)?;
    let most = most_bytes(size, Budget::new(None));
    if start.starts_with(GZIP) {
        let decoder = flate2::read::MultiGzDecoder::new(BufReader::new(file));
        return read(path, decoder, most, "gzip").map(Some);
    }
    if start.starts_with(ZSTANDARD) {
        return guarded(path, "Zstandard", || {
            let decoder = ruzstd::decoding::StreamingDecoder::new(BufReader::new(file))
                .map_err(|e| damaged(path, &e, "Zstandard"))?;
            read(path, decoder, most, "Zstandard").map(Some)
        });
    }
    Ok(None)
}

/// The largest number of bytes to which a file of `size` bytes may unpack.
fn most_bytes(size: u64, memory: Budget) -> u64 {
    let most = size.saturating_mul(MOST_EXPANDED);
    most.saturating_add(ALWAYS_BYTES).min(memory.bytes)
}

fn read(path: &Path, decoder: impl Read, most: u64, name: &str) -> Result<Unpacked> {
    let mut decoder = decoder.take(most + 1);
    let mut content = SpooledTempFile::new(ALWAYS_BYTES as usize);
    let (mut piece, mut size) = (vec![0; PIECE], 0);
    loop {
        let count = match decoder.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(damaged(path, &error, name)),
        };
        let written = content.write_all(&piece[..count]);
        written.map_err(|error| Error::io(std::env::temp_dir(), error))?;
        size += count as u64;
    }
    if size > most {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{name} data that unpack to more than {most} bytes"),
            "a file that unpacks to at most 250 times its size and 8 MiB, and to half of the free memory",
        ));
    }
    Ok(Unpacked { content, size })
}

fn damaged(path: &Path, error: &dyn std::error::Error, name: &str) -> Error {
    Error::format(
        path,
        Location::Whole,
        format!("damaged compression ({error})"),
        format!("an undamaged {name} file"),
    )
}

/// A path without the extension of its compression.
pub(super) fn without_extension(path: &Path) -> PathBuf {
    let is_compressed = path
        .extension()
        .and_then(|e| e.to_str())
        .is_some_and(|e| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)));
    if is_compressed {
        path.with_extension("")
    } else {
        path.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::format::{detect, read_cloud};

    #[test]
    fn files_unpack_to_no_more_than_the_memory() {
        let memory = |bytes| Budget::new(Some(bytes));
        assert_eq!(most_bytes(1000, memory(1 << 40)), (8 << 20) + 250_000);
        assert_eq!(most_bytes(1 << 40, memory(1 << 30)), 1 << 30);
    }

    #[test]
    fn compressed_text_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let text = "1 2 3\n4 5 6\n";
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        gzip.write_all(text.as_bytes()).unwrap();
        let gzip = gzip.finish().unwrap();
        // A frame of Zstandard with its size and one block that is not compressed.
        let mut zstandard = vec![0x28, 0xb5, 0x2f, 0xfd, 0x20, text.len() as u8];
        zstandard.extend(&(1 | (text.len() as u32) << 3).to_le_bytes()[..3]);
        zstandard.extend(text.as_bytes());
        for (name, bytes) in [("a.xyz.gz", &gzip), ("a.xyz.zst", &zstandard)] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(detect(&path).unwrap().id(), "xyz-text");
            assert_eq!(read_cloud(&path).unwrap().points.len(), 2);
            std::fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
            let error = read_cloud(&path).unwrap_err().to_string();
            assert!(error.contains("damaged compression"), "{error}");
        }
        // 16 MiB of blanks take 16 kB.
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        gzip.write_all(&vec![b' '; 16 << 20]).unwrap();
        let path = folder.path().join("a.gz");
        std::fs::write(&path, gzip.finish().unwrap()).unwrap();
        let error = read_cloud(&path).unwrap_err().to_string();
        assert!(error.contains("unpack to more than"), "{error}");
    }
}
