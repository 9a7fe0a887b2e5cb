//! Files as all readers open them.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::error::{Error, Location, Result};

/// Points that readers hand over at a time, about.
pub(crate) const CHUNK_POINTS: usize = 200_000;

/// Opens a file that must hold something; also its size in bytes.
pub(crate) fn open(path: &Path) -> Result<(File, u64)> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let metadata = file.metadata().map_err(|e| Error::io(path, e))?;
    if metadata.is_dir() {
        return Err(Error::format(path, Location::Whole, "a folder", "a file"));
    }
    if metadata.is_file() && metadata.len() == 0 {
        return Err(Error::format(
            path,
            Location::Whole,
            "an empty file",
            "data",
        ));
    }
    Ok((file, metadata.len()))
}

/// The first bytes of a file, up to 4096; the file is left at its start.
pub(crate) fn first_bytes(path: &Path, file: &mut File) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(4096)
        .read_to_end(&mut bytes)
        .and_then(|_| file.seek(SeekFrom::Start(0)))
        .map_err(|e| Error::io(path, e))?;
    Ok(bytes)
}

/// The error of a file with the right form and nothing in it.
pub(crate) fn nothing_in(path: &Path, what: &str) -> Error {
    Error::format(
        path,
        Location::Whole,
        format!("no {what}"),
        format!("at least one {what}"),
    )
}

/// The extension of `path` in lower case, without the dot.
pub(crate) fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

/// Runs a decoder that others wrote on a file that may be damaged: should it panic, that is an
/// error of the file.
pub(crate) fn guarded<T>(
    path: &Path,
    format: &str,
    decode: impl FnOnce() -> Result<T>,
) -> Result<T> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode)).unwrap_or_else(|_| {
        Err(Error::format(
            path,
            Location::Whole,
            "content that no decoder understands",
            format!("an undamaged {format} file"),
        ))
    })
}
